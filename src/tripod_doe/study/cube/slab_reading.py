"""What is asked of a variable that may be larger than the memory, read in slabs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.study.cube.slabs import Slab, box, slabs

_SLAB_BYTES = 32_000_000


def read_positions(variable: xr.Variable, positions: Mapping[str, IntArray]) -> NDArray[Any]:
    """Values at ascending positions along some dimensions: a file gives stretches faster than single positions."""
    if not positions.keys() & set(variable.dims):
        return np.asarray(variable.values)
    chosen = [positions.get(str(dim), np.arange(size)) for dim, size in variable.sizes.items()]
    found = np.empty([own.size for own in chosen], variable.dtype)
    for slab in _slabs(variable):
        inside, target = [], []
        for own, place in zip(chosen, slab.place, strict=True):
            first, last = np.searchsorted(own, (place.start, place.stop))
            target.append(slice(int(first), int(last)))
            inside.append(own[first:last] - place.start)
        if all(own.size for own in inside):
            found[tuple(target)] = variable[slab.place].values[np.ix_(*inside)]
    return found


def all_finite(variable: xr.Variable) -> NDArray[np.bool_]:
    """Where, along the first dimension, all values are finite."""
    finite = np.ones(variable.shape[0], bool)
    for place, own in _finite(variable):
        finite[place] &= own.all(axis=1)
    return finite


def any_finite(variable: xr.Variable) -> NDArray[np.bool_]:
    """Where, along the first dimension, any value is finite."""
    finite = np.zeros(variable.shape[0], bool)
    for place, own in _finite(variable):
        finite[place] |= own.any(axis=1)
    return finite


def _finite(variable: xr.Variable) -> Iterator[tuple[slice, NDArray[np.bool_]]]:
    """Places along the first dimension, and which values there are finite, shape (place, other dimensions)."""
    for slab in _slabs(variable):
        own = np.isfinite(variable[slab.place].values)
        yield slab.place[0], own.reshape(own.shape[0], -1)


def largest_magnitude(variable: xr.Variable) -> float:
    """The largest magnitude; NaN where there is no number."""
    largest = np.nan
    for slab in _slabs(variable):
        own = np.abs(variable[slab.place].values)
        largest = np.fmax(largest, np.fmax.reduce(own, axis=None, initial=np.nan))
    return float(largest)


def _slabs(variable: xr.Variable) -> Iterator[Slab]:
    return slabs(variable.shape, box(variable.shape, variable.dtype.itemsize, _SLAB_BYTES))
