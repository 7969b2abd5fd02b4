"""Errors for people: what is wrong, where, and what to do about it.

Outcomes (`tripod_doe.simulator`) are for cubes: a point that fails is a flagged cell, never an exception.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["CubeError", "InputError", "StorageError", "TripodDoeError", "closest", "near_match"]

_FEW = 16  # names that can still be read at a glance


class TripodDoeError(Exception):
    """Base of every error this package raises on purpose; its text is meant to be read by a user."""


class InputError(TripodDoeError):
    """A call, a study file or a parameter that cannot be used; nothing was started (exit code 2)."""


class CubeError(InputError):
    """A result cube or journal that is missing, damaged or does not hold what was asked for (exit code 2)."""


class StorageError(TripodDoeError):
    """Writing failed in mid-run, for instance on a full disk; finished points stay in the journal (exit code 1)."""


def near_match(name: str, known: Iterable[str]) -> str:
    """Say which known name was probably meant, as the end of a sentence.

    Parameters
    ----------
    name
        The name that is not known.
    known
        All names that would have been.

    Returns
    -------
    str
        ``"; did you mean 'rollers'? allowed: equilibrium, rollers, needles"``; many names are not listed beside a near
        match, and no name gives an empty string.
    """
    names = list(known)
    meant = closest(name, names)
    if not names or (meant and len(names) > _FEW):
        return meant
    return f"{meant or ';'} allowed: {', '.join(names)}"


def closest(name: str, known: Iterable[str]) -> str:
    """Say which known name was probably meant, without listing the others: ``"; did you mean 'a.toml'?"`` or empty."""
    matches = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f"; did you mean {matches[0]!r}?" if matches else ""
