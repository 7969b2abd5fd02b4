"""Numbers of the points of a cube as a coordinate that is made where it is used: a cube may have very many points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing


class _Numbers(BackendArray):
    """Positions of the cells of an array in their order."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape, self.dtype = shape, np.dtype(np.int32)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._at)

    def _at(self, key: tuple[Any, ...]) -> NDArray[np.int32]:
        numbers: Any = np.int64(0)
        for axis, (chosen, length) in enumerate(zip(key, self.shape, strict=True)):
            along = np.arange(*chosen.indices(length)) if isinstance(chosen, slice) else chosen
            numbers = np.add.outer(numbers, np.multiply(along, math.prod(self.shape[axis + 1 :])))
        return np.asarray(numbers, np.int32)


def point_numbers(dims: tuple[str, ...], shape: tuple[int, ...]) -> xr.Variable:
    """The number of each point or cell, along dimensions of these lengths."""
    return xr.Variable(dims, indexing.LazilyIndexedArray(_Numbers(shape)), {"long_name": "number of the point or cell"})
