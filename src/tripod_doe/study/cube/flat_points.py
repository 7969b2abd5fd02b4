"""The cells of a grid as a list of points, read when they are used: a cube need not fit into memory for it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from tripod_doe.study.cube.slabs import box, slabs

_SLAB_BYTES = 32_000_000


class _FlatCells(BackendArray):
    """A variable over the cells of a grid, the cells along its first dimension in the order of the points."""

    def __init__(self, variable: xr.Variable, depth: int) -> None:
        self._variable, self._grid = variable, variable.shape[:depth]
        self.shape, self.dtype = (math.prod(self._grid), *variable.shape[depth:]), variable.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._at)

    def _at(self, key: tuple[int | slice, ...]) -> NDArray[Any]:
        cells, *own = key
        if not isinstance(cells, slice):
            return np.asarray(self._variable[(*np.unravel_index(cells, self._grid), *own)].values)
        start, stop, step = cells.indices(self.shape[0])
        return self._stretch(start, stop, own)[::step]

    def _stretch(self, start: int, stop: int, own: list[int | slice]) -> NDArray[Any]:
        """Some consecutive cells."""
        own_shape = np.broadcast_to(0, self.shape[1:])[tuple(own)].shape
        lengths = box(self._grid, self.dtype.itemsize * math.prod(self.shape[1:]), _SLAB_BYTES)
        parts = [np.empty((0, *own_shape), self.dtype)]
        for slab in slabs(self._grid, lengths):
            if slab.start < stop and start < slab.stop:
                cells = np.asarray(self._variable[(*slab.place, *own)].values)
                flat = cells.reshape(slab.count, *own_shape)
                parts.append(flat[max(start - slab.start, 0) : stop - slab.start])
        return np.concatenate(parts)


def flat_points(cube: xr.Dataset) -> xr.Dataset:
    """A cube with one dimension ``point`` in place of one for each factor of a grid; variables are read when used."""
    dims = cube["outcome"].dims
    if dims == ("point",):
        return cube
    shape = tuple(cube.sizes[dim] for dim in dims)
    coordinates: dict[Any, xr.Variable] = {"point": xr.Variable("point", np.arange(math.prod(shape), dtype=np.int32))}
    for position, dim in enumerate(dims):
        along = cube[dim].values.reshape([-1 if at == position else 1 for at in range(len(dims))])
        coordinates[dim] = xr.Variable("point", np.broadcast_to(along, shape).ravel(), cube[dim].attrs)
    variables = {name: _flat(variable, dims) for name, variable in cube.variables.items() if name not in dims}
    coordinates |= {name: variables.pop(name) for name in cube.coords if name in variables}
    return xr.Dataset(variables, xr.Coordinates(coordinates, indexes={}), cube.attrs)


def _flat(variable: xr.Variable, dims: tuple[Any, ...]) -> xr.Variable:
    """A variable over the points, or as it is where it has no value for each cell."""
    if variable.dims[: len(dims)] != dims:
        return variable
    cells = indexing.LazilyIndexedArray(_FlatCells(variable, len(dims)))
    return xr.Variable(("point", *variable.dims[len(dims) :]), cells, variable.attrs)
