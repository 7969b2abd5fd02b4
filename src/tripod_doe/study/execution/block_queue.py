"""The queue of points to compute, cut into blocks of about equal duration, each of one kind of points.

A block has one CPU time, shared by its points: in a mixed block, points of a cheap model would get part of others'
cost.
"""

import math

import numpy as np

from tripod_doe.array_types import IntArray

_FIRST_BLOCK = 1  # a point may take seconds; the first result shows its cost
_LARGEST_GROWTH = 32
_SMALLEST_SHARE = 16  # the last blocks shrink to this part of the usual ones
_MOST_BYTES = 32_000_000  # of the results of a block
_FAIR_SAMPLE_SECONDS = 0.2  # a shorter block is mostly overhead, and does not show the cost of a point


class BlockQueue:
    """Points to compute.

    Args:
        block: Points per block; None sizes blocks by the duration of the finished ones.
        seconds: Smallest duration of a block to aim at.
        kinds: Number of the kind of each waiting point (its model and method), shape (waiting,); None if all are equal.
    """

    def __init__(
        self, waiting: IntArray, block: int | None = None, seconds: float = 1.0, kinds: IntArray | None = None
    ) -> None:
        self._target = seconds
        self._kinds = np.zeros(waiting.size, np.int64)
        if kinds is not None and waiting.size:
            order = np.argsort(kinds, kind="stable")
            waiting, self._kinds = waiting[order], kinds[order]
        self._kind_of: dict[int, int] = {}  # of the blocks at work, by their first point
        self._start = 0
        self._waiting = waiting
        self._returned: list[IntArray] = []
        self._fixed = block
        self._size = block or _FIRST_BLOCK
        self._seconds_per_point: float | None = None

    def __len__(self) -> int:
        return self._waiting.size - self._start + sum(block.size for block in self._returned)

    def take(self, slots: int) -> IntArray | None:
        """The next block, None from an empty queue; the last ones are small, so that all slots become free together."""
        if self._returned:
            return self._returned.pop()
        left = self._waiting.size - self._start
        if left == 0:
            return None
        size = self._fixed or max(min(self._size, -(-left // slots)), self._size // _SMALLEST_SHARE, 1)
        begin, kind = self._start, self._kinds[self._start]
        border = int(np.searchsorted(self._kinds, kind, side="right"))
        self._start = min(begin + size, border)
        if self._start == border < self._waiting.size and not self._fixed:
            self._size = _FIRST_BLOCK  # the next kind has another cost
        block = self._waiting[begin : self._start]
        self._kind_of[int(block[0])] = int(kind)
        return block

    def halve(self, block: IntArray) -> None:
        """Put a block back as two halves."""
        kind = self._kind_of.pop(int(block[0]), 0)
        for half in (half for half in np.array_split(block, 2) if half.size):
            self._kind_of[int(half[0])] = kind
            self._returned.append(half)

    def learn(self, seconds: float, block: IntArray, size: int = 0) -> None:
        """Size the next blocks by the time of a block, and by the bytes of its results."""
        kind, count = self._kind_of.pop(int(block[0]), 0), block.size
        if self._start < self._waiting.size and kind != self._kinds[self._start]:
            return  # the next blocks are of another kind
        if seconds >= _FAIR_SAMPLE_SECONDS:
            self._seconds_per_point = seconds / count
        if self._fixed is None and seconds > 0:
            wanted = min(math.ceil(self._target * count / seconds), _MOST_BYTES * count / max(size, 1))
            self._size = int(min(max(wanted, 1), _LARGEST_GROWTH * max(self._size, count)))

    def expect(self, seconds: float, count: int) -> None:
        """Use the time of an unfinished block of `count` points as a lower bound of the cost."""
        self._seconds_per_point = max(self._seconds_per_point or 0.0, seconds / count)

    @property
    def seconds_left(self) -> float:
        """Estimated time of the queue in one process; 0 until a block was long enough for an estimate."""
        return len(self) * (self._seconds_per_point or 0.0)
