"""Checksums of the text files of results, in a list in their folder that ``sha256sum --check`` reads, too.

The next list is written before the file, and replaces the list after it: at each moment, and after a kill at any, the
file fits one of both. A file that fits none of them, while nothing is written, is damaged.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tripod_doe.atomic_files import replace_file, replace_text
from tripod_doe.errors import CubeError, StorageError, option
from tripod_doe.regular_files import opened_regular, read_regular

LIST = "checksums.sha256"
"""File of a folder of results."""

_NEXT = f".{LIST}.next"  # the list that takes its place
_LINE = re.compile(r"([0-9a-f]{64})  ([^\n/]+)")
_LARGEST = 1_000_000  # bytes of a list that are read
_PATIENCE = 1.0  # seconds for a look during which nothing is written


def write_listed(path: Path, content: str | bytes) -> Path:
    """Replace a file as a whole, a text as UTF-8, and write its checksum into the list beside it; returns its path.

    Raises:
        StorageError: If one of them cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    with _one_writer(path.parent):
        upcoming = _upcoming(path.parent) | {path.name: hashlib.sha256(data).hexdigest()}
        lines = "".join(f"{upcoming[name]}  {name}\n" for name in sorted(upcoming))
        listed = replace_text(path.with_name(_NEXT), lines)
        with replace_file(path) as fresh:
            fresh.write_bytes(data)
        try:
            os.replace(listed, path.with_name(LIST))
        except OSError as error:
            raise StorageError(f"{path.with_name(LIST)}: cannot write this file: {error.strerror}") from error
    return path


@contextmanager
def _one_writer(folder: Path) -> Iterator[None]:
    """Wait until no other process or thread writes listed files of a folder; the lock ends with its process."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:  # writing the file states the reason
        yield
        return
    try:
        with suppress(OSError):  # a network filesystem without locks: one writer is the rule
            fcntl.flock(place, fcntl.LOCK_EX)
        yield
    finally:
        os.close(place)


def _upcoming(folder: Path) -> dict[str, str]:
    """The checksums of a folder, with that of a file that a kill kept from the list."""
    sums = checksums(folder)
    for name, digest in _sums(folder / _NEXT).items():
        path = folder / name
        with suppress(OSError, CubeError):  # none is there, or none of ours
            if digest != sums.get(name) and _digest(path, links=False) == digest:
                sums[name] = digest
    return sums


def checksums(folder: Path) -> dict[str, str]:
    """The checksums in the list of a folder, by the names of their files; lines that are damaged are left out."""
    return _sums(folder / LIST)


def damaged_lines(folder: Path) -> int:
    """Number of lines of the list of a folder that hold no checksum."""
    return sum(_LINE.fullmatch(line) is None for line in _lines(folder / LIST))


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
    """Whether a file does not fit its checksum; a missing one is not changed.

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


def _digest(path: Path, links: bool = True) -> str:
    with opened_regular(path, error=CubeError, links=links) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _version(path: Path) -> list[tuple[int, int]]:
    """What changes when a file or a list beside it is replaced."""
    versions = []
    for place in (path, path.with_name(LIST), path.with_name(_NEXT)):
        with suppress(OSError):  # there is none, or none any more
            state = place.stat()
            versions.append((state.st_ino, state.st_mtime_ns))
    return versions


def refuse_changed(path: Path, unlisted: bool = False) -> None:
    """Refuse a file that does not fit its checksum.

    Args:
        unlisted: Whether to refuse a file without a checksum, too.

    Raises:
        CubeError: With the remedy.
    """
    if is_changed(path, unlisted):
        raise CubeError(
            f"{path}: damaged or edited: it does not fit its checksum in {LIST}; {_remedy(path)}; to use it as it is, "
            "move it to another folder"
        )


def _remedy(path: Path) -> str:
    """How to make a file of results again, in words."""
    results = path.parent.parent
    if path.parent.name == "report" and any((results / name).is_file() for name in ("study.toml", "fit.nc")):
        return f"make it again: tripod-doe report {results}"
    return f"make it again by the same command with the same {option('out')}: finished points are kept"
