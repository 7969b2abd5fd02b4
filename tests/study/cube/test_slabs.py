"""Large cubes: written slab by slab, equal to those written as a whole, read when they are used."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import tripod_doe as td
from tripod_doe.study.cube import slab_file, writing
from tripod_doe.study.cube.slab_file import _shrinks
from tripod_doe.study.cube.slabs import box, slabs
from tripod_doe.study.query import query
from tripod_doe.study.query.query import records
from tripod_doe.study.result_directory.open_cube import opened_cube

pytestmark = pytest.mark.usefixtures("pages_not_made")

FUNCTION = """
import numpy as np
import xarray as xr


def force(x, y=1.0, kind="soft"):
    if x == 3:
        raise ValueError(f"no force at {y}")
    course = x * y * np.sin(np.arange(6))
    answer = xr.Dataset({"peak": x * y, "course": ("place", course)}, coords={"place": [f"p{i}" for i in range(6)]})
    return answer if x > 1 else answer[["peak"]]
"""
COURSES = """
import numpy as np
import xarray as xr


def force(x):
    labels = {"rotation_deg": np.arange(512.0), "order": np.arange(3)}
    return xr.Dataset({"course": ("rotation_deg", x * np.ones(512)), "few": ("order", x * np.ones(3))}, coords=labels)
