"""Kernels read the fields of a bundle that they get as one pointer."""

from __future__ import annotations

import gc
import pickle
from dataclasses import dataclass

import numba
import numpy as np
import pytest

from tripod_doe.mechanics.compilation.by_reference import ByReference

ROW = np.dtype([("number", np.int64), ("size", np.float64)], align=True)


@dataclass(frozen=True, eq=False)
class Inner(ByReference):
    count: int
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Bundle(ByReference):
    vector: np.ndarray
    inner: Inner
    rows: np.ndarray
    cube: np.ndarray


def bundle():
    rows = np.array([(3, 0.5), (4, 0.25)], ROW)
    return Bundle(np.array([1.0, 2.0]), Inner(7, np.arange(6.0).reshape(2, 3)), rows, np.zeros((2, 3, 4)))


@numba.njit
def read(bundle):
    inner = bundle.inner
    return (
        bundle.vector[1],
        inner.count,
        inner.values[1, 2],
        bundle.rows[1].size,
        bundle.cube.shape[2],
        inner.values.size,
    )


@numba.njit
def write(bundle, value):
    bundle.cube[1, 2, 3] = value
    bundle.rows[0].number = 9


@numba.njit
def sum_of_slices(bundle):
    total = 0.0
    for plane in range(bundle.cube.shape[0]):
        for row in range(bundle.cube.shape[1]):
            numbers = bundle.cube[plane, row]
            for value in numbers[1:]:
                total += value
    return total


EXPECTED = (2.0, 7, 5.0, 0.25, 4, 6)


def test_every_kind_of_field_is_read():
    """Exact: vectors, tables of records, arrays of several dimensions, integers, and a bundle within the bundle."""
    assert read(bundle()) == EXPECTED


def test_kernels_write_into_the_arrays_of_the_bundle():
    one = bundle()
    write(one, 2.5)
    assert one.cube[1, 2, 3] == 2.5
    assert one.rows["number"][0] == 9


def test_bundles_of_one_kind_share_machine_code_and_not_their_memory():
    first, second = bundle(), bundle()
    write(first, 1.0)
    write(second, 2.0)
    assert (first.cube[1, 2, 3], second.cube[1, 2, 3]) == (1.0, 2.0)
    assert len(write.signatures) == 1


def test_a_bundle_keeps_its_arrays_alive():
    """Its words hold addresses: arrays that only the bundle knows must not be freed."""
    one = bundle()
    gc.collect()
    _ = [np.full(2, -1.0) for _ in range(1000)]
    assert read(one) == EXPECTED


def test_a_copy_in_another_process_lays_out_its_own_memory():
    one = bundle()
    copy = pickle.loads(pickle.dumps(one))
    write(one, 3.0)
    assert read(copy) == EXPECTED
    assert copy.cube[1, 2, 3] == 0.0


def test_an_array_that_is_not_contiguous_is_refused_by_name():
    with pytest.raises(ValueError, match="values: not contiguous"):
        Inner(1, np.zeros((4, 4))[:, ::2])


def test_slices_have_no_owner_to_release():
    """Calls that release one took a quarter of the price of a run: none is left in the machine code."""
    assert sum_of_slices(bundle()) == 0.0
    for code in sum_of_slices.inspect_llvm().values():
        body = code[code.index("define") : code.index("\n}\n")]
        assert "NRT_decref" not in body
