"""What simulating gives: how each point ended, and its numbers. The one vocabulary of models, journals and cubes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DETAIL_ATTRIBUTES",
    "OUTCOME_ATTRIBUTES",
    "OUTCOME_MEANINGS",
    "BlockResult",
    "Outcome",
    "Retries",
    "Values",
]


class Outcome(IntEnum):
    """What became of one point; the integer is the CF flag value stored in a cube.

    Only `FINISHED` carries numbers that may be used; every other cell holds NaN and a reason.
    """

    FINISHED = 0
    DIVERGED = 1
    INACCURATE = 2
    STEP_LIMIT = 3
    EVALUATION_LIMIT = 4
    TIME_LIMIT = 5
    OUT_OF_RANGE = 6
    JAMMED = 7
    WORKER_LOST = 8
    NOT_APPLICABLE = 9
    NOT_RUN = 10
    ERROR = 11

    @property
    def label(self) -> str:
        """The name used in cubes, tables and study files."""
        return self.name.lower()


OUTCOME_MEANINGS: dict[Outcome, str] = {
    Outcome.FINISHED: "the run passed all its own checks",
    Outcome.DIVERGED: "the state left all bounds or an iteration did not converge",
    Outcome.INACCURATE: "the run ended, but its own checks say that its numbers are wrong",
    Outcome.STEP_LIMIT: "the step fell below its floor",
    Outcome.EVALUATION_LIMIT: "the budget of force evaluations was used up",
    Outcome.TIME_LIMIT: "the wall-clock safety stop was reached",
    Outcome.OUT_OF_RANGE: "the model does not hold for these parameters",
    Outcome.JAMMED: "parts do not fit or cannot move",
    Outcome.WORKER_LOST: "the point took its worker process down",
    Outcome.NOT_APPLICABLE: "the method does not use a numerics parameter that was set",
    Outcome.NOT_RUN: "excluded by a constraint, or not computed yet",
    Outcome.ERROR: "the model raised an error",
}

OUTCOME_ATTRIBUTES: dict[str, Any] = {
    "long_name": "how the point ended",
    "flag_values": np.array(list(Outcome), np.int8),
    "flag_meanings": " ".join(outcome.label for outcome in Outcome),
    "comment": "; ".join(f"{outcome.label}: {text}" for outcome, text in OUTCOME_MEANINGS.items()),
}
"""CF flags of the variable ``outcome``."""

DETAIL_ATTRIBUTES = {"long_name": "why the point failed, or what is to be known of one that finished"}
"""Attributes of the variable ``outcome_detail``."""


@dataclass(frozen=True)
class Values:
    r"""One output of a block of points.

    Attributes
    ----------
    dims
        Dimensions a point.
    data
        Shape (point, \*dims); NaN where a point has no result.
    """

    dims: tuple[str, ...]
    data: NDArray[Any]


@dataclass(frozen=True)
class Retries:
    """What the retry ladder of a study did to a block; every array starts with the point.

    Attributes
    ----------
    attempt
        Changes of the ladder that were made, 0 where the first attempt stands, shape (point,).
    first_outcome, first_detail
        How the first attempt ended, and why it failed or what is to be known of it.
    used
        Values with which the point finished, or was first tried where it never did, of every parameter that the ladder
        may change: floats (NaN where the model has no such number), or words ("" where it has none).
    """

    attempt: NDArray[np.int8]
    first_outcome: NDArray[np.int8]
    first_detail: list[str]
    used: dict[str, NDArray[Any]]


@dataclass(frozen=True)
class BlockResult:
    """What a simulator answers for a block of points; every array starts with the point.

    Attributes
    ----------
    outputs
        Kept outputs by name.
    coordinates
        Labels along the dimensions of the outputs.
    outcome
        `Outcome` values, shape (point,).
    detail
        Why a point failed, or what is to be known of one that finished; mostly empty there.
    steps, force_evaluations, solves
        Counted work, shape (point,); solves are factorisations of a linear system, zero for methods without one.
    simulated_seconds
        Time of the motion that was followed, up to the end or the failure, shape (point,); NaN where there is none.
    retries
        What the retry ladder did, None without one.
    """

    outputs: dict[str, Values]
    coordinates: dict[str, NDArray[Any]]
    outcome: NDArray[np.int8]
    detail: list[str]
    steps: NDArray[np.int64]
    force_evaluations: NDArray[np.int64]
    solves: NDArray[np.int64]
    simulated_seconds: NDArray[np.float64]
    retries: Retries | None = None
