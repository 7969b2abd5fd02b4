"""Export of a cube as a Zarr store, next to the cube; never read here."""

import importlib.util
import shutil
from pathlib import Path

from tripod_doe.errors import InputError, StorageError, option
from tripod_doe.files.atomic_files import remedy
from tripod_doe.study.result_directory.open_cube import open_cube

_STORE = "cube.zarr"


def refuse_without_zarr() -> None:
    """Refuse the export where it is not installed; InputError with the command that installs it."""
    if importlib.util.find_spec("zarr") is None:
        raise InputError(f"{option('export', 'zarr')}: zarr is not installed; pip install zarr")


def remove_zarr(directory: Path) -> None:
    """Remove the store of earlier results; StorageError if that fails."""
    store, old = directory / _STORE, directory / ".cube.zarr.old"
    try:
        shutil.rmtree(old, ignore_errors=True)
        if store.is_dir() and not store.is_symlink():
            store.rename(old)  # so that no part of a store is left where this is interrupted
            shutil.rmtree(old)
    except OSError as error:
        raise StorageError(f"{store}: cannot remove this store of earlier results: {error.strerror}") from error


def export_zarr(directory: Path) -> Path:
    """Write ``cube.zarr``: the cube of a result directory with its costs, part by part, in place of an older one.

    Returns:
        The store.

    Raises:
        InputError: If zarr is not installed.
        CubeError: If there is no cube.
        StorageError: If it cannot be written; an older one stays.
    """
    refuse_without_zarr()
    store, fresh = directory / _STORE, directory / ".cube.zarr.new"
    shutil.rmtree(fresh, ignore_errors=True)
    try:
        with open_cube(directory, chunks="auto") as cube:
            for variable in cube.variables.values():
                variable.encoding = {}  # of netCDF
            cube.to_zarr(fresh, mode="w", zarr_format=2)  # known to every reader, texts included
        shutil.rmtree(store, ignore_errors=True)
        fresh.rename(store)
    except OSError as error:
        shutil.rmtree(fresh, ignore_errors=True)
        reason = error.strerror or error
        raise StorageError(
            f"{store}: cannot write this store: {reason}; the cube stays: {remedy(error)}, run again"
        ) from error
    return store
