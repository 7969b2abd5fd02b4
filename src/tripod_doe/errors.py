"""Errors for people: they name the fault, its place and the remedy.

Outcomes (`tripod_doe.model_interface`) are for cubes: a point that fails is a flagged cell, never an exception.
"""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Literal, Self, TypeVar

Item = TypeVar("Item")

MOST_MESSAGES = 20
"""Messages about one file."""

_FEW = 16  # names that can still be read at a glance
_MANY = 20  # names above which only similar ones are listed
_MOST_MEANT = 4
_MOST_SIMILAR = 10
_NEAR, _NEAR_SHORT = 0.75, 0.6  # by difflib's ratio: two wrong letters in eight; one or two in a word of four
_MISSPELT = 0.9  # the same, of a name with a wrong letter or two
_LONGEST_LINE = 4_000  # characters
_MOST_LINES = 200
_LONGEST_NAME = 100  # characters of a name for which near ones are looked for
_SYNONYMS = {"mu": "friction", "cof": "friction", "roller": "groove", "bearing": "needle"}  # words for those of names
_THRUST = {
    "fx",
    "gaf",
    "axial force",
    "generated axial force",
    "thrust force",
    "axialkraft",
}  # usual names of the thrust
_ORDER = re.compile(r"[afh]_?\d{1,2}|(order|harmonic)_?\d{1,2}|\d[a-z]{2}_order", re.IGNORECASE)  # of the thrust
_CONTROL = re.compile(
    r"[^\S\n ]|[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]"
)
_spoken: Literal["arguments", "options", "keys"] = "arguments"
"""What the user of this process writes: Python's arguments, options of a command line, or keys of a file."""


class TripodDoeError(Exception):
    """Base of every error this package raises on purpose; its text is written for the user.

    Messages repeat what is in files and requests: control characters are written as escapes, so that none reaches a
    terminal, and long lines and lists are cut.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(_readable(str(message)))


class InputError(TripodDoeError):
    """A call, a study file or a parameter that cannot be used; nothing was started (exit code 2)."""

    def at(self, place: str) -> Self:
        """The same error with a place (file, table, key) before every line of its message."""
        return type(self)("\n".join(f"{place}: {line}" for line in str(self).splitlines()))


class ForbiddenError(InputError):
    """Something that a file from a stranger may not ask for: a function, or a file from elsewhere."""


class TooLargeError(InputError):
    """Something that goes beyond a limit of the reader of a file."""


class CubeError(InputError):
    """A result cube or journal that is missing, damaged or does not hold what was asked for (exit code 2)."""


class StorageError(TripodDoeError):
    """Writing failed in mid-run, for instance on a full disk; finished points stay in the journal (exit code 1)."""


def speaking_of_options() -> AbstractContextManager[None]:
    """Within this block, messages speak of options of the command line; elsewhere of Python's arguments."""
    return _speaking_of("options")


def speaking_of_keys() -> AbstractContextManager[None]:
    """Within this block, messages speak of keys of a file."""
    return _speaking_of("keys")


@contextmanager
def _speaking_of(spoken: Literal["options", "keys"]) -> Iterator[None]:
    global _spoken
    before, _spoken = _spoken, spoken
    try:
        yield
    finally:
        _spoken = before


def option(name: str, value: object = None) -> str:
    """An argument as the user of this process wrote or would write it.

    Args:
        value: What was given; True for a switch.

    Returns:
        ``--retry-failed`` or ``retry_failed=True``, ``--out 'my results'``, quoted where a shell needs it, or
        ``out='my results'``; in a file, where ``column`` is a table of names, ``sign = -1`` or
        ``columns.thrust_n = 'Force'``.
    """
    if _spoken == "keys":
        if name == "column":
            role, _, heading = str(value).partition("=")
            return f"columns.{role} = {heading!r}"
        return name if value is None else f"{name} = {value!r}"
    if _spoken == "options":
        shown = "" if value is None or value is True else f" {shlex.quote(str(value))}"
        return f"--{name.replace('_', '-')}{shown}"
    return name if value is None else f"{name}={value!r}"


