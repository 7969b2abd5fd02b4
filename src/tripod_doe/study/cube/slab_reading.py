"""Reductions and selections of a variable that may be larger than the memory, read in slabs by Dask.

Slabs are read one after the other, since netCDF4 has one lock, and never on the cluster that a run may have open.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.study.cube.slabs import box

_SLAB_BYTES = 32_000_000


def read_positions(variable: xr.Variable, positions: Mapping[str, IntArray]) -> NDArray[Any]:
    """Values at ascending positions along some dimensions: a file gives stretches faster than single positions."""
    return _computed(_in_slabs(variable).isel({dim: at for dim, at in positions.items() if dim in variable.dims}))


def all_finite(variable: xr.Variable) -> NDArray[np.bool_]:
    """Whether all values are finite, along the first dimension."""
    return _computed(np.isfinite(_in_slabs(variable)).all(variable.dims[1:]))


def any_finite(variable: xr.Variable) -> NDArray[np.bool_]:
    """Whether any value is finite, along the first dimension."""
    return _computed(np.isfinite(_in_slabs(variable)).any(variable.dims[1:]))


def largest_magnitude(variable: xr.Variable) -> float:
    """The largest magnitude; NaN where there is no number."""
    return float(_computed(np.abs(_in_slabs(variable)).max())) if variable.size else np.nan


def _in_slabs(variable: xr.Variable) -> Any:
    """A variable of a file as a Dask array of slabs; one in memory as it is."""
    lengths = box(variable.shape, variable.dtype.itemsize, _SLAB_BYTES)
    plain = variable.to_base_variable()
    return plain if plain._in_memory else plain.chunk(dict(zip(plain.dims, lengths, strict=True)))


def _computed(variable: xr.Variable) -> NDArray[Any]:
    whole = variable if variable._in_memory else variable.compute(scheduler="synchronous")
    return np.asarray(whole.values)
