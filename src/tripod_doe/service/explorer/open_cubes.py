"""Open cubes for workers: small cubes stay in memory, large cubes are read only as far as needed."""

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import xarray as xr

from tripod_doe.files.checksum_list import number_in
from tripod_doe.files.regular_files import version_of
from tripod_doe.service.explorer.candidates import as_points
from tripod_doe.study.cube.file_checks import refuse_unfit
from tripod_doe.study.cube.lazy_dataset import lazy_dataset
from tripod_doe.study.cube.netcdf import reading
from tripod_doe.study.journal import journal_path
from tripod_doe.study.result_directory.open_cube import cube_files, cube_so_far, unshown_state
from tripod_doe.study.result_directory.stored_study import STORED

_SMALL = 64_000_000  # bytes
_MOST = 4
_kept: OrderedDict[tuple[object, ...], xr.Dataset] = OrderedDict()
"""Open cubes by the state of their source files: in memory, or in temporary files for large running studies."""


@contextmanager
def opened(path: str | Path) -> Iterator[xr.Dataset]:
    """Open a result directory with its costs, or a netCDF file.

    While a study runs, this is its cube so far, assembled again after each finished block.

    Raises:
        CubeError: If nothing has finished (`NoResultsError`), or the files are damaged.
    """
    place = Path(path)
    state, files = _checked(place)
    key = (str(place), *state, *map(_state_of, files))
    if not files and key not in _kept:
        _keep(key, cube_so_far(place))
    if key in _kept:
        _kept.move_to_end(key)
        yield _kept[key]
        return
    with ExitStack() as stack:
        cube = _lazy(files, stack)
        if cube.nbytes <= _SMALL:
            with reading(files[0]):
                cube = as_points(cube.load())
                _keep(key, cube)
        yield cube


def _checked(place: Path) -> tuple[tuple[object, ...], list[Path]]:
    """The state of a journal whose points are not yet in a cube, or else the files of the cube, which are whole."""
    if newest := unshown_state(place):  # another journal, or one whose study was changed, may hold as many blocks
        return (newest, number_in(journal_path(place)), _state_of(place / STORED)), []
    files = cube_files(place)
    for file in files:
        refuse_unfit(file)
    return (), files


def _state_of(file: Path) -> tuple[object, ...]:
    """Name and version of a file; the name alone if it is not there."""
    with suppress(FileNotFoundError):
        return file.name, version_of(file.lstat())
    return (file.name,)


def _keep(key: tuple[object, ...], cube: xr.Dataset) -> None:
    """Keep a cube; drop an older state of the same cube, and the cube that was not used for the longest time."""
    for other in [other for other in _kept if other[0] == key[0]]:
        _kept.pop(other).close()
    _kept[key] = cube
    while len(_kept) > _MOST:
        _kept.popitem(last=False)[1].close()


def _lazy(files: list[Path], stack: ExitStack) -> xr.Dataset:
    """The variables of several files, read when they are used, as long as the stack is open."""
    datasets = [stack.enter_context(lazy_dataset(file)) for file in files]
    cube, *costs = datasets
    for cost in costs:
        cube = cube.assign({name: cost[name] for name in cost.data_vars})
    return cube
