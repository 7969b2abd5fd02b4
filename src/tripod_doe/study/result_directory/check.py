"""Check of the files of a result directory against their checksums, with a remedy for each damaged one."""

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tripod_doe.errors import CubeError, InputError, option
from tripod_doe.files.checksum_list import LIST, checksums, damaged_lines, refuse_changed, refuse_other_results
from tripod_doe.study.cube.file_checks import ANALYSES, refuse_unfit
from tripod_doe.study.cube.file_digest import is_sealed
from tripod_doe.study.cube.netcdf import opened_file, reading
from tripod_doe.study.cube.slabs import box, slabs
from tripod_doe.study.definition.study_file_schema import parse_file
from tripod_doe.study.journal import OUTDATED, SHOWN, Journal, damage, journal_path
from tripod_doe.study.result_directory.latest_run import failed_analyses
from tripod_doe.study.result_directory.stored_study import STORED, known_texts, refuse_changed_study, stored_text

_SLAB_BYTES = 32_000_000
_TEXT_BYTES = 64


@dataclass(frozen=True)
class CheckedFile:
    """A file with its damage."""

    path: Path
    damage: str = ""  # a sentence with the remedy; empty if intact
    note: str = ""  # parts that were not checked
    is_checked: bool = True  # whether any of it was
    is_missing: bool = False  # whether it is not there

    @property
    def is_whole(self) -> bool:
        """Whether no damage is known."""
        return not self.damage


def check_files(path: Path) -> list[CheckedFile]:
    """Check the files of a result directory and the folders in it that have checksums, or one file.

    Raises:
        InputError: If there is no such file, or none that has checksums.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such file or directory")
    checked = list(_checked(path.resolve() if path.is_symlink() else path))
    if not checked:
        raise InputError(f"{path}: no file with a checksum here; name a result directory or a cube")
    return checked


def _checked(path: Path) -> Iterator[CheckedFile]:
    waiting = [path]  # a stack: folders may be nested deeper than Python calls
    while waiting:
        path = waiting.pop()
        try:
            if path.suffix == ".zarr" and not path.is_symlink():
                yield CheckedFile(path, note="Zarr stores have no checksums: export it again", is_checked=False)
            elif not path.is_symlink() and path.is_dir():
                inner = [each for each in path.iterdir() if not each.name.startswith(".")]
                waiting += sorted(inner, reverse=True)
            else:
                yield from _checked_file(path)
        except OSError as error:
            yield CheckedFile(path, f"cannot be read: {error.strerror}")


def _checked_file(path: Path) -> Iterator[CheckedFile]:
    if path.is_symlink():  # to a place elsewhere
        yield CheckedFile(path, note="a symbolic link; check the file to which it leads", is_checked=False)
    elif path.name == LIST:
        yield from _checked_list(path)
    elif path.suffix == ".nc":
        yield _checked_netcdf(path)
    elif path == journal_path(path.parent):
        yield _checked_journal(path)
        yield from _missing(path.parent)
    elif path.name == "study.toml" and journal_path(path.parent).exists():
        yield _checked_study(path)
    elif _is_listed(path):
        yield _checked_listed(path)


def _checked_list(path: Path) -> Iterator[CheckedFile]:
    """A list of checksums, and the files that are in it but no longer there."""
    try:
        sums, damaged = checksums(path.parent), damaged_lines(path.parent)
        refuse_other_results(path.parent)
    except CubeError as error:
        yield CheckedFile(path, str(error).removeprefix(f"{path}: "))
        return
    again = f"make the files of this folder again with the same {option('out')}; finished points are kept"
    yield CheckedFile(path, f"{damaged} of its lines are damaged; {again}" if damaged else "")
    for name in sums:
        if not path.with_name(name).exists():
            yield CheckedFile(path.with_name(name), f"it is in {LIST}, but not here; {again}", is_missing=True)


def _is_listed(path: Path) -> bool:
    with suppress(CubeError):  # of the list, which is checked itself
        return path.name in checksums(path.parent)
    return False


def _checked_listed(path: Path) -> CheckedFile:
    try:
        refuse_changed(path)
    except CubeError as error:
        return CheckedFile(path, str(error).removeprefix(f"{path}: "))
    return CheckedFile(path)


def _checked_netcdf(path: Path) -> CheckedFile:
    try:
        refuse_unfit(path, whole=True)
        if is_sealed(path):
            return CheckedFile(path)
        with reading(path), opened_file(path) as stored:
            for variable in stored.variables.values():
                for slab in slabs(variable.shape, box(variable.shape, _item_bytes(variable), _SLAB_BYTES)):
                    variable[slab.place]  # HDF5 checks its chunks
    except CubeError as error:
        return CheckedFile(path, str(error).removeprefix(f"{path}: "))
    return CheckedFile(path, note="without a checksum of the file: names, attributes and texts are not checked")


def _item_bytes(variable: Any) -> int:
    """Bytes of a value in memory; for a text the bytes of its reference."""
    return int(getattr(variable.dtype, "itemsize", _TEXT_BYTES))


def _checked_journal(path: Path) -> CheckedFile:
    try:
        damaged = damage(path)
    except sqlite3.Error as error:
        return CheckedFile(path, f"cannot be read: {error}")
    except CubeError as error:
        return CheckedFile(path, str(error).removeprefix(f"{path}: "))
    if not damaged:
        return CheckedFile(path)
    rerun = (
        f"run the study again with the same {option('out')}: all whole blocks are kept, and the others computed again"
    )
    return CheckedFile(path, f"{damaged}; {rerun}")


def _missing(directory: Path) -> Iterator[CheckedFile]:
    """The files that a study must have by its journal and its report, and that are not there."""
    names = []
    with suppress(CubeError, InputError):  # of a file that is checked itself
        with Journal(directory, read_only=True) as journal:
            names += [STORED] if known_texts(journal) else []
            if journal.recall(SHOWN) == journal.state() and journal.recall(OUTDATED) == "no":
                names += ["cube.nc", "cost.nc"]
        if "index.html" in checksums(directory / "report"):  # written after the analyses
            study = parse_file(stored_text(directory), STORED)
            names += [f"{ANALYSES}/{name}.nc" for name in study.analysis.keys() - failed_analyses(directory).keys()]
    again = f"run the study again with the same {option('out')}: no finished point is computed again"
    for path in (directory / name for name in names):
        if not path.exists():
            yield CheckedFile(path, f"it was written, but is not here; {again}", is_missing=True)


def _checked_study(path: Path) -> CheckedFile:
    try:
        with Journal(path.parent, read_only=True) as journal:
            refuse_changed_study(path.parent, journal)
    except CubeError as error:
        text = str(error)
        return CheckedFile(path, text.removeprefix(f"{path}: ") if text.startswith(f"{path}: ") else "")
    return CheckedFile(path)
