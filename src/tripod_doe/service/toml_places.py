"""Where a key stands in a TOML text: the line and column that a complaint about it points to."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_NAME = rf"{_PART}(?:[ \t]*\.[ \t]*{_PART})*"
_HEADER = re.compile(rf"^[ \t]*\[\[?[ \t]*({_NAME})[ \t]*\]")
_KEY = re.compile(rf"^[ \t]*({_NAME})[ \t]*=")
_PARTS = re.compile(_PART)
_LONG_STRINGS = ('"""', "'''")


@dataclass(frozen=True)
class Place:
    """A place in a text."""

    # line, column: counted from 1
    line: int
    column: int


def place_of(text: str, path: list[str]) -> Place | None:
    """Find a key, or the innermost table around it that the text writes.

    Parameters
    ----------
    text
        The TOML text; it need not be valid.
    path
        Names of the tables and of the key, from the outside in.

    Returns
    -------
    Place or None
        None where the text writes none of them.
    """
    best: tuple[int, Place] | None = None
    for written, place, line in _written(text):
        depth = len(written)
        if written != path[:depth] or (best and best[0] >= len(path)):
            continue
        column = _inside(line, path[depth:])
        if column is not None:
            return Place(place.line, column)
        if best is None or depth > best[0]:
            best = depth, place
    return best[1] if best else None


@lru_cache(maxsize=4)  # one error may have many complaints about the same text
def _written(text: str) -> list[tuple[list[str], Place, str]]:
    return list(_places(text))


def _places(text: str) -> Iterator[tuple[list[str], Place, str]]:
    """Headers and keys at the start of lines, with their whole paths; what stands in long strings is passed over."""
    table: list[str] = []
    closing = ""
    for number, line in enumerate(text.split("\n"), start=1):
        if closing:
            closing = "" if closing in line else closing
            continue
        if header := _HEADER.match(line):
            table = _names(header[1])
            yield table, Place(number, header.start(1) + 1), ""
        elif key := _KEY.match(line):
            yield table + _names(key[1]), Place(number, key.start(1) + 1), line
        closing = next((quotes for quotes in _LONG_STRINGS if line.count(quotes) == 1), "")


def _names(written: str) -> list[str]:
    return [part.strip("\"'") for part in _PARTS.findall(written)]


def _inside(line: str, rest: list[str]) -> int | None:
    """Column of a key of the inline table on a line; None where there is none, or nothing is left to look for."""
    if not rest or "{" not in line:
        return None
    found = re.search(rf"""[{{,][ \t]*["']?({re.escape(rest[-1])})["']?[ \t]*=""", line)
    return found.start(1) + 1 if found else None
