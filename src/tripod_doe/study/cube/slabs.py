"""Slabs: parts of a cube that are processed one after the other, so that only one is in memory.

A slab is a box of cells that are consecutive in the order of the points: all of the last dimensions, a stretch of one,
a single label of those before it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Slab:
    """Consecutive points of a cube."""

    # start, stop: its points, in the order of the design
    start: int
    stop: int
    place: tuple[slice, ...]  # the same as slices along the dimensions of the cube

    @property
    def count(self) -> int:
        """Number of its points."""
        return self.stop - self.start

    @property
    def shape(self) -> tuple[int, ...]:
        """Its lengths along the dimensions of the cube."""
        return tuple(along.stop - along.start for along in self.place)


def box(shape: Sequence[int], cell: int, most: int) -> tuple[int, ...]:
    """The lengths of a slab of limited size, a power of two of cells along the dimension that it divides.

    So slabs and the chunks of a file, which are smaller slabs, fit into each other.

    Args:
        shape: Lengths of the dimensions.
        cell, most: Bytes of a cell, and limit of the bytes of a slab; a single cell may have more.
    """
    for axis, length in enumerate(shape):
        row = cell * math.prod(shape[axis + 1 :])
        if row <= most:
            stretch = 1 << max(most // max(row, 1), 1).bit_length() - 1
            return (1,) * axis + (min(stretch, length),) + tuple(shape[axis + 1 :])
    return (1,) * len(shape)


def slabs(shape: Sequence[int], lengths: Sequence[int]) -> Iterator[Slab]:
    """All slabs of these lengths that make up a cube, in the order of its points."""
    counts = [-(-length // part) for length, part in zip(shape, lengths, strict=True)]
    start = 0
    for at in np.ndindex(*counts):
        place = tuple(
            slice(index * part, min((index + 1) * part, length))
            for index, part, length in zip(at, lengths, shape, strict=True)
        )
        stop = start + math.prod(along.stop - along.start for along in place)
        yield Slab(start, stop, place)
        start = stop
