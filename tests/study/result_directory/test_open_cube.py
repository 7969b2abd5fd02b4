"""What a result directory shows while its study runs and after an interrupt: the points finished so far."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import psutil
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import CubeError
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.result_directory import open_cube
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.study.result_directory.open_cube import is_shown, opened_cube
from tripod_doe.study.study_points import StudyPoints

pytestmark = pytest.mark.usefixtures("pages_not_made")

STUDY = """
[study]
name = "plates"
scene = "needle-between-plates"
[base]
duration_s = 0.001
[factors.friction_a]
low = 0.01
high = 0.05
count = 4
[factors.plate_speed_mm_s]
values = [100, 200]
[run]
block = 3
"""


@pytest.fixture
def study(tmp_path):
    file = tmp_path / "plates.toml"
    file.write_text(STUDY)
    return file


def run_first_block(study, out):
    """Leave a directory as a kill after the first of three blocks would."""
    read = load_study(study)
    asked = StudyPoints(read, make_points(read))
    with Execution(0) as execution, ResultDirectory(out) as directory:
        directory.accept(asked)
        directory.commit(next(iter(execution.run(asked, directory.resume.missing(asked), careful=False))))


def own_files(out):
    """Names without those that SQLite keeps while somebody reads."""
    return sorted(path.name for path in out.iterdir() if not path.name.endswith(("-shm", "-wal")))


def test_the_finished_points_of_an_interrupted_study_can_be_queried_and_reported(study, tmp_path, capsys):
    out = tmp_path / "out"
    run_first_block(study, out)
    files = own_files(out)
    cube = td.open_cube(out)
    assert np.bincount(cube.outcome.values.ravel()).tolist() == [3, *[0] * 9, 5]
    assert main(["query", str(out), "--variable", "axial_drift_mm", "--where", "outcome == 'finished'"]) == 0
    assert len(capsys.readouterr().out.strip().splitlines()) == 1 + 3
    assert own_files(out) == files
    assert main(["report", str(out)]) == 0
    assert "3 of 8" in (out / "report" / "index.html").read_text()

    assert td.run(study, out, workers=0, progress=False).complete
    whole = td.open_cube(out)
    assert is_shown(out)
    assert (whole.outcome == 0).all()
    first = cube.outcome.values == 0
    np.testing.assert_array_equal(whole.axial_drift_mm.values[first], cube.axial_drift_mm.values[first])


def test_a_study_that_grows_shows_its_new_points_and_not_the_analyses_of_the_old(study, tmp_path):
    out = tmp_path / "out"
    td.run(study, out, workers=0, progress=False)
    (out / "analysis").mkdir(exist_ok=True)
    write_dataset(td.open_cube(out).assign_attrs(analysis_kind="own"), out / "analysis" / "earlier.nc")
    assert "earlier" in td.write_report(out).read_text()
    study.write_text(STUDY.replace("[100, 200]", "[100, 200, 300, 400]"))
    run_first_block(study, out)
    assert td.open_cube(out).sizes["plate_speed_mm_s"] == 4
    page = td.write_report(out).read_text()
    assert "11 of 16" in page
    assert "earlier" not in page


def test_a_cube_made_so_far_is_the_one_that_the_run_writes(study, tmp_path):
    """Contract: the same variables, coordinates and attributes, whichever way it is made."""
    out = tmp_path / "out"
    td.run(study, out, workers=0, progress=False)
    written = td.open_cube(out)
    (out / "cube.nc").unlink()
    made = td.open_cube(out)
    history = {"history"}
    xr.testing.assert_equal(made, written)
    assert {k: v for k, v in made.attrs.items() if k not in history} == {
        k: v for k, v in written.attrs.items() if k not in history
    }


def test_a_large_cube_so_far_is_not_held_in_memory(study, tmp_path, monkeypatch):
    """Cubes of any size count as large here: the points so far stand in temporary files, which go."""
    out = tmp_path / "out"
    run_first_block(study, out)
    whole = td.open_cube(out)
    monkeypatch.setattr(open_cube, "_READ_AT_ONCE", 0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with open_cube.opened_cube(out) as cube:
        assert not cube["axial_drift_mm"].variable._in_memory
        assert list(tmp_path.glob("tripod-doe-*/cube.nc"))
        xr.testing.assert_equal(cube.load(), whole)
    assert not list(tmp_path.glob("tripod-doe-*"))
    xr.testing.assert_equal(td.open_cube(out), whole)
    with opened_cube(out) as arrays:
        assert np.array_equal(arrays.variables["outcome"].values, whole["outcome"].values)
    assert not list(tmp_path.glob("tripod-doe-*"))


def test_without_any_finished_point_the_error_says_so(study, tmp_path):
    read = load_study(study)
    with ResultDirectory(tmp_path / "out") as directory:
        directory.accept(StudyPoints(read, make_points(read)))
    with pytest.raises(CubeError, match=r"no cube\.nc and no finished point"):
        td.open_cube(tmp_path / "out")


def test_a_cube_can_be_opened_without_reading_it(study, tmp_path):
    """Values as those in memory; the files are given back when it is closed."""
    out = tmp_path / "out"
    td.run(study, out, workers=0, progress=False)
    whole = td.open_cube(out)
    with td.open_cube(out, chunks={"friction_a": 2}) as cube:
        assert cube["axial_drift_mm"].chunks == ((2, 2), (2,))
        assert set(cube.variables) == set(whole.variables)
        np.testing.assert_array_equal(cube["axial_drift_mm"][3], whole["axial_drift_mm"][3])
        xr.testing.assert_identical(cube.load(), whole)
    files = [Path(file.path).resolve() for file in psutil.Process().open_files()]
    assert not [file for file in files if file.is_relative_to(out.resolve())]
    with td.open_cube(out / "cube.nc", chunks="auto") as cube:
        assert cube["axial_drift_mm"].chunks is not None
    with pytest.raises(CubeError, match="there is no such file"):
        td.open_cube(tmp_path / "none.nc", chunks="auto")


@pytest.mark.parametrize("read", [open_cube.open_cube, open_cube.opened_cube, td.query])
def test_a_study_that_is_replaced_while_it_is_read_is_read_anew(study, tmp_path, monkeypatch, read):
    """A query beside `derive` refused results as those of another study."""
    out = tmp_path / "out"
    td.run(study, out)
    study.write_text(STUDY + '[responses.twice]\nformula = "2 * friction_a"\nunit = "1"\nmeaning = "twice"\n')
    derived, look, looks = load_study(study), open_cube.is_shown, []

    def look_before_it_is_replaced(path):
        shown = len(looks) < 2 or look(path)  # the second time as if it was derived and replaced once more
        if not looks:
            with ResultDirectory(out) as directory:
                directory.accept(StudyPoints(derived, make_points(derived)))
        looks.append(shown)
        return shown

    monkeypatch.setattr(open_cube, "is_shown", look_before_it_is_replaced)
    with read(out, "twice") if read is td.query else read(out) as cube:
        assert "twice" in cube.variables
    assert looks == [True, True, False]
