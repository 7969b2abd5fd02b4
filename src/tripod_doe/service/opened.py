"""Cubes as a question needs them: opened for it, read as far as it asks, and closed again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import xarray as xr

from tripod_doe.study.journal import journal_path
from tripod_doe.study.netcdf import reading
from tripod_doe.study.results import cube_files, cube_so_far, is_shown

__all__ = ["opened"]

_so_far: dict[tuple[object, ...], xr.Dataset] = {}
"""The cube of the run that was asked for last while it ran, by the state of its journal."""


@contextmanager
def opened(path: str | Path) -> Iterator[xr.Dataset]:
    """Open a result directory with its costs, or a netCDF file; only what is used of it is read.

    While a study runs, this is its cube so far, made again when a block has been finished.

    Raises
    ------
    CubeError
        If there is no cube and no finished point, or what is there is damaged.
    """
    place = Path(path)
    if not is_shown(place):
        yield _cube_so_far(place)
        return
    with ExitStack() as stack:
        datasets = []
        for file in cube_files(place):
            with reading(file):
                datasets.append(stack.enter_context(xr.open_dataset(file, engine="netcdf4", decode_timedelta=False)))
        cube, *costs = datasets
        for cost in costs:
            cube = cube.assign({name: cost[name] for name in cost.data_vars})
        yield cube


def _cube_so_far(place: Path) -> xr.Dataset:
    journal = journal_path(place)
    files = [file for file in (journal, journal.with_name(journal.name + "-wal")) if file.exists()]
    key = (str(place), *((file.stat().st_mtime_ns, file.stat().st_size) for file in files))
    if key not in _so_far:
        _so_far.clear()
        _so_far[key] = cube_so_far(place)
    return _so_far[key]
