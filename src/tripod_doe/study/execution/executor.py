"""What runs blocks of points, and what it gives back: an answer, or the news that a block took its process down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tripod_doe.array_types import IntArray
from tripod_doe.simulator import BlockResult
from tripod_doe.study.execution.task import Task


@dataclass(frozen=True)
class Answer:
    """What a block gave."""

    result: BlockResult  # its results
    # cpu_seconds, wall_seconds: time of all its points, without compilation
    cpu_seconds: float
    wall_seconds: float
    worker: str  # name of the process in which it ran


@dataclass(frozen=True)
class Lost:
    """A block that took down the process in which it ran."""

    reason: str  # what was seen of it


@dataclass(frozen=True)
class AtWork:
    """A block that is not finished yet."""

    seconds: float  # time since it was taken


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

    def submit(self, block: IntArray, task: Task) -> None:
        """Take a block to run."""
        ...

    def next_finished(self) -> tuple[IntArray, Answer | Lost | AtWork] | None:
        """Wait for one of the blocks at work, or until it lasts long; an interrupt ends the waiting.

        None where it is time to look whether there is room for more blocks.
        """
        ...

    def close(self) -> None:
        """Drop the blocks at work."""
        ...
