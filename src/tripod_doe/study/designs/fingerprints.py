"""Fingerprints of points, by which results are recognised."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tripod_doe.study.definition import Study
from tripod_doe.study.designs.points import Column, Points

__all__ = ["point_keys"]

_CHUNK = 10_000  # points whose full parameter lists are held at once


def point_keys(study: Study, points: Points) -> NDArray[np.void]:
    """A fingerprint of each point from the values of all its parameters, shape (point,), 16 bytes each.

    It does not depend on which parameters are factors, so that a study that grew finds its old points again.
    """
    chunks = [
        _fingerprints(study, {name: column[start : start + _CHUNK] for name, column in points.settings.items()}, count)
        for start in range(0, points.count, _CHUNK)
        for count in [min(_CHUNK, points.count - start)]
    ]
    return np.frombuffer(b"".join(chunks), dtype="V16")


def _fingerprints(study: Study, columns: Mapping[str, Column], count: int) -> bytes:
    """Fingerprints of some points, one after the other."""
    full = study.simulator.columns(study.base, columns, count)
    matrix = np.empty((count, len(full)))
    for position, name in enumerate(sorted(full)):
        column = full[name]
        if column.dtype == object:
            words, inverse = np.unique(column.astype(str), return_inverse=True)
            codes = [hashlib.blake2b(word.encode(), digest_size=8).digest() for word in words]
            matrix[:, position] = np.frombuffer(b"".join(codes))[inverse]
        else:
            matrix[:, position] = np.where(column == 0, 0.0, column)  # -0.0 is the same point as 0.0
    named = [study.simulator.name, *sorted(full), *([study.demands.text] if study.demands else [])]
    start = hashlib.blake2b("\n".join(named).encode(), digest_size=16)

    def fingerprint(row: NDArray[np.float64]) -> bytes:
        digest = start.copy()
        digest.update(row.tobytes())
        return digest.digest()

    return b"".join(fingerprint(row) for row in matrix)
