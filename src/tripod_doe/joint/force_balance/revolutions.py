"""Thrust of single revolutions of a balance whose needles turn, and once they repeat.

A balance is solved with the mean of what its needles do in the last two revolutions, which gives the orders that every
model reports. With what they do in one of them, it is solved from there in two or three sweeps. Of two revolutions the
last but one is as far from their mean as the last: the thrust is all but linear in what changes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.force_balance.kinetostatic_relaxation import NEAR, settle_moving
from tripod_doe.joint.force_balance.needle_correction import Followers
from tripod_doe.joint.force_balance.point_constants import PointConstants
from tripod_doe.joint.force_balance.samples import Memory
from tripod_doe.joint.force_balance.thrust_and_power import thrust_alone
from tripod_doe.joint.outputs import SETTLED, STEP_ERROR
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH

_DIFFERS, _SETTLES = 1e2, 1e1
"""Tolerances of a balance that is solved for a small difference, and for needles that have settled, over its own."""


@dataclass(frozen=True)
class Revolutions:
    """Thrust at each groove in the last revolutions of a block of points."""

    each: FloatArray  # in N, at least two, shape (point, revolution, groove, sample)
    # once needles repeat, shape (point, groove, sample), NaN where that was not asked; and whether they do
    repeating: FloatArray
    repeat: NDArray[np.bool_]
    # mean of the last two with needles in steps of half the size, shape (point, groove, sample), NaN where not asked
    finer: FloatArray
    asked: frozenset[str]  # outputs that need more than each revolution

    @classmethod
    def of(cls, points: int, count: int, samples: int, names: Collection[str]) -> Revolutions:
        """No thrust in a number of revolutions, with what these outputs need."""
        asked = frozenset(names).intersection((SETTLED, STEP_ERROR))
        repeating, finer = (
            np.full((points, 3, samples), 0.0 if name in asked else np.nan) for name in (SETTLED, STEP_ERROR)
        )
        return cls(np.zeros((points, count, 3, samples)), repeating, np.ones(points, bool), finer, asked)

    def all_alike(self, i: int, thrust: FloatArray) -> None:
        """Let all revolutions of point i have the same thrust."""
        self.each[i] = thrust
        if SETTLED in self.asked:
            self.repeating[i] = thrust
        if STEP_ERROR in self.asked:
            self.finer[i] = thrust

    def follow(self, i: int, row: FloatArray, memory: Memory, followers: Followers, mean: FloatArray) -> None:
        """Solve the revolutions of point i, whose balance with the mean of the last two stands in `memory`.

        Args:
            i: The point.
            row: Its constants.
            memory: Its balance, which is overwritten.
            followers: Its needles, which were followed last.
            mean: Thrust at each groove with the mean, shape (groove, sample).
        """
        self.all_alike(i, mean)
        count = self.each.shape[1]
        for revolution in (*range(count - 2), count - 1):
            followers.add(row, memory, revolution)
            self.each[i, revolution] = _thrust(row, memory, mean, _DIFFERS)
        self.each[i, -2] = 2 * mean - self.each[i, -1]
        if SETTLED in self.asked and not followers.settles(i):
            followers.follow_on(row, memory, i)
            self.repeating[i] = _thrust(row, memory, mean, _SETTLES)
        self.repeat[i] = followers.repeat
        if STEP_ERROR in self.asked:
            followers.follow_in_half_steps(row, memory, i)
            self.finer[i] = _thrust(row, memory, mean, _SETTLES)


def _thrust(row: FloatArray, memory: Memory, otherwise: FloatArray, loose: float) -> FloatArray:
    """Thrust at each groove once the balance has settled, shape (groove, sample); `otherwise` where it does not."""
    if not settle_moving(row, memory, loose * PointConstants._make(row).tolerance, NEAR)[0]:
        return otherwise
    thrust = np.empty((*memory.eights.shape, WIDTH))
    thrust_alone(row, memory, thrust)
    return thrust.reshape(3, -1)[:, : memory.samples]
