"""Export of a cube as a Zarr store, beside the cube; never read here."""

import importlib.util
import shutil
from pathlib import Path

from tripod_doe.errors import InputError, StorageError, option
from tripod_doe.study.result_directory.open_cube import open_cube


def refuse_without_zarr() -> None:
    """Refuse the export where it is not installed; InputError with the command that installs it."""
    if importlib.util.find_spec("zarr") is None:
        raise InputError(f"{option('export', 'zarr')}: zarr is not installed; pip install zarr")


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
    store, fresh = directory / "cube.zarr", directory / ".cube.zarr.new"
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
            f"{store}: cannot write this store: {reason}; the cube stays: free space, run again"
        ) from error
    return store
