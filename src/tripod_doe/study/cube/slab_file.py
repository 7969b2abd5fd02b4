"""Cubes written to netCDF files slab by slab, so that neither a cube nor all its results are ever in memory.

Variables are stored in chunks that are parts of slabs, and compressed if that saves enough. Texts of points are stored
as numbers of rows in a table of all different texts, which `lazy_dataset` turns back.

Why not `to_netcdf` of Dask arrays: for 1 GB it takes 17 CPU-s instead of 10, two to three times the memory (245 to 331
MB instead of 112), and computes every slab again for the second file.
"""

import math
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import NetCDF4DataStore

from tripod_doe.study.cube.netcdf import CHECKSUM, CHUNK_BYTES, TEXT_TABLE, opened_store
from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK
from tripod_doe.study.cube.slabs import Slab, box
from tripod_doe.study.designs import Points

_COURSE_BYTES = 2000  # of a point, above which a chunk has a part of them
_SAMPLE_BYTES, _STRETCHES = 64_000, 16  # of the first slab, to decide whether compression pays
_PAYS = 0.5  # compress if the compressed part of the bytes is at most this


class CubeFile:
    """A cube that is being written, by one thread.

    Args:
        store: xarray's store of the new file.
        levels: Coordinates along the dimensions of a grid; none for a list of points.
    """

    def __init__(
        self, store: NetCDF4DataStore, points: Points, lengths: tuple[int, ...], levels: Mapping[str, xr.Variable]
    ) -> None:
        self._store, self._points, self._lengths, self._levels = store, points, lengths, levels
        self._missing: dict[str, float | int] = {}  # of each variable along the points: its value where there is none
        self._written: list[Slab] = []
        self._texts: dict[str, dict[str, int]] = {}

    def write(self, slab: Slab, part: xr.Dataset) -> None:
        """Write the next slab.

        Args:
            part: Its points, along ``point``; a variable that only other slabs have is missing there.
        """
        if self._points.is_grid:
            part = part.drop_vars(["point", *self._points.levels])
        else:
            part = part.assign_coords(point=part["point"].copy(data=part["point"].values + np.int32(slab.start)))
        coded = {name: self._coded(name, variable) for name, variable in part.variables.items()}
        along = {name: variable for name, variable in coded.items() if variable.dims[:1] == ("point",)}
        if new := [name for name in along if name not in self._missing]:
            self._define(part, coded, new, slab)
        for name, missing in self._missing.items():
            if name in along:
                self._put(name, slab, along[name].values.reshape(*slab.shape, *along[name].shape[1:]))
            elif not isinstance(missing, float):
                self._put(name, slab, missing)
        self._written.append(slab)

    def finish(self, attributes: Mapping[str, Any]) -> None:
        """Write the tables of texts and the attributes of the cube."""
        tables = {
            f"{name}_text": xr.Variable(
                f"{name}_row",
                np.array(list(table), object),
                {"long_name": f"texts to which the numbers of {name} refer"},
            )
            for name, table in self._texts.items()
        }
        with NETCDF_LOCK:
            encoding: dict[Any, dict[str, Any]] = dict.fromkeys(tables, CHECKSUM)
        xr.Dataset(tables, attrs=attributes).dump_to_store(self._store, encoding=encoding)

    def _coded(self, name: Any, variable: xr.Variable) -> xr.Variable:
        """A variable without texts along the points."""
        if variable.dtype.kind not in "OU" or variable.dims != ("point",):
            return variable
        table = self._texts.setdefault(name, {"": 0})
        own, texts = pandas.factorize(variable.values)  # -1 where there is none
        rows = np.array([*(table.setdefault(str(text), len(table)) for text in texts), 0], np.int32)
        codes = rows[own]
        return xr.Variable(variable.dims, codes, variable.attrs | {TEXT_TABLE: f"{name}_text"})

    def _define(self, part: xr.Dataset, coded: Mapping[Any, xr.Variable], new: list[Any], slab: Slab) -> None:
        """Add variables to the file; slabs before have no value of them."""
        import dask.array

        variables: dict[Any, xr.Variable] = {}
        encoding: dict[Any, dict[str, Any]] = {name: {"_FillValue": None} | CHECKSUM for name in self._levels}
        for name, variable in coded.items():
            if variable.dims[:1] != ("point",):
                variables[name] = variable
                continue
            dims, shape = (*self._points.dims, *variable.dims[1:]), (*self._points.shape, *variable.shape[1:])
            # an array that is never computed: xarray defines its variable, and the slabs are its values
            variables[name] = xr.Variable(
                dims, dask.array.empty(shape, dtype=variable.dtype, chunks=-1), variable.attrs
            )
            encoding[name] = self._encoding(variable, name in part.coords)
        coords = xr.Coordinates({**self._levels, **{name: variables[name] for name in part.coords}}, indexes={})
        added = xr.Dataset({name: variables[name] for name in new if name not in coords}, coords)
        with NETCDF_LOCK:
            added.dump_to_store(self._store, encoding={name: encoding.get(name, CHECKSUM) for name in added.variables})
            for name in new:
                self._store.ds.variables[name].set_var_chunk_cache(size=CHUNK_BYTES)  # slabs are whole chunks
        for name in new:
            self._missing[name] = _missing(coded[name])
            if not isinstance(self._missing[name], float):
                for earlier in self._written:
                    self._put(name, earlier, self._missing[name])

    def _put(self, name: Any, slab: Slab, values: NDArray[Any] | float) -> None:
        with NETCDF_LOCK:
            self._store.ds.variables[name][slab.place] = values

    def _encoding(self, variable: xr.Variable, is_coordinate: bool) -> dict[str, Any]:
        """How a variable is stored: its chunks, and compression if it saves enough in a sample of its values."""
        encoding: dict[str, Any] = {"chunksizes": self._chunk(variable)} | CHECKSUM
        if variable.dtype.kind == "f":
            encoding["_FillValue"] = None if is_coordinate else np.nan
        if _shrinks(variable.values):
            encoding |= {"zlib": True, "complevel": 1, "shuffle": True}
        return encoding

    def _chunk(self, variable: xr.Variable) -> tuple[int, ...]:
        """The chunk of a variable; of a course all points of a slab and some labels, as analyses read it."""
        size, components = variable.dtype.itemsize, variable.shape[1:]
        if size * math.prod(components) > _COURSE_BYTES:
            components = box(components, size * math.prod(self._lengths), CHUNK_BYTES)
        points = box(self._points.shape, size * math.prod(components), CHUNK_BYTES)
        return (*map(min, points, self._lengths), *components)


