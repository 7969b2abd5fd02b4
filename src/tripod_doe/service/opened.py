"""Cubes kept open between questions: a slice is read from its file, not the whole cube."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path

import xarray as xr

from tripod_doe.study.journal import journal_path
from tripod_doe.study.netcdf import reading
from tripod_doe.study.results import cube_files, cube_so_far, is_shown

__all__ = ["opened"]

_MOST_OPEN = 4
_open: OrderedDict[tuple[object, ...], xr.Dataset] = OrderedDict()


def opened(path: str | Path) -> xr.Dataset:
    """Open a result directory with its costs, or a netCDF file; what was asked for last stays open.

    While a study runs, this is its cube so far, made again when a block has been finished.

    Raises
    ------
    CubeError
        If there is no cube and no finished point, or what is there is damaged.
    """
    place = Path(path)
    shown = is_shown(place)
    files = cube_files(place) if shown else [file for file in _journal_files(place) if file.exists()]
    key = (str(place), *((file.name, file.stat().st_mtime_ns, file.stat().st_size) for file in files))
    if key not in _open:
        _open[key] = _lazy(files) if shown else cube_so_far(place)
    _open.move_to_end(key)
    while len(_open) > _MOST_OPEN:
        _open.popitem(last=False)[1].close()
    return _open[key]


def _journal_files(place: Path) -> list[Path]:
    journal = journal_path(place)
    return [journal, journal.with_name(journal.name + "-wal")]


def _lazy(files: list[Path]) -> xr.Dataset:
    datasets = []
    for file in files:
        with reading(file):
            datasets.append(xr.open_dataset(file, engine="netcdf4", decode_timedelta=False))
    cube, *costs = datasets
    for cost in costs:
        cube = cube.assign({name: cost[name] for name in cost.data_vars})
    cube.set_close(lambda: [dataset.close() for dataset in datasets])  # type: ignore[arg-type, func-returns-value]
    return cube
