"""Each command imports only what it needs: the start of a command is the first thing that everybody waits for."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tripod_doe.study.cube.netcdf import write_dataset

STUDY = Path(__file__).parent.parent / "studies" / "thrust_map.toml"
LIBRARIES = {
    "dask",
    "distributed",
    "fastapi",
    "matplotlib",
    "netCDF4",
    "numba",
    "numpy",
    "pandas",
    "pydantic",
    "SALib",
    "scipy",
    "starlette",
    "uvicorn",
    "xarray",
}


FUNCTION = """
[study]
name = "doubled"
function = "doubling:double"
[factors.x]
values = [1, 2]
"""


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    path = tmp_path_factory.mktemp("cube") / "cube.nc"
    write_dataset(xr.Dataset({"y": ("x", np.arange(3.0))}, {"x": [1.0, 2.0, 3.0]}), path)
    return path


@pytest.mark.parametrize(
    ("command", "needs"),
    [
        pytest.param("--help", set(), marks=pytest.mark.slow),
        ("run --help", set()),
        ("plan {study} --no-timing", {"numpy", "pydantic"}),
        ("simulate", {"numba", "numpy", "scipy"}),
        ("query {cube} --variable y --where 'x > 1'", {"dask", "numpy", "netCDF4", "pandas", "xarray"}),
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


@pytest.mark.slow
def test_a_run_imports_what_draws_and_analyses_only_when_it_does(tmp_path):
    """Its first point comes seconds earlier; a report without an analysis does without its libraries."""
    (tmp_path / "doubling.py").write_text(
        "import os, sys\ndef double(x):\n    print('imported', *sys.modules)\n"
        "    print('threads', os.environ['OPENBLAS_NUM_THREADS'])\n    return {'y': 2 * x}\n"
    )
    (tmp_path / "study.toml").write_text(FUNCTION)
    words = ["run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--workers", "0"]
    script = "import sys; from tripod_doe.cli import main; code = main(); print('imported', *sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", script, *words], env=environment, capture_output=True, text=True, check=True
    )
    first, _, last = (set(line.split()) for line in done.stdout.splitlines() if line.startswith("imported"))
    assert {"distributed", "matplotlib", "numba", "SALib", "scipy"} & first == set()
    assert {"distributed", "numba", "SALib", "scipy.stats"} & last == set()
    assert "matplotlib" in last
    assert "threads 1\n" in done.stdout  # as in workers, so that a point gives the same in both


@pytest.mark.slow
def test_the_server_computes_nothing_and_what_computes_serves_nothing():
    """The server's process stays small and quick; a process that answers or computes loads no web code."""
    computes, serves = {"dask", "matplotlib", "netCDF4", "numba", "xarray"}, {"fastapi", "starlette", "uvicorn"}
    for modules, unwanted in (
        (["tripod_doe.service.server"], computes),
        (
            [f"tripod_doe.service.{name}" for name in ("workers.answers", "requests.plans", "explorer.descriptions")]
            + [
                "tripod_doe.study.execution.dask_local_cluster",
                "tripod_doe.study.execution.task",
                "tripod_doe.workflow.run_workflow",
            ],
            serves,
        ),
    ):
        script = f"import sys, {', '.join(modules)}; print(*sys.modules)"
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        assert unwanted & set(done.stdout.split()) == set(), modules
