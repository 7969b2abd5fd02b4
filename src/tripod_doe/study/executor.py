"""What runs blocks of points, and what it gives back: an answer, or the news that a block took its process down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tripod_doe.simulator import BlockResult
from tripod_doe.study.task import Task

__all__ = ["Answer", "AtWork", "Executor", "Lost"]


@dataclass(frozen=True)
class Answer:
    """What a block gave.

    Attributes
    ----------
    result
        Its results.
    cpu_seconds, wall_seconds
        Time of all its points, without compilation.
    worker
        Name of the process in which it ran.
    """

    result: BlockResult
    cpu_seconds: float
    wall_seconds: float
    worker: str


@dataclass(frozen=True)
class Lost:
    """A block that took down the process in which it ran.

    Attributes
    ----------
    reason
        What was seen of it.
    """

    reason: str


@dataclass(frozen=True)
class AtWork:
    """A block that is not finished yet.

    Attributes
    ----------
    seconds
        Time since it was taken.
    """

    seconds: float


class Executor(Protocol):
    """Something that runs blocks of points."""

    @property
    def busy(self) -> int:
        """Blocks at work."""
        ...

    @property
    def slots(self) -> int:
        """Blocks that it can take before the first one is finished."""
        ...

    def submit(self, block: NDArray[np.int64], task: Task) -> None:
        """Take a block to run."""
        ...

    def next_finished(self) -> tuple[NDArray[np.int64], Answer | Lost | AtWork] | None:
        """Wait for one of the blocks at work, or until it lasts long; an interrupt ends the waiting.

        None where it is time to look whether there is room for more blocks.
        """
        ...

    def close(self) -> None:
        """Drop the blocks at work."""
        ...
