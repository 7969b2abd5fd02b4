"""Which netCDF files are read: undamaged ones, and those that belong to the place where they lie."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.errors import CubeError
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.cube.file_digest import is_damaged, is_sealed
from tripod_doe.study.cube.lazy_dataset import read_dataset
from tripod_doe.study.cube.netcdf import write_dataset


def written(path, value=1.0):
    path.parent.mkdir(exist_ok=True)
    write_dataset(xr.Dataset({"y": ("x", np.full(40, value))}, {"x": np.arange(40.0)}), path)
    return path


@pytest.mark.parametrize("lost", range(1, 83, 9))
def test_a_digest_whose_end_is_zeroed_or_cut_is_damage(tmp_path, lost):
    """Of a file without a digest nothing but its chunks is checked, so a damaged digest must not count as none."""
    cube = written(tmp_path / "cube.nc")
    content = cube.read_bytes()
    for damaged in (content[:-lost] + bytes(lost), content[:-lost], content + bytes(lost)):
        cube.write_bytes(damaged)
        assert is_damaged(cube)
        assert is_damaged(cube, most=10)
    cube.write_bytes(content[:-83])
    assert not is_damaged(cube)
    assert not is_sealed(cube)


@pytest.fixture
def grid(tmp_path):
    """A cube of 2 x 3 cells in a file."""
    cube = xr.Dataset(
        {
            "outcome": (("x", "y"), np.zeros((2, 3), np.int8)),
            "course": (("x", "y", "angle"), np.ones((2, 3, 5)), {"units": "N"}),
        },
        coords={"x": [1.0, 2.0], "y": ("y", [3.0, 2.0, 1.0], {"units": "mm"}), "angle": np.arange(5)},
        attrs={"study": "s"},
    )
    cube.to_netcdf(tmp_path / "grid.nc")
    return tmp_path / "grid.nc"


@pytest.mark.parametrize(
    ("attributes", "outcome", "message"),
    [
        ({"package_versions": "{"}, 0, "package_versions holds no table"),
        ({"package_versions": "[1]"}, 0, "package_versions holds no table"),
        ({"fixed_parameters": 5}, 0, "fixed_parameters holds no table"),
        ({"model_notes": np.arange(3)}, 0, "model_notes holds no text"),
        ({}, 77, "an outcome that does not exist"),
    ],
)
def test_a_file_of_another_program_that_pages_could_not_show_is_refused(grid, tmp_path, attributes, outcome, message):
    """Regression: reports and workbooks of such cubes ended in a traceback, those of the service in an internal error."""
    with xr.open_dataset(grid) as cube:
        cube.attrs |= attributes
        cube["outcome"] = cube["outcome"] + np.int8(outcome)
        cube.to_netcdf(tmp_path / "strange.nc")
    with pytest.raises(CubeError, match=message):
        read_dataset(tmp_path / "strange.nc")


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"role": np.arange(2)}, "course: the attribute role holds no text"),
        ({"units": 1.0}, "course: the attribute units holds no text"),
        ({"flag_values": "0 1", "flag_meanings": "no yes"}, "course: flag_values and flag_meanings do not fit"),
        ({"flag_values": np.arange(3), "flag_meanings": "no yes"}, "course: flag_values and flag_meanings do not fit"),
        ({"flag_values": np.arange(3)}, "course: flag_values and flag_meanings do not fit"),
    ],
)
def test_attributes_of_variables_that_pages_could_not_show_are_refused(grid, tmp_path, attributes, message):
    """Regression: views and tables of such cubes ended in an internal error."""
    with xr.open_dataset(grid) as cube:
        cube["course"].attrs.update(attributes)
        cube.to_netcdf(tmp_path / "strange.nc")
    with pytest.raises(CubeError, match=message):
        read_dataset(tmp_path / "strange.nc")


def test_the_result_of_an_analysis_says_its_kind(grid, tmp_path):
    """Regression: without it, it was taken for a study, whose sentences ended in an internal error."""
    (tmp_path / "analysis").mkdir()
    file = grid.rename(tmp_path / "analysis" / "sobol.nc")
    with pytest.raises(CubeError, match="of which kind of analysis"):
        read_dataset(file)


def test_a_hidden_file_is_no_analysis(tmp_path):
    (tmp_path / "analysis").mkdir()
    for name in ("sobol.nc", ".sobol.nc", ".nc"):
        (tmp_path / "analysis" / name).touch()
    assert analysis_files(tmp_path) == {"sobol": tmp_path / "analysis" / "sobol.nc"}