def _missing(variable: xr.Variable) -> float | int:
    """The value that stands for a missing one: NaN, the first flag, or the empty text."""
    if variable.dtype.kind == "f":
        return math.nan
    return int(variable.attrs.get("flag_values", [0])[0])


def _shrinks(values: NDArray[Any]) -> bool:
    """Whether compression pays, with the bytes of a number sorted by their place in it as HDF5 does.

    The sample has stretches from all over the values, since the first point may have failed and be empty.
    """
    flat = np.ascontiguousarray(values).ravel()
    length = min(_SAMPLE_BYTES // _STRETCHES // values.dtype.itemsize, flat.size)
    starts = np.unique(np.linspace(0, flat.size - length, _STRETCHES).astype(np.int64))
    sample = np.concatenate([flat[start : start + length] for start in starts])
    shuffled = sample.view(np.uint8).reshape(-1, values.dtype.itemsize).T.tobytes()
    return len(zlib.compress(shuffled, 1)) < _PAYS * len(shuffled)


@contextmanager
def cube_file(
    path: Path, points: Points, lengths: tuple[int, ...], levels: Mapping[str, xr.Variable]
) -> Iterator[CubeFile]:
    """Make a cube file that replaces an older one when it is complete.

    Raises:
        StorageError: If it cannot be written; the old file stays.
    """
    with opened_store(path) as store:
        yield CubeFile(store, points, lengths, levels)
