"""Cubes as netCDF files: written as a whole, opened once per process, checked against their checksums."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tripod_doe.errors import CubeError, option
from tripod_doe.files.atomic_files import replace_file
from tripod_doe.files.checksum_list import listed_file
from tripod_doe.number_text import size
from tripod_doe.study.cube.file_digest import seal
from tripod_doe.study.cube.file_links import refuse_outside
from tripod_doe.study.cube.netcdf_lock import NETCDF_LOCK
from tripod_doe.study.cube.slabs import box

if TYPE_CHECKING:  # a query reads cubes without xarray
    import netCDF4
    import xarray as xr
    from xarray.backends import CachingFileManager, NetCDF4DataStore

POINT_ATTRIBUTES = {"long_name": "number of the point in the design", "units": "1"}
"""Attributes of the coordinate ``point`` of a cube, which counts from 0."""

TEXT_TABLE = "text_table"
"""Attribute of a variable of numbers: the name of the variable with the texts to which they refer."""

CHUNK_BYTES = 2_000_000
"""Bytes of a chunk of a variable."""

_DENSEST, _MISSING = 1100, 4_000_000_000
"""Most bytes of values in a byte of a file (deflate packs 1,032), and most bytes of missing values, which take none."""

_LARGEST_CHUNK, _TEXTS = 128_000_000, 1_000_000_000
"""Most bytes of a chunk, which is unpacked as a whole even for one value, and of texts that are read at once."""

CHECKSUM = {"fletcher32": True, "contiguous": False}
"""Encoding of variables with a checksum of each chunk, which HDF5 checks when it reads."""

_PACKING = frozenset(("scale_factor", "add_offset"))
"""Attributes of a variable whose values are packed, numbers by CF."""

_RESULTS = re.compile(r" \(results ([0-9]{1,10})\)$")

_UNREADABLE = (OSError, RuntimeError, ValueError, KeyError, AttributeError, IndexError, TypeError)
"""Errors of netCDF4 and xarray for a damaged file."""


def stamp_history(dataset: xr.Dataset, action: str, results: int = 0) -> xr.Dataset:
    """Add a line with time and action to the history of a dataset.

    Args:
        results: The number of the results of its directory, which the line names; 0 for none. It stands there since the
            other attributes of the same study are the same in each directory.
    """
    line = f"{datetime.now(UTC).isoformat(timespec='seconds')} {action}" + (f" (results {results})" if results else "")
    earlier = dataset.attrs.get("history")
    return dataset.assign_attrs(history=f"{line}\n{earlier}" if earlier else line)


def results_in_history(history: object) -> int:
    """The number of the results that the last line of a history names, which is its first; 0 if it names none."""
    match = _RESULTS.search(str(history).partition("\n")[0])
    return int(match[1]) if match else 0


def write_dataset(dataset: xr.Dataset, path: Path, listed: bool = False) -> None:
    """Replace a netCDF file as a whole; a kill leaves the old one or the new one.

    Args:
        listed: Whether its checksum is written into the list of its folder.

    Raises:
        StorageError: If it cannot be written; the old file stays.
    """
    encoding = {name: _encoding(variable, name in dataset.coords) for name, variable in dataset.variables.items()}
    with NETCDF_LOCK, opened_store(path, listed) as store:
        dataset.dump_to_store(store, encoding=encoding)


def _encoding(variable: xr.Variable, is_coordinate: bool) -> dict[str, Any]:
    """How a variable is stored: with checksums of its chunks, and NaN for missing values."""
    encoding: dict[str, Any] = {}
    if variable.dtype.kind == "f":
        encoding["_FillValue"] = None if is_coordinate else np.nan
    if variable.size and variable.dims:
        encoding |= {"chunksizes": box(variable.shape, variable.dtype.itemsize, CHUNK_BYTES)} | CHECKSUM
    return encoding


@contextmanager
def opened_store(path: Path, listed: bool = False) -> Iterator[NetCDF4DataStore]:
    """Give a store to write a netCDF file, which replaces an older file at the end of the block.

    The writing thread must hold the netCDF4 lock while it writes.

    Args:
        listed: As for `write_dataset`.

    Raises:
        StorageError: If it cannot be written; the old file stays.
        CubeError: If netCDF would write another file.
    """
    from xarray.backends import NetCDF4DataStore

    refuse_backslash(path)
    with (listed_file if listed else replace_file)(path) as fresh:
        # as `to_netcdf` does, which would import dask.distributed to ask which lock it needs
        with NETCDF_LOCK:
            store = NetCDF4DataStore.open(  # type: ignore[no-untyped-call]
                _own_name(fresh), mode="w", format="NETCDF4", lock=NETCDF_LOCK
            )
        try:
            yield store
        finally:
            with NETCDF_LOCK:
                store.close()
        seal(fresh)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn errors of reading a file into a `CubeError`; CubeError if the file is missing or damaged."""
    if not path.exists():
        raise CubeError(f"{path}: there is no such file")
    try:
        yield
    except _UNREADABLE as error:
        raise CubeError(f"{path}: not a readable cube ({error}); {remedy(path)}") from error


@contextmanager
def opened_file(path: Path) -> Iterator[netCDF4.Dataset]:
    """Open a netCDF file to read it without xarray, with the lock held."""
    with NETCDF_LOCK:
        if "xarray.backends" in sys.modules:  # else nothing here can have it open
            with shared_file(path).acquire_context() as stored:
                yield stored
        else:
            with dataset_of(path) as stored:
                yield stored


