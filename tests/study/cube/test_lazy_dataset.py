"""A grid as a list of points, read when it is used."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.study.cube import lazy_dataset as module
from tripod_doe.study.cube.lazy_dataset import flat_points


@pytest.fixture
def grid(tmp_path):
    """A cube of 3 x 4 x 2 cells in a file."""
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


def test_the_cells_of_a_grid_are_points_in_their_order(grid):
    """Exact: as xarray stacks them; whole, in parts, backwards and one by one."""
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


def test_days_are_read_as_numbers(grid, tmp_path):
    """Regression: xarray made dates of a unit that begins like one, which no chart can show."""
    with xr.open_dataset(grid) as cube:
        cube["course"].attrs["units"] = "days since 1970-01-01"
        cube.to_netcdf(tmp_path / "strange.nc")
    assert module.read_dataset(tmp_path / "strange.nc")["course"].dtype == float
