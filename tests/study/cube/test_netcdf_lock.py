"""Threads that read and write cubes at the same time; netCDF4 and the library below it allow one thread at a time.

Each stress runs in a process of its own, as a collision ends it without a traceback (SIGSEGV).
"""

import pickle
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK

pytestmark = pytest.mark.usefixtures("pages_not_made")

READ = """
import sys, threading
import tripod_doe as td
cube = sys.argv[1]
failed = []

def watched(work):
    def repeat():
        try:
            for _ in range(25):
                work()
        except BaseException as error:
            failed.append(repr(error))
    return repeat

def lazily():
    with td.open_cube(cube, chunks="auto") as opened:
        float(opened.course.sum())

works = [lambda: td.open_cube(cube), lambda: td.query(cube, "y"), lazily]
threads = [threading.Thread(target=watched(work)) for work in works]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
sys.exit("; ".join(failed) or 0)
"""

RUN = """
import sys, threading
from pathlib import Path
import tripod_doe as td
failed = []

def run(name):
    try:
        for number in range(4):
            td.run(sys.argv[1], out=Path(sys.argv[1]).parent / f"{name}{number}", workers=0)
    except BaseException as error:
        failed.append(repr(error))

threads = [threading.Thread(target=run, args=(name,)) for name in "abc"]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
sys.exit("; ".join(failed) or 0)
"""


def stress(script: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a script in a process of its own."""
    return subprocess.run([sys.executable, "-c", script, *map(str, words)], capture_output=True, text=True, timeout=120)


@pytest.fixture
def cube(tmp_path):
    points = np.arange(400)
    made = xr.Dataset(
        {
            **{name: ("point", np.sqrt(points), {"units": name}) for name in "yabcdefgh"},
            "course": (("point", "angle"), np.ones((400, 300))),
            "told": ("point", np.array([f"point {number}" for number in points], object)),
        },
        {"point": points, "angle": np.arange(300.0)},
    )
    made.to_netcdf(tmp_path / "cube.nc")
    return tmp_path / "cube.nc"


def test_threads_read_a_cube_at_the_same_time(cube):
    """Regression: three threads that opened and queried one cube ended the process by SIGSEGV in six of six."""
    ended = stress(READ, cube)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.slow
def test_threads_run_studies_at_the_same_time(tmp_path):
    """Regression: two threads that ran studies ended the process by SIGSEGV in eight of fourteen."""
    (tmp_path / "f.py").write_text("def f(x):\n    return {'y': x * x}\n")
    study = tmp_path / "s.toml"
    study.write_text('[study]\nname = "s"\nfunction = "f:f"\n[factors.x]\nvalues = [1, 2, 3]\n')
    ended = stress(RUN, study)
    assert ended.returncode == 0, ended.stderr
    cubes = [xr.load_dataset(tmp_path / f"{name}3" / "cube.nc") for name in "abc"]
    assert all(cube.y.values.tolist() == [1.0, 4.0, 9.0] for cube in cubes)


def test_the_lock_is_held_again_by_its_thread_and_by_no_other(cube):
    def other() -> None:
        taken.append(NETCDF_LOCK.acquire(blocking=False))

    taken: list[bool] = []
    with NETCDF_LOCK, NETCDF_LOCK:
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
    assert taken == [False]
    assert NETCDF_LOCK.acquire(blocking=False)
    NETCDF_LOCK.release()


def test_whoever_holds_it_keeps_out_cubes_that_are_read_with_xarray_alone(cube):
    """A user's own xarray.open_dataset takes xarray's lock, which is held with ours."""

    def read() -> None:
        with xr.open_dataset(cube, cache=False) as opened:
            read_values.append(float(opened.y[4]))

    read_values: list[float] = []
    thread = threading.Thread(target=read)
    with NETCDF_LOCK:
        thread.start()
        thread.join(0.5)
        assert thread.is_alive()
        assert not read_values
    thread.join()
    assert read_values == [2.0]


def test_a_copy_in_another_place_is_the_same_lock():
    """Dask copies the arrays of an open cube, with their lock."""
    assert pickle.loads(pickle.dumps(NETCDF_LOCK)) is NETCDF_LOCK


TWICE = """
import sys
import tripod_doe as td
opened = [td.open_cube(sys.argv[1], chunks="auto") for _ in range(5)]
td.query(sys.argv[1], "y")
opened.pop(2).close()
td.open_cube(sys.argv[1])
opened.pop(0).close()
for cube in opened:
    assert float(cube.course.sum()) == 120_000
    assert cube.told.values[7] == "point 7"
    cube.close()
"""


@pytest.mark.slow
def test_a_cube_with_texts_that_is_read_several_times_is_open_once(cube):
    """Regression: netCDF4 1.7.5 with HDF5 2.2 ends the process where such a file is opened twice and closed."""
    for _ in range(3):
        ended = stress(TWICE, cube)
        assert (ended.returncode, ended.stderr) == (0, "")
