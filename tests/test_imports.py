"""Each command imports only what it needs: the start of a command is the first thing that everybody waits for."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tripod_doe.study.netcdf import write_dataset

STUDY = Path(__file__).parent.parent / "studies" / "thrust_map.toml"
LIBRARIES = {"dask", "distributed", "matplotlib", "netCDF4", "numba", "numpy", "pandas", "pydantic", "SALib", "scipy",
             "xarray"}  # fmt: skip


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    path = tmp_path_factory.mktemp("cube") / "cube.nc"
    write_dataset(xr.Dataset({"y": ("x", np.arange(3.0))}, {"x": [1.0, 2.0, 3.0]}), path)
    return path


@pytest.mark.parametrize(
    ("command", "needs"),
    [
        ("--help", set()),
        ("run --help", set()),
        ("plan {study} --no-timing", {"numpy", "pydantic"}),
        ("simulate", {"numba", "numpy", "scipy"}),
        ("query {cube} --variable y --where 'x > 1'", {"numpy", "netCDF4"}),
    ],
)
def test_a_command_imports_only_what_it_needs(cube, command, needs):
    """Run in a fresh process, which says what it imported."""
    words = [word.strip("'").format(cube=cube, study=STUDY) for word in command.split(" ", 5)]
    script = (
        "import json, sys; from tripod_doe.cli import main; "
        f"code = main({words!r}); print('\\n' + json.dumps([code, sorted(sys.modules)]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    code, modules = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, done.stderr
    assert LIBRARIES & set(modules) == needs
