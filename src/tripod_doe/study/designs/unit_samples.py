"""Samples on the unit cube of which any rows can be made alone, so that a long one never has to be in memory."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError

Indices = NDArray[np.integer[Any]]

_BITS = 30  # of the numbers of SciPy's Sobol' sequences
_STRETCH_BITS = 13
_GAP = 64  # points that are rather made in vain than that a sequence is wound forward again


class UnitSample(Protocol):
    """Points on the unit cube."""

    @property
    def count(self) -> int:
        """Number of points."""
        ...

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points, shape (row, factor)."""
        ...


@dataclass(frozen=True)
class HeldSample:
    """Points in memory."""

    points: FloatArray  # the points, shape (point, factor)

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.points)

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        return self.points[rows]


class SobolSample:
    """A Sobol' sequence of `scipy.stats.qmc`, at any rows.

    As integers, a point is the bitwise sum of one direction for every bit of its number (Antonov and Saleev 1979: of
    its Gray code, which is linear in these bits). So it is that of the point with its low bits alone and of the
    directions of its high bits; both are tabulated from SciPy's points.

    Parameters
    ----------
    engine
        A fresh sequence.
    count
        Number of points.

    Raises
    ------
    InputError
        If the sequence has fewer points.
    """

    def __init__(self, engine: Any, count: int) -> None:
        if count > 1 << _BITS:
            raise InputError(f"a Sobol' sequence has {1 << _BITS:,} points, not {count:,}")
        self._count, stretch = count, 1 << _STRETCH_BITS
        self._low = _as_integers(engine.random(stretch))
        self._high = np.zeros((-(-count // stretch), self._low.shape[1]), np.uint32)
        for bit in range((len(self._high) - 1).bit_length()):
            own = slice(1 << bit, min(2 << bit, len(self._high)))
            engine.fast_forward((stretch << bit) - engine.num_generated)
            direction = _as_integers(engine.random(1))[0] ^ self._low[0]
            self._high[own] = self._high[: own.stop - own.start] ^ direction

    @property
    def count(self) -> int:
        """Number of points."""
        return self._count

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        low, high = self._low[rows & ((1 << _STRETCH_BITS) - 1)], self._high[rows >> _STRETCH_BITS]
        return np.asarray((low ^ high) * 0.5**_BITS, float)


def _as_integers(points: FloatArray) -> NDArray[np.uint32]:
    return (points * 2.0**_BITS).astype(np.uint32)  # exact: they are such fractions


class HaltonSample:
    """A Halton sequence of `scipy.stats.qmc`, at any rows.

    Parameters
    ----------
    engine
        A fresh sequence.
    count
        Number of points.
    """

    def __init__(self, engine: Any, count: int) -> None:
        self._engine, self._count = engine, count

    @property
    def count(self) -> int:
        """Number of points."""
        return self._count

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        return _by_stretches(rows, self._engine.d, self._stretch)

    def _stretch(self, first: int, count: int) -> FloatArray:
        """Consecutive points."""
        return np.asarray(copy.copy(self._engine).fast_forward(first).random(count), float)


class RandomSample:
    """Independent points: NumPy's stream of random numbers, entered where the points begin.

    Parameters
    ----------
    count
        Number of points.
    width
        Numbers of a point.
    seed
        Of the stream.
    """

    def __init__(self, count: int, width: int, seed: int) -> None:
        self._count, self._width, self._seed = count, width, seed

    @property
    def count(self) -> int:
        """Number of points."""
        return self._count

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        return _by_stretches(rows, self._width, self._stretch)

    def _stretch(self, first: int, count: int) -> FloatArray:
        """Consecutive points."""
        stream = np.random.PCG64(self._seed).advance(first * self._width)  # one step a number
        return np.random.Generator(stream).random((count, self._width))


def _by_stretches(rows: Indices, width: int, stretch: Callable[[int, int], FloatArray]) -> FloatArray:
    """Rows in any order from what gives consecutive ones: those that ascend and are near to each other together."""
    steps = np.diff(rows)
    parts = [np.empty((0, width))]
    for own in np.split(rows, np.flatnonzero((steps < 0) | (steps > _GAP)) + 1):
        if own.size:
            first = int(own[0])
            parts.append(stretch(first, int(own[-1]) + 1 - first)[own - first])
    return np.concatenate(parts)


@dataclass(frozen=True)
class SaltelliSample:
    """Saltelli's blocks (2002) as SALib orders them: sample A, A with some factors of B, B with some of A, sample B."""

    # sequences whose points are those of A and B side by side, shape (row, 2 factor); blocks take them by turns
    pairs: Sequence[UnitSample]
    from_b: NDArray[np.bool_]  # which factors each point of a block has from B, shape (point of a block, factor)

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.from_b) * sum(pair.count for pair in self.pairs)

    def at(self, rows: Indices) -> FloatArray:
        """Some of the points."""
        blocks, members = np.divmod(rows, len(self.from_b))
        samples, turns = np.divmod(blocks, len(self.pairs))
        width = self.from_b.shape[1]
        both = np.empty((rows.size, 2 * width))
        for turn, pair in enumerate(self.pairs):
            own = turns == turn
            both[own] = pair.at(samples[own])
        return np.where(self.from_b[members], both[:, width:], both[:, :width])
