"""Fixtures for tests of analyses, pages and reports: small cubes made by the real code, without a cluster: study text -> points -> one block -> cube with costs."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

FUNCTIONS = """
import math
def line(x, z=0.0, offset=0.0):
    return {"y": 3 * x + offset + 0 * z}
def cubic(x):
    return {"y": x**3}
def noisy(replicate):
    return {"y": 5 + 1e-4 * replicate}
def ishigami(x1, x2, x3):
    return {"y": math.sin(x1) + 7 * math.sin(x2) ** 2 + 0.1 * x3**4 * math.sin(x1)}
def mechanisms(a, b, x, z):
    return {"y": x * a + z * (0.001 - a if (a, b) == (4, 3) else 1) + 0 * b}
def vee(x, z):
    return {"y": abs(x) + 0.1 * x * z}
def failing(x):
    raise ValueError("no <b>answer</b> here")
def uneven(x, z):
    return {"y": 10 * x + z}
def three(x, z, w):
    return {"y": 10 * x + z + 3 * w}
"""

JOINT = """
[study]
name = "Angles and needles"
question = "What do angle and needles do?"
[base]
initial_skew_1_deg = 0.4
roller_width_mm = 11
[factors.joint_angle_deg]
values = [4, 8, 12]
[factors.torque_n_m]
values = [25, 50, 100, 200]
[factors.needle_count]
values = [27, 29]
"""
"""29 needles do not fit on the reference pitch circle, so half of the points are jammed."""


@pytest.fixture(scope="session")
def read_table() -> Callable[[str], pd.DataFrame]:
    """Read CSV text with every digit; pandas' own parser is off by a rounding now and then."""

    def read(text: str) -> pd.DataFrame:
        frame = pd.read_csv(io.StringIO(text), dtype=str)
        numbers = {name: column.map(float) for name, column in frame.items() if name != "factor"}
        return frame.assign(**numbers)

    return read


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("functions")
    (folder / "report_functions.py").write_text(FUNCTIONS)
    return folder


@pytest.fixture(scope="session")
def make_cube(folder):
    from tripod_doe.study.cube.dataset import build_cube  # imported here: every test session loads this module
    from tripod_doe.study.cube.netcdf import stamp_history
    from tripod_doe.study.definition.study_file import parse_study
    from tripod_doe.study.definition.study_folder import StudyFolder
    from tripod_doe.study.designs import make_points
    from tripod_doe.study.execution.task import make_task, run_task
    from tripod_doe.study.fingerprints import point_keys
    from tripod_doe.study.journal import FinishedBlock

    def make(text: str, part: slice = slice(None)) -> xr.Dataset:
        """The cube of a study whose points `part` were run."""
        study = parse_study(textwrap.dedent(text), folder=StudyFolder(folder))
        points = make_points(study)
        keys = point_keys(study, points)
        chosen = np.flatnonzero(points.allowed)[part]
        blocks = []
        if chosen.size:
            result, cpu, wall = run_task(make_task(study, points, chosen))
            blocks.append(FinishedBlock(keys[chosen], result, cpu, wall, "0"))
        cube, cost = build_cube(study, points, keys, iter(blocks))
        return stamp_history(cube.assign({name: cost[name] for name in cost.data_vars}), "made by a test")

    return make


@pytest.fixture(scope="session")
def joint_cube(make_cube) -> xr.Dataset:
    return make_cube(JOINT)


@pytest.fixture(scope="session")
def grid_cube(make_cube) -> xr.Dataset:
    """The same without the needles that do not fit: a grid over two factors."""
    return make_cube(JOINT.partition("[factors.needle_count]")[0])


@pytest.fixture(scope="session")
def line_cube(make_cube) -> xr.Dataset:
    """A study of a function: few figures, so its page is made quickly."""
    return make_cube(
        '[study]\nname = "L"\nfunction = "report_functions:line"\n[factors]\nx = { values = [1, 2] }\n[base]\nz = 7\n'
    )


@pytest.fixture(scope="session")
def joint_page(joint_cube) -> str:
    from tripod_doe.reports.study_report import make_page

    return make_page(joint_cube, {})