def dataset_of(path: str | Path, mode: Literal["r"] = "r") -> netCDF4.Dataset:
    """Open a netCDF file for any reader; the caller holds the lock.

    Raises:
        CubeError: If HDF5 would read other files for it, it announces far more than it can hold (values, a chunk,
            or texts that share their letters), or a variable is packed by a text.
    """
    import netCDF4

    name = _own_name(path)
    refuse_outside(path)
    stored = netCDF4.Dataset(name, mode)
    wrong = ""
    if excess := _excess(stored, os.path.getsize(path)):
        wrong = f"{excess}, its end is lost, or it was made to fill the memory of its reader"
    elif scaled := [each.name for each in _all_variables(stored) if _is_scaled_by_text(each)]:
        wrong = f"{scaled[0]} is packed by a text in place of a number: another program wrote it"
    if wrong:
        stored.close()
        raise CubeError(f"{path}: {wrong}")
    return stored


def _is_scaled_by_text(variable: netCDF4.Variable[Any]) -> bool:
    """Whether the numbers by which a variable is packed are none."""
    known = set(variable.ncattrs())
    return any(isinstance(variable.getncattr(name), str | list) for name in _PACKING & known)


def _own_name(path: str | Path) -> str:
    r"""The name by which netCDF opens this very file: it drops white space at the front of a name, and reads \ as /.

    Raises:
        CubeError: If there is none.
    """
    refuse_backslash(path)
    return os.path.join(".", path)


def refuse_backslash(path: str | Path) -> None:
    r"""Raise a `CubeError` if a path has a \, for which netCDF takes a /: it would read or write another file."""
    if "\\" in str(path):
        raise CubeError(f"{path}: netCDF files have no name with a \\, which netCDF takes for a /; rename it")


def _excess(stored: netCDF4.Dataset, own: int) -> str:
    """What a file of this size announces beyond what it can hold, in words."""
    announced, chunk = announced_bytes(stored), _largest_chunk(stored)
    if announced > _MISSING + _DENSEST * own:
        return f"announces {size(announced)} of values in a file of {size(own)}: nearly all are missing"
    if chunk > _LARGEST_CHUNK:
        return f"has a chunk of {size(chunk)}; at most {size(_LARGEST_CHUNK)} are read: another program wrote it"
    texts = [variable for variable in _all_variables(stored) if variable.dtype is str and variable.ndim]
    if any(_has_more_letters(variable, own) for variable in texts):
        return f"states more text than fits in a file of {size(own)}: another program wrote it"
    return ""


def _all_variables(group: netCDF4.Dataset | netCDF4.Group) -> Iterator[netCDF4.Variable[Any]]:
    yield from group.variables.values()
    for inner in group.groups.values():
        yield from _all_variables(inner)


def _largest_chunk(stored: netCDF4.Dataset) -> int:
    chunks = ((variable.chunking(), _width(variable)) for variable in _all_variables(stored))
    return max((math.prod(chunk) * width for chunk, width in chunks if isinstance(chunk, list)), default=0)


def _has_more_letters(texts: netCDF4.Variable[Any], own: int) -> bool:
    """Whether texts are longer than their file, in which each has letters of its own."""
    rows, row = texts.shape[0], math.prod(texts.shape[1:])
    if rows * row * own <= _TEXTS:  # harmless even if each were as long as the file
        return False
    step, letters = max(1, _TEXTS // max(1, row * own)), 0
    for start in range(0, rows, step):
        letters += sum(map(len, np.ravel(texts[start : start + step])))
        if letters > own:
            return True
    return False


def announced_bytes(stored: netCDF4.Dataset | netCDF4.Group) -> int:
    """Bytes of all variables of a file and its groups by their shapes, written or not."""
    return sum(math.prod(variable.shape) * _width(variable) for variable in _all_variables(stored))


def _width(variable: netCDF4.Variable[Any]) -> int:
    """Bytes of a value; of a text, its address in memory."""
    return getattr(variable.dtype, "itemsize", 8)


def shared_file(path: Path) -> CachingFileManager[Any]:
    """Make a manager of a netCDF file that is open at most once in this process, for all its readers.

    A file with texts that is opened twice ends the process when it is closed (netCDF4 1.7.5 with HDF5 2.2, also in one
    thread). When one reader closes it, the next access of another reader opens it again. Hold the lock during use.
    """
    from xarray.backends import CachingFileManager

    state, place = path.stat(), os.path.realpath(path)
    identity = f"{state.st_dev}-{state.st_ino}-{state.st_mtime_ns}"
    return CachingFileManager(dataset_of, place, mode="r", lock=NETCDF_LOCK, manager_id=identity)


def remedy(path: Path) -> str:
    """The remedy for a damaged file of a result directory, in words."""
    rerun = f"run the study again with the same {option('out')}"
    if path.name == "choice.nc":
        return f"delete it and {rerun}: the choice is made again from its pilot"
    if path.parent.name == "analysis":
        return f"{rerun}: it is made again from the cube"
    if (path.parent / "journal.sqlite").exists():
        return f"{rerun}: it is made again from the journal, and no point is computed"
    return "make it again, or copy it again from where it was made"
