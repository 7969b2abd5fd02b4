"""Which netCDF files are read: undamaged ones, and those that belong to the place where they lie."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.study.cube.file_checks import DIGEST, STEP, refuse_unfit
from tripod_doe.study.cube.file_digest import is_damaged, is_sealed, stored_digest
from tripod_doe.study.cube.netcdf import write_dataset


def written(path, value=1.0):
    path.parent.mkdir(exist_ok=True)
    write_dataset(xr.Dataset({"y": ("x", np.full(40, value))}, {"x": np.arange(40.0)}), path)
    return path


def test_the_cube_of_another_step_is_not_that_of_this_one(tmp_path):
    """A copy of it was taken for the step's own result, in silence."""
    one, other = written(tmp_path / "one" / "cube.nc"), written(tmp_path / "other" / "cube.nc", 2.0)
    (one.parent / STEP).write_text(json.dumps({"hash": "h", DIGEST: stored_digest(one)}))
    refuse_unfit(one)
    one.write_bytes(other.read_bytes())
    with pytest.raises(td.CubeError, match="not the result of this step"):
        td.open_cube(one.parent)


@pytest.mark.parametrize("record", ["{}", "[]", "x", "[" * 100_000, '{"cube_digest": null}'])
def test_a_record_without_a_digest_binds_no_cube(tmp_path, record):
    cube = written(tmp_path / "one" / "cube.nc")
    (cube.parent / STEP).write_text(record)
    refuse_unfit(cube)


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