def printable(text: str) -> str:
    """A text with escapes for what may change more of a terminal than a place: control characters but line ends."""
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def _readable(message: str) -> str:
    lines = printable(message).split("\n")
    if len(lines) > _MOST_LINES:
        lines = [*lines[:_MOST_LINES], f"... and {len(lines) - _MOST_LINES:,} lines more"]
    return "\n".join(line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}..." for line in lines)


def first_messages(items: Sequence[Item], message: Callable[[Item], str]) -> list[str]:
    """Messages about the first of some wrong items, and the number of the others, whose messages are not made.

    Args:
        message: Makes the message about one; it may look for near matches, which takes long.
    """
    lines = [message(item) for item in items[:MOST_MESSAGES]]
    return lines if len(items) <= MOST_MESSAGES else [*lines, f"and {len(items) - MOST_MESSAGES:,} more like these"]


def near_match(name: str, known: Iterable[str]) -> str:
    """Say which known name was probably meant, as the end of a sentence.

    Returns:
        ``"; did you mean 'rollers'? allowed: equilibrium, rollers, needles"``; of many names the near match alone, or
        the ten most similar ones; no name gives an empty string.
    """
    names = list(known)
    meant = closest(name, names)
    if not names or (meant and len(names) > _FEW):
        return meant
    if len(names) > _MANY:
        similar = difflib.get_close_matches(name[:_LONGEST_NAME], names, n=_MOST_SIMILAR, cutoff=0.0)
        return f"; the most similar of {len(names):,} names: {', '.join(similar)}"
    return f"{meant or ';'} allowed: {', '.join(names)}"


def misspelt(name: str, known: Iterable[str]) -> str:
    """The known name that a name, which need not be known, is but for a letter or two; else empty."""
    near = difflib.get_close_matches(name[:_LONGEST_NAME], list(known), n=1, cutoff=_MISSPELT)
    return near[0] if near and name not in known else ""


def closest(name: str, known: Iterable[str]) -> str:
    """Say which known name was probably meant, without listing the others: ``"; did you mean 'a.toml'?"`` or empty.

    Meant are the shortest names that begin so, those that hold all words of the name (speed_rpm for speed, the sliding
    friction for a friction), or one with nearly the same letters.
    """
    names = list(known)
    if len(name) > _LONGEST_NAME:
        return ""
    longer = sorted((other for other in names if len(name) > 4 and other.startswith(name)), key=len)
    longer = [other for other in longer if len(other) == len(longer[0])]
    cutoff = _NEAR if len(name) > 4 else _NEAR_SHORT
    near = difflib.get_close_matches(name, names, n=1, cutoff=cutoff)
    words = set(re.findall(r"[^\W_]+", name))
    if " ".join(re.findall(r"[^\W_]+", name.lower())) in _THRUST:
        near = [other for other in ("thrust", "thrust_amplitude") if other in names] or near
    if _ORDER.fullmatch(name):
        near = [other for other in ("thrust_amplitude",) if other in names] or near
    same_words = _with_words(words, names) or _with_words({_SYNONYMS.get(word, word) for word in words}, names)
    by_words = len(words) > 1 and 0 < len(same_words) <= _MOST_MEANT
    meant = longer or (same_words if by_words else near or same_words)
    return f"; did you mean {' or '.join(map(repr, meant))}?" if 0 < len(meant) <= _MOST_MEANT else ""


def _with_words(words: set[str], names: Sequence[str]) -> list[str]:
    """Names that hold all these words; of several frictions those of sliding."""
    holding = [other for other in names if words and words <= set(re.findall(r"[^\W_]+", other))]
    if "friction" in words:
        return [other for other in holding if "sliding" in other] or holding
    return holding
