"""Fingerprints of points from all parameters, to find results in an index."""

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Column, Points

Keys = NDArray[np.void]
"""Fingerprints, shape (point,), 16 bytes each."""

_CHUNK = 10_000  # points whose parameters are held at once


def point_keys(study: Study, points: Points) -> NDArray[np.void]:
    """A fingerprint of each point from the values of all its parameters, shape (point,), 16 bytes each.

    It does not depend on which parameters are factors, so that an extended study reuses its old points.
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
        return digest.digest()

    keys = np.empty(points.count, "V16")
    rows = np.repeat(_numbers(fixed, rest, 1), min(_CHUNK, points.count), axis=0)
    at = [rest.index(name) for name in points.setting_names]
    for first in range(0, points.count, _CHUNK):
        own = rows[: points.count - first]
        own[:, at] = _numbers(points.at(slice(first, first + len(own))), points.setting_names, len(own))
        keys[first : first + len(own)] = np.frombuffer(b"".join(map(fingerprint, own)), "V16")
    return keys


def _digest_of_names(study: Study, names: Sequence[str]) -> Any:
    """The beginning of all fingerprints: simulator, names of parameters, and accuracy."""
    named = [study.simulator.name, *names, *([study.accuracy.text] if study.accuracy else [])]
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
    """Places of fingerprints, by binary search.

    Args:
        keys: Fingerprints, shape (point,), of which some may be repeated.
    """

    def __init__(self, keys: Keys) -> None:
        self._order = np.argsort(keys, kind="stable")
        self._sorted = keys[self._order]

    def first_of_each(self) -> NDArray[np.bool_]:
        """Whether a point is the first one with its fingerprint, shape (point,)."""
        first = np.ones(self._order.size, bool)
        first[self._order[1:]] = self._sorted[1:] != self._sorted[:-1]
        return first

    def places(self, wanted: Keys) -> tuple[IntArray, IntArray]:
        """Rows of the wanted fingerprints, one for each point that has it, and these points; none if unknown."""
        begins = np.searchsorted(self._sorted, wanted)
        counts = np.searchsorted(self._sorted, wanted, side="right") - begins
        rows = np.repeat(np.arange(wanted.size), counts)
        return rows, self._order[np.repeat(begins - (np.cumsum(counts) - counts), counts) + np.arange(rows.size)]
