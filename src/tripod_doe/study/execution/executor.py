"""The interface of executors, which run blocks of points, and their answers."""

from dataclasses import dataclass
from typing import Protocol

from tripod_doe.array_types import IntArray
from tripod_doe.model_interface import BlockResult
from tripod_doe.study.execution.task import Task


@dataclass(frozen=True)
class Answer:
    """Results and cost of a block."""

    result: BlockResult  # its results
    # cpu_seconds, wall_seconds: time of all its points, without compilation
    cpu_seconds: float
    wall_seconds: float
    worker: str  # name of the process in which it ran


@dataclass(frozen=True)
class Lost:
    """A block that ended the process in which it ran."""

    reason: str  # of the points, as their detail


@dataclass(frozen=True)
class AtWork:
    """A block that is not finished yet."""

    seconds: float  # time since it was taken


class Executor(Protocol):
    """Runs blocks of points."""

    @property
    def busy(self) -> int:
        """Number of blocks at work."""
        ...

    @property
    def slots(self) -> int:
        """Number of blocks that it takes before the first one is finished."""
        ...

    def submit(self, block: IntArray, task: Task) -> None:
        """Take a block to run."""
        ...

    def next_finished(self) -> tuple[IntArray, Answer | Lost | AtWork] | None:
        """Wait for one of the blocks at work, or until it lasts long; an interrupt ends the waiting.

        None if the caller must count free slots again.
        """
        ...

    def close(self) -> None:
        """Drop the blocks at work."""
        ...
