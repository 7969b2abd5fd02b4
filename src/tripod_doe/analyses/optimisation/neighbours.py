"""Candidates one step of one variable away from some of the front, which show how sensitive it is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.analyses.optimisation.pareto_front import Archive
from tripod_doe.analyses.optimisation.search import steps_around
from tripod_doe.analyses.optimisation.variables import Variables
from tripod_doe.array_types import FloatArray, IntArray

_STEP = 0.05  # of a range, by which a variable changes; levels go to the next one


@dataclass(frozen=True)
class Neighbours:
    """Candidates around some of a front, and how the search judges both."""

    centres: IntArray  # row of the front of each centre, shape (centre,)
    centre: IntArray  # the centre of each neighbour, a place in `centres`, shape (neighbour,)
    variable: IntArray  # the variable that differs, shape (neighbour,)
    units: FloatArray  # on the unit cube, shape (neighbour, variable)
    judged: Judged  # the neighbours
    judged_centres: Judged  # the centres, by the same model and sample

    def changes(self, name: Literal["objectives", "constraints", "violations"]) -> FloatArray:
        """Differences of the neighbours from their centres, shape (neighbour, quantity)."""
        return np.asarray(getattr(self.judged, name) - getattr(self.judged_centres, name)[self.centre])

    def violations(self, front: Judged) -> FloatArray:
        """Violations: those of the front with what the step changes, shape (neighbour, constraint)."""
        return np.asarray(front.violations[self.centres[self.centre]] + self.changes("violations"))

    def reasons(self, front: Judged, constraints: Sequence[str]) -> list[str]:
        """Why neighbours are not feasible, empty where they are."""
        far = self.violations(front)
        finished = np.asarray(np.isfinite(np.column_stack([self.judged.objectives, far])).all(axis=1))
        reasons = []
        for row, reason in enumerate(self.judged.reasons):
            broken = [name for name, each in zip(constraints, far[row].tolist(), strict=True) if each > 0]
            kept = f"does not keep {', '.join(broken)}" if broken else ""
            reasons.append(kept if finished[row] else reason or "not known")
        return reasons


def around(
    front: Archive, rows: Sequence[int], variables: Variables
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """The neighbours of some candidates of a front.

    Returns:
        centres : ndarray, shape (centre,): the rows, each once
        centre, variable : ndarray, shape (neighbour,)
        units : ndarray, shape (neighbour, variable)
    """
    centres = list(dict.fromkeys(rows))
    steps = [
        (number, at, unit)
        for number, row in enumerate(centres)
        for at, unit in steps_around(variables, front.units[row], _STEP)
    ]
    units = np.array([unit for *_, unit in steps]).reshape(-1, len(variables.chosen))
    centre, variable = (np.array([step[part] for step in steps], int) for part in (0, 1))
    return np.array(centres, int), centre, variable, variables.snapped(units)
