"""Fingerprints of points, by which results are recognised."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.study.definition import Study
from tripod_doe.study.designs.points import Column, Points

__all__ = ["point_keys"]

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

    def fingerprint(row: NDArray[np.float64]) -> bytes:
        digest = start.copy()
        digest.update(row)
        done: bytes = digest.digest()
        return done

    keys = bytearray()
    for first in range(0, points.count, _CHUNK):
        count = min(_CHUNK, points.count - first)
        columns = {**fixed, **points.at(slice(first, first + count))}
        keys += b"".join(map(fingerprint, _numbers(columns, rest, count)))
    return np.frombuffer(keys, dtype="V16")


def _digest_of_names(study: Study, names: Sequence[str]) -> Any:
    """The beginning of all fingerprints: what the values belong to."""
    named = [study.simulator.name, *names, *([study.demands.text] if study.demands else [])]
    return hashlib.blake2b("\n".join(named).encode(), digest_size=16)


def _numbers(columns: Mapping[str, Column], names: Sequence[str], count: int) -> NDArray[np.float64]:
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
