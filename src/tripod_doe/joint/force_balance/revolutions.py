"""Thrust of single revolutions of a balance with turning needles, and of the periodic state of the needles.

A balance is solved with the mean needle forces of the last two revolutions; this gives the orders that every model
reports. From there, two or three sweeps solve it with the needle forces of one revolution. The last two revolutions
differ equally from their mean, with opposite signs: thrust is almost linear in the needle forces.
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
"""Factors on the tolerance of a balance: solved for a small difference, and with needles in their periodic state."""


@dataclass(frozen=True)
class Revolutions:
    """Thrust at each groove in the last revolutions of a block of points."""

    each: FloatArray  # in N, at least two, shape (point, revolution, groove, sample)
    # once needles repeat, shape (point, groove, sample), NaN if not requested; and whether they repeat
    repeating: FloatArray
    repeat: NDArray[np.bool_]
    # mean of the last two with needles in half steps, shape (point, groove, sample), NaN if not requested
    finer: FloatArray
    asked: frozenset[str]  # requested outputs that need more than the single revolutions

    @classmethod
    def of(cls, points: int, count: int, samples: int, names: Collection[str]) -> Revolutions:
        """Zero thrust in a number of revolutions, with arrays for these outputs."""
        asked = frozenset(names).intersection((SETTLED, STEP_ERROR))
        repeating, finer = (
            np.full((points, 3, samples), 0.0 if name in asked else np.nan) for name in (SETTLED, STEP_ERROR)
        )
        return cls(np.zeros((points, count, 3, samples)), repeating, np.ones(points, bool), finer, asked)

    def all_alike(self, i: int, thrust: FloatArray) -> None:
        """Give all revolutions of point i the same thrust."""
        self.each[i] = thrust
        if SETTLED in self.asked:
            self.repeating[i] = thrust
        if STEP_ERROR in self.asked:
            self.finer[i] = thrust

    def follow(self, i: int, row: FloatArray, memory: Memory, followers: Followers, mean: FloatArray) -> None:
        """Solve the revolutions of point i, whose balance with the mean of the last two is in `memory`.

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
    """Thrust at each groove of the converged balance, shape (groove, sample); `otherwise` if it does not converge."""
    if not settle_moving(row, memory, loose * PointConstants._make(row).tolerance, NEAR)[0]:
        return otherwise
    thrust = np.empty((*memory.eights.shape, WIDTH))
    thrust_alone(row, memory, thrust)
    return thrust.reshape(3, -1)[:, : memory.samples]
