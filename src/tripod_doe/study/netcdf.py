"""Cubes as netCDF files: replaced as a whole, read into memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tripod_doe.atomic_files import replace_file
from tripod_doe.errors import CubeError, option

if TYPE_CHECKING:  # a query reads cubes without xarray
    import xarray as xr
    from xarray.backends import NetCDF4DataStore

__all__ = ["TEXT_TABLE", "lazy_dataset", "opened_store", "read_dataset", "reading", "stamp_history", "write_dataset"]

TEXT_TABLE = "text_table"
"""Attribute of a variable of numbers: the name of the variable with the texts to which they refer."""


def stamp_history(dataset: xr.Dataset, action: str) -> xr.Dataset:
    """Add a line with time and action to the history of a dataset."""
    line = f"{datetime.now(UTC).isoformat(timespec='seconds')} {action}"
    earlier = dataset.attrs.get("history")
    return dataset.assign_attrs(history=f"{line}\n{earlier}" if earlier else line)


def write_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Replace a netCDF file as a whole; a kill leaves the old one or the new one.

    Raises
    ------
    StorageError
        If it cannot be written; the old file stays.
    """
    floats = [name for name, variable in dataset.variables.items() if variable.dtype.kind == "f"]
    encoding = {name: {"_FillValue": np.nan if name in dataset.data_vars else None} for name in floats}
    with opened_store(path) as store:
        dataset.dump_to_store(store, encoding=encoding)


@contextmanager
def opened_store(path: Path) -> Iterator[NetCDF4DataStore]:
    """Give a store for a netCDF file to write, which takes the place of an older one at the end of the block.

    Raises
    ------
    StorageError
        If it cannot be written; the old file stays.
    """
    from xarray.backends import NetCDF4DataStore
    from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

    with replace_file(path) as fresh:
        # as `to_netcdf` does, which would import dask.distributed to ask which lock it needs
        store = NetCDF4DataStore.open(  # type: ignore[no-untyped-call]
            fresh, mode="w", format="NETCDF4", lock=NETCDF4_PYTHON_LOCK
        )
        try:
            yield store
        finally:
            store.close()


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what goes wrong while a file is read into words.

    Raises
    ------
    CubeError
        If the file is missing or damaged.
    """
    if not path.exists():
        raise CubeError(f"{path}: there is no such file")
    try:
        yield
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        raise CubeError(
            f"{path}: not a readable cube ({error}); run the study again with the same {option('out')}: "
            "it is rebuilt from the journal"
        ) from error


def read_dataset(path: Path) -> xr.Dataset:
    """Read a netCDF file into memory.

    Raises
    ------
    CubeError
        If the file is missing or damaged.
    """
    with lazy_dataset(path) as stored, reading(path):
        return stored.load()


def lazy_dataset(path: Path, chunks: int | str | Mapping[str, int] | None = None, by_number: bool = True) -> xr.Dataset:
    """A netCDF file whose variables are read when they are used, each time anew; open until the dataset is closed.

    Parameters
    ----------
    path
        The file.
    chunks
        As in `xarray.open_dataset`; None leaves Dask out.
    by_number
        Whether points of a list can be selected by their numbers, for which xarray holds 14 bytes a point.

    Raises
    ------
    CubeError
        If the file is missing or damaged.
    """
    import xarray as xr

    from tripod_doe.study.text_tables import with_texts

    with reading(path):
        stored = xr.open_dataset(
            path, engine="netcdf4", decode_timedelta=False, chunks=chunks, cache=False, create_default_indexes=False
        )
        read = with_texts(stored)
        for dim in stored.dims:
            if dim in stored.coords and (by_number or dim != "point"):
                read = read.set_xindex(str(dim))
        read.set_close(stored.close)
        return read
