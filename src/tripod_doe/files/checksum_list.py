"""Checksums of files of results, in a list in their folder that ``sha256sum --check`` reads, too.

The next list is written before the file, and replaces the list after it: at each moment, and after a kill at any, the
file fits one of both. A file that fits none of them, while nothing is written, is damaged.

The first line names whose results the folder holds, by two random numbers: one from the header of a study's journal,
one of the directory of a workflow or a search, which its list and the lists of all its steps name. So files that were
copied into another directory together with their list are known as those of other results.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import secrets
import shlex
import sys
import time
from collections.abc import Iterator, Set
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from tripod_doe.errors import CubeError, InputError, StorageError, option
from tripod_doe.files.atomic_files import refuse_links, replace_file, replace_text
from tripod_doe.files.regular_files import open_locked, opened_regular, read_regular

LIST = "checksums.sha256"
"""File of a folder of results."""

JOURNAL = "journal.sqlite"
"""File of a result directory with the finished blocks of its study."""

MOST_RESULTS = 2**31 - 1
"""Largest number of results."""

_NEXT = f".{LIST}.next"  # the list that takes its place
_LOCK = f".{LIST}.lock"
_LINE = re.compile(r"([0-9a-f]{64})  ([^\n/]+)")
_FIRST = re.compile(r"# results ([0-9]{1,10}) of directory ([0-9]{1,10})")
_NUMBER_AT = 60  # place of the number of the results in the header of a journal
_STEPS = ("steps", "quick")  # folders with the folders of steps
_PARTS = ("report", "figures", "tables", "quick")  # folders with a part of the results of the folder above
_LARGEST = 1_000_000  # bytes of a list that are read
_PATIENCE = 1.0  # seconds for a look during which nothing is written


class Results(NamedTuple):
    """Whose results a folder holds, by numbers; 0 where unknown."""

    study: int  # of the journal in the folder
    directory: int  # of the directory of a workflow or a search; 0 for the directory of a study

    def __str__(self) -> str:
        return f"# results {self.study} of directory {self.directory}"

    def differs(self, other: Results) -> bool:
        """Whether two folders are known to hold different results."""
        return any(own and its and own != its for own, its in zip(self, other, strict=True))


def results_number(directory: Path) -> int:
    """The random number of the results in a directory, which a copy keeps; 0 if it has none."""
    here = _results_in(directory)
    return here.study or here.directory


def number_in(journal: Path) -> int:
    """The random number of the results in a journal.

    It is in the header of the file ("user version" in SQLite's description of its file format).
    """
    try:
        with opened_regular(journal, sys.maxsize) as stream:
            return int.from_bytes(os.pread(stream.fileno(), 4, _NUMBER_AT), "big") & MOST_RESULTS
    except (OSError, InputError):
        return 0


def _owners(folder: Path) -> tuple[Path, Path]:
    """The result directory or step of a workflow to which a folder belongs, and the directory with all its steps."""
    place = folder.absolute()
    while place.name in _PARTS and place.parent.name not in _STEPS and not (place / JOURNAL).exists():
        place = place.parent
    return place, place.parent.parent if place.parent.name in _STEPS else place


def _results_in(folder: Path) -> Results:
    """Whose results a folder holds, without a look at its own list."""
    place, root = _owners(folder)
    whole = 0
    if not (root / JOURNAL).exists():  # a list that is lost, or is the last, gets the number in the others
        parts, steps = (root / part for part in _PARTS), (path.parent for path in _lists_of_steps(root))
        whole = next(filter(None, (_named_in(each).directory for each in chain([root], parts, steps))), 0)
    return Results(number_in(place / JOURNAL), whole)


def _named_in(folder: Path, *names: str) -> Results:
    """What the list of a folder names."""
    for name in names or (LIST, _NEXT):
        if match := _FIRST.fullmatch((_lines(folder / name) or [""])[0]):
            return Results(int(match[1]), int(match[2]))
    return Results(0, 0)


def _lists_of_steps(root: Path) -> Iterator[Path]:
    """The lists in the folders of the steps of a workflow or a search."""
    for steps in _STEPS:
        yield from sorted((root / steps).glob(f"*/{LIST}"))


def refuse_other_results(folder: Path) -> None:
    """Refuse a folder whose list, or whose steps, are known to be of another directory.

    Raises:
        CubeError: With both files, and the remedy.
    """
    for path, number, other, its in _numbers(folder):
        if number and its and number != its:
            raise CubeError(
                f"{path}: of other results than {other}: files of another directory were copied here; put this "
                "directory's own back, or move the copied ones away and make it again by the same command"
            )


def _numbers(folder: Path) -> Iterator[tuple[Path, int, Path, int]]:
    """Files that name whose results a folder holds, in pairs that must agree, each with its number."""
    (place, root), here = _owners(folder), _results_in(folder)
    for path in (folder / LIST, folder / _NEXT):
        named = _named_in(folder, path.name)
        yield path, named.study, place / JOURNAL, here.study
        yield path, named.directory, root / LIST, here.directory
    if place == root:
        for path in _lists_of_steps(root):
            yield path, _named_in(path.parent).directory, root / LIST, here.directory


def names_results(folder: Path) -> bool:
    """Whether the list of a folder names whose results it holds."""
    return any(_named_in(folder))


def write_listed(path: Path, content: str | bytes) -> Path:
    """Replace a file as a whole, a text as UTF-8, and write its checksum into the list next to it; returns its path.

    Raises:
        StorageError: If one of them cannot be written.
    """
    with listed_file(path) as fresh:
        fresh.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@contextmanager
def listed_file(path: Path) -> Iterator[Path]:
    """Give a path to write to, as `replace_file`; its checksum is then in the list next to it.

    Raises:
        StorageError: If one of them cannot be written.
    """
    with _one_writer(path.parent):
        with replace_file(path) as fresh:
            yield fresh
            first, upcoming = _upcoming(path.parent)
            upcoming[path.name] = _digest(fresh, links=False)
            listed = _write_list(path.with_name(_NEXT), first, upcoming)
        try:
            os.replace(listed, path.with_name(LIST))
        except OSError as error:
            raise StorageError(f"{path.with_name(LIST)}: cannot write this file: {error.strerror}") from error


def remove_listed(folder: Path, keep: Set[str] = frozenset()) -> None:
    """Remove the files in the list of a folder before new ones are made: none of earlier results is left next to them.

    Args:
        keep: Names of files that stay.

    Raises:
        StorageError: If the list cannot be written.
    """
    if not (folder / LIST).exists():
        return
    with _one_writer(folder):
        first, sums = _upcoming(folder)
        for name in sums.keys() - keep:
            with suppress(OSError):  # writing the new one states the reason
                (folder / name).unlink()
        _write_list(folder / LIST, first, {name: sums[name] for name in sums.keys() & keep})


def remove_pages(directory: Path) -> None:
    """Remove the report of earlier results, and what was handed on of it.

    Raises:
        InputError: If a folder in it is a link: what it leads to stays.
        StorageError: As `remove_listed`.
    """
    refuse_links(directory / "report")
    for folder in (directory / "report" / "figures", directory / "report"):
        remove_listed(folder)


@contextmanager
def _one_writer(folder: Path) -> Iterator[None]:
    """Wait until no other process or thread writes listed files of a folder; the lock ends with its process.

    It is on a file of this user alone: who may only read the folder could hold a lock on the folder itself.
    """
    path = folder / _LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        while True:
            place = open_locked(path, os.O_CREAT | os.O_RDWR)
            with suppress(OSError):  # a network filesystem without locks: one writer is the rule
                fcntl.flock(place, fcntl.LOCK_EX)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.stat(path), os.fstat(place)):
                    break
            os.close(place)  # the writer before removed it
    except OSError:  # writing the file states the reason
        yield
        return
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(place)


def _upcoming(folder: Path) -> tuple[Results, dict[str, str]]:
    """Whose results a folder holds, and its checksums, with the one that a kill kept from the list."""
    here = _results_in(folder)
    if not any(here) and not (_owners(folder)[1] / JOURNAL).exists():
        here = Results(0, 1 + secrets.randbelow(MOST_RESULTS))
    sums, late = ({} if _named_in(folder, name).differs(here) else _sums(folder / name) for name in (LIST, _NEXT))
    for name, digest in late.items():
        path = folder / name
        with suppress(OSError, CubeError):  # none is there, or not of this program
            if digest != sums.get(name) and _digest(path, links=False) == digest:
                sums[name] = digest
    return here, sums


def _write_list(path: Path, first: Results, sums: dict[str, str]) -> Path:
    lines = "".join(f"{sums[name]}  {name}\n" for name in sorted(sums))
    return replace_text(path, f"{first}\n{lines}" if any(first) else lines)


def checksums(folder: Path) -> dict[str, str]:
    """The checksums in the list of a folder, by the names of their files; lines that are damaged are left out."""
    return _sums(folder / LIST)


def damaged_lines(folder: Path) -> int:
    """Number of lines of the list of a folder that hold no checksum."""
    return sum(not (_LINE.fullmatch(line) or _FIRST.fullmatch(line)) for line in _lines(folder / LIST))


def _sums(path: Path) -> dict[str, str]:
    return {match[2]: match[1] for line in _lines(path) if (match := _LINE.fullmatch(line))}


def _lines(path: Path) -> list[str]:
    try:
        text = read_regular(path, _LARGEST, CubeError)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise CubeError(f"{path}: cannot read this file: {error.strerror}") from error
    return text.decode(errors="replace").rstrip("\n").split("\n") if text else []


def is_changed(path: Path, unlisted: bool = False) -> bool:
    """Whether a file does not match its checksum; a missing one is not changed.

    Args:
        unlisted: Whether a file without a checksum is changed.
    """
    end = time.monotonic() + _PATIENCE
    while True:
        version = _version(path)
        listed = (_sums(path.with_name(name)).get(path.name) for name in (LIST, _NEXT))
        if not (known := {*listed} - {None}) and not unlisted:
            return False
        try:
            if known and _digest(path) in known:
                return False
        except OSError:  # what reads it states the reason
            return False
        if _version(path) == version or time.monotonic() > end:
            return True


def listed_json(path: Path, most_bytes: int) -> Any:
    """What a listed file holds as JSON; None where it is missing, damaged or larger."""
    try:
        text = read_regular(path, most_bytes)  # before its checksum, which reads all of it
        return None if is_changed(path) else json.loads(text)
    except (OSError, ValueError, RecursionError, InputError):
        return None


def _digest(path: Path, links: bool = True) -> str:
    with opened_regular(path, error=CubeError, links=links) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _version(path: Path) -> list[tuple[int, int]]:
    """What changes when a file or a list next to it is replaced."""
    versions = []
    for place in (path, path.with_name(LIST), path.with_name(_NEXT)):
        with suppress(OSError):  # there is none, or none any more
            state = place.stat()
            versions.append((state.st_ino, state.st_mtime_ns))
    return versions


def refuse_changed(path: Path, unlisted: bool = False) -> None:
    """Refuse a file that does not match its checksum, or whose list is of another directory.

    Args:
        unlisted: Whether to refuse a file without a checksum, too.

    Raises:
        CubeError: With the remedy.
    """
    refuse_other_results(path.parent)
    if is_changed(path, unlisted):
        raise CubeError(
            f"{path}: damaged or edited: it does not match its checksum in {LIST}; {_remedy(path)}; to use it as "
            "it is, "
            "move it to another folder"
        )


def _remedy(path: Path) -> str:
    """How to make a file of results again, in words."""
    results = path.parent.parent
    if path.parent.name == "report" and any((results / name).is_file() for name in ("study.toml", "fit.nc")):
        return f"make it again: tripod-doe report {shlex.quote(str(results))}"
    return f"make it again by the same command with the same {option('out')}: finished points are kept"
