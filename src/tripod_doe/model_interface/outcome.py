"""Outcomes of points, in models, journals and cubes."""

from collections.abc import Iterable
from enum import IntEnum
from typing import Any

import numpy as np


class Flag(IntEnum):
    """Named numbers without a gap, as CF flags of a cube."""

    @property
    def label(self) -> str:
        """In words."""
        return self.name.lower().replace("_", " ")

    @classmethod
    def attributes(cls, meaning: str) -> dict[str, Any]:
        """Attributes of a variable of these numbers."""
        return cf_flags(meaning, [each.name.lower() for each in cls], min(cls))


def cf_flags(meaning: str, words: Iterable[str], first: int = 0) -> dict[str, Any]:
    """Attributes of a variable of numbers from `first` on, each of which stands for a word."""
    known = list(words)
    values = np.arange(first, first + len(known), dtype=np.int8)
    return {"long_name": meaning, "flag_values": values, "flag_meanings": " ".join(known)}


class Outcome(Flag):
    """How one point ended; the integer is the CF flag value stored in a cube.

    Only `FINISHED` points have numbers; all others hold NaN and a reason.
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
    Outcome.DIVERGED: "the state grew beyond all bounds or an iteration did not converge",
    Outcome.INACCURATE: "the run ended, but failed its own checks of accuracy",
    Outcome.STEP_LIMIT: "the step fell below its lower limit",
    Outcome.EVALUATION_LIMIT: "the budget of force evaluations was used up",
    Outcome.TIME_LIMIT: "the wall-clock safety stop was reached",
    Outcome.OUT_OF_RANGE: "the model does not hold for these parameters",
    Outcome.JAMMED: "parts do not fit or cannot move",
    Outcome.WORKER_LOST: "the worker process that computed the point was lost",
    Outcome.NOT_APPLICABLE: "the method does not use a numerics parameter that was set",
    Outcome.NOT_RUN: "excluded by a constraint, or not computed yet",
    Outcome.ERROR: "the model raised an error",
}

OUTCOME_ATTRIBUTES = Outcome.attributes("how the point ended") | {
    "comment": "; ".join(f"{outcome.label}: {text}" for outcome, text in OUTCOME_MEANINGS.items())
}
"""CF flags of the variable ``outcome``."""

DETAIL_ATTRIBUTES = {"long_name": "reason for failure, or a note on a point that finished"}
"""Attributes of the variable ``outcome_detail``."""
