"""Fingerprints of points, by which results are recognised: made of all parameters, and looked up in an index."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Column, Points

if TYPE_CHECKING:  # a plan does without it, which saves 0.3 s
    import pandas

Keys = NDArray[np.void]
"""Fingerprints, shape (point,), 16 bytes each."""

_CHUNK = 10_000  # points whose parameters are held at once


def point_keys(study: Study, points: Points) -> NDArray[np.void]:
    """A fingerprint of each point from the values of all its parameters, shape (point,), 16 bytes each.

    It does not depend on which parameters are factors, so that a study that grew finds its old points again.
    """
    fixed = study.simulator.columns(study.base, points.at(slice(0, 1)), 1)
    names, varied = sorted(fixed), set(points.setting_names)
    shared = next((at for at, name in enumerate(names) if name in varied), len(names))
    rest = names[shared:]
    start = _digest_of_names(study, names)
    start.update(_numbers(fixed, names[:shared], 1).tobytes())

    def fingerprint(row: FloatArray) -> bytes:
        digest = start.copy()
        digest.update(row)
        done: bytes = digest.digest()
        return done

    keys = np.empty(points.count, "V16")
    rows = np.repeat(_numbers(fixed, rest, 1), min(_CHUNK, points.count), axis=0)
    at = [rest.index(name) for name in points.setting_names]
    for first in range(0, points.count, _CHUNK):
        own = rows[: points.count - first]
        own[:, at] = _numbers(points.at(slice(first, first + len(own))), points.setting_names, len(own))
        keys[first : first + len(own)] = np.frombuffer(b"".join(map(fingerprint, own)), "V16")
    return keys


def _digest_of_names(study: Study, names: Sequence[str]) -> Any:
    """The beginning of all fingerprints: what the values belong to."""
    named = [study.simulator.name, *names, *([study.demands.text] if study.demands else [])]
    return hashlib.blake2b("\n".join(named).encode(), digest_size=16)


def _numbers(columns: Mapping[str, Column], names: Sequence[str], count: int) -> FloatArray:
    """Some parameters of some points as numbers, shape (point, name); words by their digests."""
    matrix = np.empty((count, len(names)))
    for position, name in enumerate(names):
        column = columns[name]
        if column.dtype == object:
            words, inverse = np.unique(column.astype(str), return_inverse=True)
            codes = [hashlib.blake2b(word.encode(), digest_size=8).digest() for word in words]
            matrix[:, position] = np.frombuffer(b"".join(codes))[inverse]
        else:
            matrix[:, position] = np.where(column == 0, 0.0, column)  # -0.0 is the same point as 0.0
    return matrix


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
