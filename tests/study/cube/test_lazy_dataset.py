"""A grid as a list of points, read when it is used."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.errors import CubeError
from tripod_doe.study.cube import lazy_dataset as module
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.cube.lazy_dataset import flat_points


@pytest.fixture
def grid(tmp_path):
    """A cube of 3 x 4 x 2 cells in a file, of which at most five cells are read together."""
    random = np.random.default_rng(2)
    cells = ("x", "y", "kind")
    cube = xr.Dataset(
        {
            "outcome": (cells, random.integers(3, size=(3, 4, 2)).astype(np.int8)),
            "course": ((*cells, "angle"), random.random((3, 4, 2, 5)), {"units": "N"}),
            "constant": ("angle", np.arange(5.0)),
        },
        coords={
            "x": [1.0, 2.0, 5.0],
            "y": ("y", [4.0, 3.0, 2.0, 1.0], {"units": "mm"}),
            "kind": ["a", "b"],
            "angle": np.arange(5),
        },
        attrs={"study": "s"},
    )
    cube.to_netcdf(tmp_path / "grid.nc")
    return tmp_path / "grid.nc"


def test_the_cells_of_a_grid_are_points_in_their_order(grid, monkeypatch):
    """Exact: as xarray stacks them; whole, in parts, backwards and one by one."""
    monkeypatch.setattr(module, "_SLAB_BYTES", 5 * 40)
    with xr.open_dataset(grid, cache=False) as cube:
        flat = flat_points(cube)
        stacked = cube.load().stack(point=cube["outcome"].dims).transpose("point", ...)
        assert not flat["course"].variable._in_memory
        for name in ("outcome", "course", "x", "y", "kind"):
            assert flat[name].dims == stacked[name].dims
            assert np.array_equal(flat[name].values, stacked[name].values)
        for rows in (slice(3, 17), slice(None, None, 5), slice(20, 4, -3), [7, 2, 23], 11, slice(4, 4)):
            assert np.array_equal(flat["course"][rows].values, stacked["course"].values[rows])
        assert np.array_equal(flat["course"][3:9, 1:3].values, stacked["course"].values[3:9, 1:3])
    assert flat["constant"].dims == ("angle",)
    assert flat.attrs == cube.attrs
    assert [flat["course"].attrs, flat["y"].attrs] == [{"units": "N"}, {"units": "mm"}]


def test_a_list_of_points_stays_as_it_is():
    cube = xr.Dataset({"outcome": ("point", np.zeros(3, np.int8))})
    assert flat_points(cube) is cube


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
        module.read_dataset(tmp_path / "strange.nc")


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
        module.read_dataset(tmp_path / "strange.nc")


def test_days_are_read_as_numbers(grid, tmp_path):
    """Regression: xarray made dates of a unit that begins like one, which no chart can show."""
    with xr.open_dataset(grid) as cube:
        cube["course"].attrs["units"] = "days since 1970-01-01"
        cube.to_netcdf(tmp_path / "strange.nc")
    assert module.read_dataset(tmp_path / "strange.nc")["course"].dtype == float


def test_the_result_of_an_analysis_says_its_kind(grid, tmp_path):
    """Regression: without it, it was taken for a study, whose sentences ended in an internal error."""
    (tmp_path / "analysis").mkdir()
    file = grid.rename(tmp_path / "analysis" / "sobol.nc")
    with pytest.raises(CubeError, match="of which kind of analysis"):
        module.read_dataset(file)


def test_a_hidden_file_is_no_analysis(tmp_path):
    (tmp_path / "analysis").mkdir()
    for name in ("sobol.nc", ".sobol.nc", ".nc"):
        (tmp_path / "analysis" / name).touch()
    assert analysis_files(tmp_path) == {"sobol": tmp_path / "analysis" / "sobol.nc"}
