"""The results of a study: its cube if it contains every finished point, else a cube made from the journal.

While a study runs, and after an interrupt, finished points stand only in the journal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeVar

from tripod_doe.errors import CubeError, option
from tripod_doe.study.cube.file_checks import OtherStudyError, study_hash
from tripod_doe.study.journal import OUTDATED, SHOWN, STUDY_HASH, Journal, journal_path

if TYPE_CHECKING:  # a query reads cubes without xarray
    import xarray as xr

    from tripod_doe.study.cube.writing import StoredResults
    from tripod_doe.study.definition.study import Study
    from tripod_doe.study.study_points import StudyPoints

_Results = TypeVar("_Results")


class NoResultsError(CubeError):
    """Nothing has finished in a place yet."""


FIT_FILE = "fit.nc"
"""File of a result directory with the result of a fit, which has no cube of its own."""

_OTHER_KINDS = {
    "optimise.toml": ("an optimisation", "optimise"),
    "fit.toml": ("a fit", "fit"),
    "steps.json": ("a workflow", "workflow"),
}
_MOST_CHANGES = 4  # of a study while it is read; files that do not fit each other stay so
_READ_AT_ONCE = 100_000_000  # bytes of a cube that is read whole


def open_cube(path: str | Path, chunks: int | str | Mapping[str, int] | None = None) -> xr.Dataset:
    """Open a result cube with its costs.

    Args:
        path: A result directory, or a netCDF file.
        chunks: Cells that are read at a time along each dimension, as in `xarray.open_dataset`, or "auto": for a cube
            larger than the memory. None reads all of it at once.

    Returns:
        For a directory the variables of cost.nc are joined; where the study is running or was interrupted, its finished
        points, the others flagged as not_run. In memory; with `chunks` it is read when it is used, from files that are
        open until it is closed (``with td.open_cube(path, chunks="auto") as cube``).

    Raises:
        CubeError: If there is no cube and no finished point, or what is there is damaged.
    """

    def stored() -> xr.Dataset:
        if chunks is not None:
            return _lazily(Path(path), chunks)
        from tripod_doe.study.cube.lazy_dataset import read_dataset

        return _joined(*map(read_dataset, cube_files(Path(path))))

    def so_far() -> xr.Dataset:
        cube = cube_so_far(Path(path))
        if chunks is not None:
            return cube.chunk(chunks)
        with cube:
            return cube.load()

    return stored_or_so_far(Path(path), stored, so_far)


def opened_cube(path: str | Path) -> xr.Dataset:
    """Open a cube as `open_cube` does, but read variables of a large one each time they are used.

    Close it: ``with opened_cube(path) as cube``.
    """

    def stored() -> xr.Dataset:
        cube = _lazily(Path(path))
        if cube.nbytes > _READ_AT_ONCE:
            return cube
        with cube:
            return cube.load()

    return stored_or_so_far(Path(path), stored, lambda: cube_so_far(Path(path)))


def opened_study(path: str | Path) -> xr.Dataset:
    """Open the cube of a study as `opened_cube` does.

    Raises:
        CubeError: As `opened_cube`, and if the file has no points, as the result of an analysis or a fit.
    """
    cube = opened_cube(path)
    if "outcome" in cube:
        return cube
    cube.close()
    kind = cube.attrs.get("analysis_kind")
    made = f"this is the result of an analysis of kind {kind}" if kind else "this is no result cube"
    reason = f"{made}, without the points of a study; give the directory or the cube of a study"
    raise CubeError(f"{path}: {_other_kind(Path(path)) or reason}")


def stored_or_so_far(path: Path, stored: Callable[[], _Results], so_far: Callable[[], _Results]) -> _Results:
    """What one function reads from the cube of a directory, or the other from its journal if that holds more.

    A derivation or a larger study may replace the study between a look at the journal and one at the cube: what is
    there then is read, again where it is replaced once more.
    """

    def read() -> _Results:
        return stored() if is_shown(path) else so_far()

    for _ in range(_MOST_CHANGES):
        with suppress(OtherStudyError):
            return read()
    return read()


def _lazily(path: Path, chunks: int | str | Mapping[str, int] | None = None) -> xr.Dataset:
    from tripod_doe.study.cube.lazy_dataset import lazy_dataset

    with ExitStack() as opened:
        files = (opened.enter_context(lazy_dataset(file, chunks)) for file in cube_files(path))
        cube = _joined(*files).assign()  # another object than the first file, which it closes
        cube.set_close(opened.pop_all().close)
    return cube


def _joined(cube: xr.Dataset, *costs: xr.Dataset) -> xr.Dataset:
    for cost in costs:
        cube = cube.assign({name: cost[name] for name in cost.data_vars})
    return cube


def cube_files(path: Path) -> list[Path]:
    """The files of a cube: of a result directory its cube and, where there are any, its costs; else the file itself.

    Of the directory of a fit it is the fit.

    Raises:
        NoResultsError: If nothing is there, or a directory holds no cube.
    """
    if not path.is_dir():
        if not path.exists():
            raise NoResultsError(f"{path}: there is no such file")
        return [path]
    if not (path / "cube.nc").exists():
        if (path / FIT_FILE).exists():
            return [path / FIT_FILE]
        out = option("out", str(path))
        reason = _other_kind(path) or f"no cube.nc and no finished point in this directory; run a study with {out}"
        raise NoResultsError(f"{path}: {reason}")
    return [path / "cube.nc", *(file for file in [path / "cost.nc"] if file.exists())]


def _other_kind(path: Path) -> str:
    """What a directory holds in place of a study, and where its studies are; empty if none."""
    if (path / ".zgroup").is_file() or (path / "zarr.json").is_file():
        return "this is a Zarr store, for other programs: name the result directory that it was exported from"
    for file, (kind, command) in _OTHER_KINDS.items():
        if (path / file).is_file():
            return (
                f"this is the directory of {kind}: tripod-doe {command} writes its page, {path / 'report/index.html'}; "
                f"its studies are folders of {path / 'steps'}: name one"
            )
    return ""


def is_shown(path: Path) -> bool:
    """Whether the cube of a result directory shows every block in its journal; true without a journal."""
    return not unshown_state(path)


def unshown_state(path: Path) -> str:
    """The state of the journal of a result directory, as a word; empty if its cube shows every block.

    Raises:
        CubeError: If the journal is damaged or cannot be read.
    """
    if not (journal_path(path)).is_file():
        return ""
    with Journal(path, read_only=True) as journal:
        state, study = journal.state(), journal.recall(STUDY_HASH)
        current = journal.recall(SHOWN) == state and journal.recall(OUTDATED) != "yes"
    if state == "0" or (current and (path / "cube.nc").exists() and _are_of(cube_files(path), study)):
        return ""
    return state


def _are_of(files: list[Path], study: str | None) -> bool:
    """Whether files are results of a study, by its hash; true if the hash is unknown."""
    return study is None or all(study_hash(file) == study for file in files)


def cube_so_far(path: Path) -> xr.Dataset:
    """Cube and costs of the points that the journal of a directory holds; nothing is written there.

    Close it as `opened_cube`: a large one is in temporary files until then.

    Raises:
        CubeError: If the journal is damaged.
        InputError: If the study in it can no longer be read, for instance as its table is gone.
    """
    from tripod_doe.study.cube.dataset import build_cube

    with Journal(path, read_only=True) as journal:
        journal.check()
        asked, results = _points_so_far(path, journal)
        if asked.points.count * results.point_bytes > _READ_AT_ONCE:
            cube = _written_aside(asked, results)
        else:
            cube = _joined(*build_cube(asked.study, asked.points, asked.keys, journal.blocks()))
    return cube


def write_cube_so_far(path: Path, folder: Path) -> None:
    """Write cube and costs of the points that the journal of a directory holds into a folder, slab by slab.

    Raises:
        CubeError, InputError: As `cube_so_far`.
        StorageError: If they cannot be written.
    """
    with Journal(path, read_only=True) as journal:
        journal.check()
        _write(*_points_so_far(path, journal), folder)


def _points_so_far(path: Path, journal: Journal) -> tuple[StudyPoints, StoredResults]:
    """The study of a directory, and the places of its results."""
    from tripod_doe.study.cube.writing import StoredResults
    from tripod_doe.study.result_directory.stored_study import stored_study

    asked = points_of(stored_study(path), path)
    return asked, StoredResults(asked, journal.places())


def points_of(study: Study, path: Path) -> StudyPoints:
    """A study of a result directory with its points, and the models that are chosen there."""
    from tripod_doe.study.designs import make_points
    from tripod_doe.study.result_directory.stored_choice import chosen_points, frozen_choice
    from tripod_doe.study.study_points import StudyPoints

    points = make_points(study)
    choice = frozen_choice(study, path) if study.auto_model else None
    return StudyPoints(study, points if choice is None else chosen_points(study, points, choice))


def _written_aside(asked: StudyPoints, results: StoredResults) -> xr.Dataset:
    """A cube in temporary files, which are removed when it is closed."""
    with ExitStack() as opened:
        folder = Path(opened.enter_context(TemporaryDirectory(prefix="tripod-doe-")))
        _write(asked, results, folder)
        cube = opened.enter_context(_lazily(folder)).assign()
        cube.set_close(opened.pop_all().close)
    return cube


def _write(asked: StudyPoints, results: StoredResults, folder: Path) -> None:
    from tripod_doe.study.cube.writing import write_cube

    write_cube(asked, results, folder, "points so far", lambda: None)
