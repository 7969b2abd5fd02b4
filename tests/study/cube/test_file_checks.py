"""Which netCDF files are read: undamaged ones, and those that belong to the place where they lie."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.study.cube.file_digest import is_damaged, is_sealed
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
