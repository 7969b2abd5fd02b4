"""Checksums of the text files of results, in a list in their folder that ``sha256sum --check`` reads, too.

A file and the list are replaced one after the other, so a reader may meet the file of one moment beside the list of
another; it looks again before it calls a file damaged.
"""

from __future__ import annotations

import hashlib
import re
import time
from pathlib import Path

from tripod_doe.atomic_files import replace_file, replace_text
from tripod_doe.errors import CubeError, option
from tripod_doe.regular_files import refuse_irregular

LIST = "checksums.sha256"
"""File of a folder of results."""

_LINE = re.compile(r"([0-9a-f]{64})  ([^\n/]+)")
_LARGEST = 1_000_000  # bytes of a list that are read
_SETTLED, _PAUSE = 1.0, 0.05  # seconds without a change before a file is called damaged, and between two looks


def write_listed(path: Path, content: str | bytes) -> Path:
    """Replace a file as a whole, a text as UTF-8, and write its checksum into the list beside it; returns its path.

    Raises:
        StorageError: If one of them cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    with replace_file(path) as fresh:
        fresh.write_bytes(data)
    sums = checksums(path.parent) | {path.name: hashlib.sha256(data).hexdigest()}
    replace_text(path.with_name(LIST), "".join(f"{sums[name]}  {name}\n" for name in sorted(sums)))
    return path


def checksums(folder: Path) -> dict[str, str]:
    """The checksums in the list of a folder, by the names of their files; lines that are damaged are left out."""
    return {match[2]: match[1] for line in _lines(folder) if (match := _LINE.fullmatch(line))}


def damaged_lines(folder: Path) -> int:
    """Number of lines of the list of a folder that hold no checksum."""
    return sum(_LINE.fullmatch(line) is None for line in _lines(folder))


def _lines(folder: Path) -> list[str]:
    path = folder / LIST
    refuse_irregular(path, CubeError)
    try:
        with path.open("rb") as stream:
            text = stream.read(_LARGEST)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise CubeError(f"{path}: cannot read this file: {error.strerror}") from error
    return text.decode(errors="replace").rstrip("\n").split("\n") if text else []


def is_changed(path: Path) -> bool:
    """Whether a file does not fit its checksum; one that is missing, or has no checksum, is not changed."""
    version, since = _version(path), time.monotonic()
    while time.monotonic() < since + _SETTLED:
        expected = checksums(path.parent).get(path.name)
        if expected is None:
            return False
        refuse_irregular(path, CubeError)
        try:
            if hashlib.sha256(path.read_bytes()).hexdigest() == expected:
                return False
        except OSError:  # what reads it states the reason
            return False
        time.sleep(_PAUSE)
        if _version(path) != version:
            version, since = _version(path), time.monotonic()
    return True


def _version(path: Path) -> list[tuple[int, int]]:
    """What changes when a file or the list beside it is replaced."""
    states = [place.stat() for place in (path, path.with_name(LIST)) if place.exists()]
    return [(state.st_ino, state.st_mtime_ns) for state in states]


def refuse_changed(path: Path) -> None:
    """Refuse a file that does not fit its checksum.

    Raises:
        CubeError: With the remedy.
    """
    if is_changed(path):
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
