"""The tool that compares the results of two versions finds what differs."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from equal_cubes import compare, compare_folders

CUBE = xr.Dataset(
    {
        "thrust": (("point", "order"), np.array([[1.0, 2.0], [np.nan, 4.0]])),
        "outcome": ("point", np.array([0, 1], np.int8)),
        "outcome_detail": ("point", np.array(["", "did not settle"])),
        "cpu_seconds": ("point", [0.1, 0.2]),
    },
    {"order": [2, 3]},
)


def changed(name, values):
    return CUBE.assign({name: (CUBE[name].dims, np.asarray(values))})


def test_equal_cubes_have_no_difference():
    assert not list(compare(CUBE, changed("cpu_seconds", [0.3, 0.4])))


@pytest.mark.parametrize(
    ("name", "values"),
    [("thrust", [[1.0, 2.0], [3.0, 4.0]]), ("thrust", [[1.0, np.nextafter(2, 3)], [np.nan, 4.0]]), ("outcome", [0, 0])],
    ids=["a number in place of a missing one", "the last bit", "a flag"],
)
def test_a_value_that_differs_counts(name, values):
    (difference,) = compare(CUBE, changed(name, values))
    assert difference.counts
    assert difference.variable == name


def test_a_better_sentence_is_reported_and_does_not_count():
    (difference,) = compare(CUBE, changed("outcome_detail", ["", "did not converge"]))
    assert not difference.counts
    assert "converge" in difference.what


def test_a_variable_that_is_gone_counts_and_one_that_is_new_does_not():
    assert [found.counts for found in compare(CUBE, CUBE.drop_vars("outcome"))] == [True]
    assert [found.counts for found in compare(CUBE.drop_vars("outcome"), CUBE)] == [False]


def test_files_are_found_by_their_place_in_both_folders(tmp_path):
    for side in ("old", "new"):
        (tmp_path / side / "study").mkdir(parents=True)
    CUBE.to_netcdf(tmp_path / "old" / "study" / "cube.nc")
    changed("thrust", [[1.0, 2.0 + 1e-12], [np.nan, 4.0]]).to_netcdf(tmp_path / "new" / "study" / "cube.nc")
    files, (difference,) = compare_folders(tmp_path / "old", tmp_path / "new", relative=1e-9)
    assert files == ["study/cube.nc"]
    assert not difference.counts
