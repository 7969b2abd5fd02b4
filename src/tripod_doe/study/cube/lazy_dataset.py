"""Cubes opened lazily: variables are read at each use, so that a cube may be larger than the memory.

Texts of points are stored as numbers of rows in a table of all different texts, and looked up at once; the cells of a
grid become a list of points on request.
"""

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray, NetCDF4DataStore
from xarray.backends.netCDF4_ import NetCDF4ArrayWrapper
from xarray.core import indexing

from tripod_doe.study.cube.file_checks import refuse_unfit, refuse_unusable
from tripod_doe.study.cube.netcdf import TEXT_TABLE, reading, shared_file
from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK
from tripod_doe.study.memory import refuse_too_much_memory

_COPIES = 2


def read_dataset(path: Path) -> xr.Dataset:
    """Read a netCDF file into memory.

    Raises:
        CubeError: If the file is missing, damaged or of another study than its directory.
        InputError: If its values, and copies of them while they are used, do not fit into the free memory.
    """
    refuse_unfit(path, whole=True)
    with lazy_dataset(path) as stored, reading(path):
        in_parts = "ask for parts of it, by a query or with chunks"
        refuse_too_much_memory(_COPIES * stored.nbytes, f"{path}: a reader of all its values", in_parts)
        return stored.load()


class _Array(NetCDF4ArrayWrapper):
    """A stored variable; errors of a damaged one name its file, also while it is used in parts."""

    def _getitem(self, key: Any) -> Any:
        with reading(Path(self.datastore._filename)):
            return super()._getitem(key)  # type: ignore[no-untyped-call]


class _Store(NetCDF4DataStore):
    """A netCDF file for xarray."""

    in_chunks = True  # else texts stay objects: xarray would import Dask to find their lengths

    def open_store_variable(self, name: str, var: Any) -> xr.Variable:
        """A variable, which is read when it is used."""
        stored = super().open_store_variable(name, var)
        data = indexing.LazilyIndexedArray(_Array(name, self))  # type: ignore[no-untyped-call]
        encoding = {key: value for key, value in stored.encoding.items() if self.in_chunks or value is not str}
        return xr.Variable(stored.dims, data, stored.attrs, encoding)


def lazy_dataset(path: Path, chunks: int | str | Mapping[str, int] | None = None) -> xr.Dataset:
    """A netCDF file whose variables are read anew at each use; open until the dataset is closed.

    Args:
        chunks: As in `xarray.open_dataset`; None leaves Dask out.

    Raises:
        CubeError: If the file is missing, damaged or of another study than its directory.
    """
    refuse_unfit(path)
    with reading(path):
        # not while values are read: Dask's threads, which take this lock, would wait for this thread
        with NETCDF_LOCK, warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The specified chunks separate")  # they are the caller's wish
            store = _Store(shared_file(path), mode="r", lock=NETCDF_LOCK)  # type: ignore[no-untyped-call]
            store.in_chunks = chunks is not None
            stored = xr.open_dataset(
                store, decode_times=False, chunks=chunks, cache=False, create_default_indexes=False
            )
        refuse_unusable(path, stored)
        read = _with_texts(stored)
        for dim in stored.dims:
            if dim in stored.coords:
                read = read.set_xindex(str(dim))
        read.set_close(stored.close)
        return read


class _FlatCells(BackendArray):
    """A variable over the cells of a grid, the cells along its first dimension in the order of the points."""

    def __init__(self, variable: xr.Variable, depth: int) -> None:
        self._variable, self._grid = variable, variable.shape[:depth]
        self.shape, self.dtype = (math.prod(self._grid), *variable.shape[depth:]), variable.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.BASIC, self._at)

    def _at(self, key: tuple[int | slice, ...]) -> NDArray[Any]:
        cells, *own = key
        start, stop, step = cells.indices(self.shape[0]) if isinstance(cells, slice) else (cells, cells + 1, 1)
        row, depth = math.prod(self._grid[1:]), len(self._grid)
        first = start // row
        values = np.asarray(self._variable[(slice(first, -(-stop // row)), *(depth - 1) * [slice(None)], *own)].values)
        flat = values.reshape(math.prod(values.shape[:depth]), *values.shape[depth:])
        chosen = flat[start - first * row : stop - first * row : step]
        return chosen if isinstance(cells, slice) else chosen[0]


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
    """A variable over the points; unchanged if it has no value for each cell."""
    if variable.dims[: len(dims)] != dims:
        return variable
    cells = indexing.LazilyIndexedArray(_FlatCells(variable, len(dims)))
    return xr.Variable(("point", *variable.dims[len(dims) :]), cells, variable.attrs)


def _with_texts(stored: xr.Dataset) -> xr.Dataset:
    """A cube as it was stored, with texts in place of their numbers."""
    numbers = {name: variable for name, variable in stored.variables.items() if TEXT_TABLE in variable.attrs}
    tables = {name: str(variable.attrs[TEXT_TABLE]) for name, variable in numbers.items()}
    texts = {}
    for name, variable in numbers.items():
        table = stored.variables[tables[name]].values.astype(object)
        attrs = {key: value for key, value in variable.attrs.items() if key != TEXT_TABLE}
        texts[name] = xr.Variable(variable.dims, table[variable.values], attrs)
    coordinates = {name: variable for name, variable in texts.items() if name in stored.coords}
    return stored.assign(texts).drop_vars(set(tables.values())).set_coords(list(coordinates))
