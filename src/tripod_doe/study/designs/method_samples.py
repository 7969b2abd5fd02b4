"""Samples of sensitivity methods at any rows, to the last bit those of SALib, in a fraction of their memory."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.study.designs.unit_samples import Indices

_SKIPPED, _STEP = 1024, 0.01  # SALib's: points at the beginning of its sequence, and the part by which a value is moved


class CurveSample:
    """Search curves of extended FAST, one for each factor, along which it varies fastest (Saltelli and others 1999).

    Parameters
    ----------
    width
        Number of factors.
    length
        Points of a curve.
    harmonics
        Multiples of a factor's frequency that count as its own.
    seed
        Of the shifts of the curves.
    """

    def __init__(self, width: int, length: int, harmonics: int, seed: int) -> None:
        fast = (length - 1) // (2 * harmonics)
        slow, others = fast // (2 * harmonics), width - 1
        apart = np.floor(np.linspace(1, slow, others)) if slow >= others else np.arange(others) % slow + 1.0
        self._frequencies = np.stack([np.insert(apart, at, fast) for at in range(width)])
        self._shifts = 2 * np.pi * np.random.default_rng(seed).random(width)
        self._length = length

    @property
    def count(self) -> int:
        """Number of points."""
        return self._length * len(self._shifts)

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        curves, places = np.divmod(rows, self._length)
        turns = (2 * np.pi / self._length) * places
        angles = self._frequencies[curves] * turns[:, None] + self._shifts[curves, None]
        return np.asarray(0.5 + (1 / np.pi) * np.arcsin(np.sin(angles)), float)


class DifferenceSample:
    """Points of a sequence, each followed by one step along every factor; only the sequence is in memory.

    Parameters
    ----------
    width
        Number of factors.
    blocks
        Points of the sequence.
    """

    def __init__(self, width: int, blocks: int) -> None:
        from SALib.sample import sobol_sequence

        self._begins = np.asarray(sobol_sequence.sample(blocks + _SKIPPED, width)[_SKIPPED:], float)

    @property
    def count(self) -> int:
        """Number of points."""
        blocks, width = map(int, self._begins.shape)
        return blocks * (width + 1)

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        blocks, members = np.divmod(rows, self._begins.shape[1] + 1)
        points = self._begins[blocks]
        moved = np.flatnonzero(members)
        factors = members[moved] - 1
        begins = points[moved, factors]
        points[moved, factors] = np.clip(begins + begins * _STEP, 0, 1)
        return points
