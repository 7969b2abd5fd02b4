"""Fingerprints of the points of a study: which are repeated, and where given ones stand among them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray

if TYPE_CHECKING:  # a plan does without it, which saves 0.3 s
    import pandas

Keys = NDArray[np.void]


class KeyIndex:
    """Places of fingerprints, in a hash table of their first halves.

    Parameters
    ----------
    keys
        Fingerprints, shape (point,), 16 bytes each; some may stand there several times.
    """

    def __init__(self, keys: Keys) -> None:
        self._keys = keys

    @cached_property
    def _repeated(self) -> bool:
        """Whether some halves stand there several times."""
        ordered = np.sort(_first_halves(self._keys))
        return bool((ordered[1:] == ordered[:-1]).any())

    def first_of_each(self) -> NDArray[np.bool_]:
        """Whether a point is the first one with its fingerprint, shape (point,)."""
        first = np.full(self._keys.size, not self._repeated)
        if self._repeated:
            first[np.unique(self._keys, return_index=True)[1]] = True
        return first

    def places(self, wanted: Keys) -> tuple[IntArray, IntArray]:
        """Rows of some fingerprints and the indices where they stand; a strange one stands nowhere."""
        table = self._table
        codes = table.places_of(wanted)
        rows = np.flatnonzero(codes >= 0)
        codes = codes[rows]
        same = self._keys[table.repeats.first(codes) if table.repeats else codes] == wanted[rows]
        rows, codes = rows[same], codes[same]
        return table.repeats.places(rows, codes) if table.repeats else (rows, codes)

    @cached_property
    def _table(self) -> _Table:
        import pandas

        words = _first_halves
        if not self._repeated:
            return _Table(words, pandas.Index(words(self._keys)))
        codes, distinct = pandas.factorize(words(self._keys))
        if not (self._keys == self._keys[_Repeats.of(codes).first(codes)]).all():
            words = _texts  # as different ones share their first halves
            codes, distinct = pandas.factorize(words(self._keys))
        return _Table(words, pandas.Index(distinct), _Repeats.of(codes))


@dataclass(frozen=True)
class _Repeats:
    """Places of each distinct fingerprint: stretches of `order`, from one of `begins` to the next."""

    order: IntArray
    begins: IntArray

    @classmethod
    def of(cls, codes: IntArray) -> _Repeats:
        """Sort places by the number of the fingerprint that stands there."""
        return cls(np.argsort(codes, kind="stable"), np.concatenate([[0], np.cumsum(np.bincount(codes))]))

    def first(self, codes: IntArray) -> IntArray:
        """Where some distinct fingerprints stand first."""
        return self.order[self.begins[codes]]

    def places(self, rows: IntArray, codes: IntArray) -> tuple[IntArray, IntArray]:
        """Rows of wanted fingerprints, each as often as it stands there, and the places."""
        counts = self.begins[codes + 1] - self.begins[codes]
        shifts = np.repeat(self.begins[codes] - (np.cumsum(counts) - counts), counts)
        return np.repeat(rows, counts), self.order[shifts + np.arange(shifts.size)]


@dataclass(frozen=True)
class _Table:
    """The hash table."""

    words: Callable[[Keys], NDArray[Any]]  # what stands in the table of fingerprints
    distinct: pandas.Index[Any]
    repeats: _Repeats | None = None  # where fingerprints stand of which some are repeated

    def places_of(self, wanted: Keys) -> IntArray:
        """Places of fingerprints in the table, -1 for strange ones."""
        return np.asarray(self.distinct.get_indexer(self.words(wanted)), np.int64)  # type: ignore[arg-type]


def _first_halves(keys: Keys) -> NDArray[Any]:
    return np.ascontiguousarray(np.ascontiguousarray(keys).view(np.uint64).reshape(-1, 2)[:, 0])


def _texts(keys: Keys) -> NDArray[Any]:
    return np.array([key.tobytes() for key in keys], object)
