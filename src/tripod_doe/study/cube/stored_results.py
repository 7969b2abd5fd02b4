"""Where the newest result of every point stands in a journal, so that any stretch of the points can be read alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from tripod_doe.study.cube.dataset import PlacedBlock
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.study_points import StudyPoints


class StoredResults:
    """The finished blocks of a study by the points that they hold, in eight bytes a point.

    Parameters
    ----------
    asked
        The study and its points.
    blocks
        All finished blocks, the newest last, each as a function that reads it.

    Attributes
    ----------
    point_bytes
        The most bytes that the outputs of a point have.
    """

    def __init__(self, asked: StudyPoints, blocks: Iterable[Callable[[], FinishedBlock]]) -> None:
        self._block = np.full(asked.points.count, -1, np.int32)
        self._row = np.zeros(asked.points.count, np.int32)
        self._read: list[Callable[[], FinishedBlock]] = []
        self.point_bytes = 0
        for number, read in enumerate(blocks):
            block = read()
            rows, at = asked.index.places(block.keys)
            self._block[at], self._row[at] = number, rows
            self._read.append(read)
            self.point_bytes = max(self.point_bytes, block.result.nbytes // max(block.keys.size, 1))
        self._block[~asked.points.allowed] = -1

    def between(self, start: int, stop: int) -> Iterator[PlacedBlock]:
        """The blocks that hold some consecutive points, with their rows and the places of these after the first."""
        numbers, rows = self._block[start:stop], self._row[start:stop]
        order = np.argsort(numbers, kind="stable")
        for at in np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1):
            if at.size and numbers[at[0]] >= 0:
                yield self._read[numbers[at[0]]](), rows[at].astype(np.int64), at
