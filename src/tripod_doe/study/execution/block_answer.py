"""Answers of executors, which run blocks of points."""

from dataclasses import dataclass

from tripod_doe.model_interface import BlockResult


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