"""
GRID = """
[study]
name = "grid"
function = "force:force"
[factors]
x = {values = [0, 1, 2, 3, 4, 5, 6]}
y = {values = [1, 2, 5]}
kind = {values = ["soft", "hard"]}
[design]
kind = "grid"
constraints = ["x + y < 10"]
[run]
block = 5
expected_outcomes = ["error"]
"""
LIST = """
[study]
name = "list"
function = "force:force"
[factors]
x = {distribution = "discrete", values = [0, 1, 2, 3, 4]}
y = {low = 1, high = 5}
kind = {distribution = "discrete", values = ["soft", "hard"]}
[design]
kind = "latin-hypercube"
samples = 60
[run]
block = 7
expected_outcomes = ["error"]
"""


@given(st.lists(st.integers(1, 9), min_size=1, max_size=4), st.integers(1, 50), st.integers(1, 5000))
def test_slabs_are_the_points_in_order_and_no_larger_than_asked_for(shape, cell, most):
    """Exact: every cell once, in the order of the points, and parts of a smaller size fit into those of a larger."""
    lengths = box(shape, cell, most)
    assert cell * math.prod(lengths) <= max(most, cell)
    numbers, start = np.arange(math.prod(shape)).reshape(shape), 0
    for slab in slabs(shape, lengths):
        assert slab.start == start
        assert numbers[slab.place].ravel().tolist() == list(range(slab.start, slab.stop))
        start = slab.stop
    assert start == numbers.size
    for small, large, length in zip(box(shape, cell, max(most // 4, 1)), lengths, shape, strict=True):
        assert large % small == 0 or large == length


@pytest.fixture
def run_in_slabs(tmp_path, monkeypatch):
    """Run a study twice: its cube as a whole, and in slabs of so many bytes."""

    def run(text, size, function=FUNCTION):
        (tmp_path / "force.py").write_text(function)
        (tmp_path / "study.toml").write_text(text)
        td.run(tmp_path / "study.toml", tmp_path / "whole", workers=0, progress=False)
        monkeypatch.setattr(writing, "_SLAB_BYTES", size)
        td.run(tmp_path / "study.toml", tmp_path / "slabs", workers=0, progress=False)
        return tmp_path / "whole", tmp_path / "slabs"

    return run


MEASURED = ["cpu_seconds", "wall_seconds"]


def without_history(cube):
    return cube.drop_vars(MEASURED).assign_attrs(history="")


@pytest.mark.parametrize("text", [GRID, LIST], ids=["grid", "list"])
def test_a_cube_in_slabs_is_the_one_that_is_written_as_a_whole(run_in_slabs, text):
    """The same variables, values, types and attributes; the first slab lacks an output that later ones have."""
    whole, parts = run_in_slabs(text, 2000)
    expected, result = td.open_cube(whole), td.open_cube(parts)
    xr.testing.assert_identical(without_history(expected), without_history(result))
    numbers = {name: variable.dtype for name, variable in expected.variables.items() if variable.dtype.kind in "fi"}
    assert {name: result[name].dtype for name in numbers} == numbers
    with netCDF4.Dataset(parts / "cube.nc") as stored:
        assert stored["course"].chunking() != "contiguous"
        assert set(stored["outcome_detail_text"][:]) >= {"", "ValueError: no force at 1" if text == GRID else ""}
        assert "_FillValue" not in stored["y"].ncattrs()
    with netCDF4.Dataset(whole / "cube.nc") as stored:
        assert stored["outcome_detail"].dtype is str  # a small one is as it ever was


@pytest.mark.parametrize("design", ['kind = "latin-hypercube"\nsamples = 200', 'kind = "grid"'])
def test_a_chunk_of_a_course_has_all_points_of_a_slab_and_a_part_of_the_labels(run_in_slabs, monkeypatch, design):
    """Exact: so that a part of a course is read at all points without the rest of it; short rows stay together."""
    monkeypatch.setattr(slab_file, "CHUNK_BYTES", 32 * 64 * 8)
    count = ", count = 200" if "grid" in design else ""
    text = LIST.split("[factors]")[0] + f"[factors]\nx = {{low = 1, high = 2{count}}}\n[design]\n{design}"
    _, parts = run_in_slabs(text, 32 * (515 * 8 + 200), COURSES)
    with netCDF4.Dataset(parts / "cube.nc") as stored:
        assert stored["course"].chunking() == [32, 64]
        assert stored["few"].chunking() == [32, 3]
        assert stored["outcome"].chunking() == [32]


def test_a_slab_that_cannot_be_written_ends_the_command_and_leaves_the_old_cube(run_in_slabs, monkeypatch):
    """Slabs are written beside the making of the next one; what goes wrong there is told as anywhere."""
    _, parts = run_in_slabs(LIST, 2000)
    before, write = (parts / "cube.nc").read_bytes(), slab_file.CubeFile.write

    def full(self, slab, part):
        if slab.start:
            raise OSError(28, "No space left on device")
        write(self, slab, part)

    monkeypatch.setattr(slab_file.CubeFile, "write", full)
    with pytest.raises(td.StorageError, match="No space left"):
        td.run(parts / "study.toml", parts, workers=0, progress=False)
    assert (parts / "cube.nc").read_bytes() == before
    assert not list(parts.glob("*.tmp*"))


@pytest.mark.slow
def test_a_cube_in_slabs_conforms_to_cf(run_in_slabs, tmp_path):
    """The checker's own verdict, CF 1.8."""
    _, parts = run_in_slabs(GRID.replace('kind = {values = ["soft", "hard"]}', ""), 1000)
    report = tmp_path / "report.json"
    command = [
        str(Path(sys.executable).with_name("compliance-checker")),
        "-t",
        "cf:1.8",
        "-c",
        "strict",
        "-f",
        "json",
        "-o",
        str(report),
        str(parts / "cube.nc"),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert report.exists(), done.stdout + done.stderr
    checks = json.loads(report.read_text())["cf:1.8"]["high_priorities"]
    assert not [check["msgs"] for check in checks if check["value"][0] < check["value"][1]]


@pytest.mark.parametrize("asked", [{}, {"select": ["y=2:5"], "where": "x > 1 and outcome == 'finished'"}])
def test_a_question_is_answered_slab_by_slab(run_in_slabs, monkeypatch, asked):
    """The same records in the same order as from the whole, texts included."""
    whole, parts = run_in_slabs(GRID, 2000)
    with opened_cube(whole) as cube:
        expected = [records(cube, name, **asked) for name in ("course", "outcome_detail")]
    monkeypatch.setattr(query, "_SLAB_CELLS", 10)
    with opened_cube(parts) as cube:
        result = [records(cube, name, **asked) for name in ("course", "outcome_detail")]
    for one, other in zip(expected, result, strict=True):
        assert one.keys() == other.keys()
        assert one["x"].size > 10
        for name, column in one.items():
            assert np.array_equal(column, other[name], equal_nan=column.dtype.kind == "f"), name


def test_whether_compression_pays_is_asked_of_more_than_the_first_points():
    """Regression: a first point that failed had all courses of noise compressed, which took five times as long."""
    noise = np.random.default_rng(1).normal(size=(40, 16_000))
    empty = np.full_like(noise, np.nan)
    assert not _shrinks(np.vstack([empty[:1], noise]))
    assert _shrinks(np.vstack([noise[:1], empty]))
    assert not _shrinks(noise[:1, :3])
