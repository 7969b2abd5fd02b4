"""The result of a joint with self-excited vibration: its motion with vibration, or a run without if accurate enough.

The method of runs that choose their steps damps the vibration: a run of `rollers` is then replaced by one with
vibration. With needle bodies this costs ten to three hundred times their usual run. Lumped bearings first give the
change of the third order by the vibration (at 20 points, needle runs contradicted them about a loss of 5 % once);
needles are followed if the change exceeds the allowed error. A run with a chosen method or step is kept, and its third
order is compared with lumped bearings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import SMALLEST_THIRD
from tripod_doe.joint.geometry.feasibility import room_for_needles
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.revolutions import RevolvingJoint
from tripod_doe.joint.multibody.run_result import JointRun, StoppedError, VibrationReadings, Wanted
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration.growing_vibration import Vibration, damping_against
from tripod_doe.joint.vibration.vibrating_run import FollowedVibration, compile_undamped, follow_vibration, undamped
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.run import Limits, Run
from tripod_doe.model_interface import Outcome

_BUILT_UP = 1.5
"""Unrest of the thrust over its value in the smooth motion, above which growing departures count as a vibration."""


class VibratingJoint:
    """A joint in which departures from the smooth motion grow.

    Args:
        limits: Bounds of the checks of a revolution.
        allowed: Allowed errors of orders of given amplitudes, infinite without a requirement; shape (order,) each.
    """

    def __init__(
        self,
        values: JointValues[float],
        vibration: Vibration,
        wanted: Wanted,
        limits: Limits,
        allowed: Callable[[FloatArray], FloatArray],
    ) -> None:
        self._values, self._vibration, self._wanted, self._limits = values, vibration, wanted, limits
        self._allowed, self._joints = allowed, list[RevolvingJoint]()

    def answer(self, needles: bool, anyhow: bool = False) -> JointRun | None:
        """Follow the joint with its vibration; `anyhow` if there is no other answer.

        Returns:
            None, unless `anyhow`, if the vibration stays small; with needles also if it changes the third order by at
            most the allowed error.
        """
        try:
            lumped = self._lumped
            if not (self._builds_up or anyhow) or (
                needles and self._change(self._vibration.third) <= self._allowed_of_third
            ):
                return None
            followed = self._followed(needles=True) if needles else lumped
        except StoppedError as stop:
            done = JointRun(stop.stopped.outcome, f"{self._vibration.described}; {stop.stopped.detail}{self._loose}")
        else:
            done = self._described(followed, needles)
        return replace(
            done,
            steps=sum(joint.steps for joint in self._joints),
            solves=sum(joint.solves for joint in self._joints),
            force_evaluations=sum(joint.force_evaluations for joint in self._joints),
            followed=sum(joint.state.time for joint in self._joints[-1:] if joint.state),
        )

    def verdict(self, third: float | None, limit: float) -> tuple[Outcome, str]:
        """Outcome and note of a run without the vibration: is it accurate enough?

        Args:
            third: Third order of the run; None for needles, whose change by the vibration is taken from lumped
                bearings.
            limit: Allowed relative error of the third order.
        """
        try:
            followed = self._lumped
        except StoppedError as stop:
            return Outcome.INACCURATE, f"{self._vibration.described}, whose size is not known: {stop.stopped.detail}"
        if not self._builds_up:
            return Outcome.FINISHED, ""
        without = self._vibration.third
        note = (
            f"{self._vibration.described}; with lumped bearings the third order is {followed.third:.4g} N with it and "
            f"{without:.4g} N without it"
        )
        least = SMALLEST_THIRD * abs(self._values.torque) / self._values.pitch_radius
        if self._change(without if third is None else third) <= limit * max(followed.third, least):
            return Outcome.FINISHED, note
        return Outcome.INACCURATE, f"{note}; leave out method, step_s and relative_tolerance, and it is followed"

    @property
    def last_revolution(self) -> Run | None:
        """The last revolution that was followed."""
        return self._joints[-1].last_revolution if self._joints else None

    @cached_property
    def _lumped(self) -> FollowedVibration:
        """The joint followed with lumped bearings."""
        return self._followed(needles=False)

    def _followed(self, needles: bool) -> FollowedVibration:
        method, setting = undamped(needles, self._vibration.growth.frequency)
        budget = int(self._values.evaluation_budget)
        joint = RevolvingJoint(
            assemble(build_joint(self._values, needles)), self._values, method, self._wanted, self._limits, budget
        )
        builds_up = self._vibration.builds_up and not needles
        self._joints.append(joint)
        compile_undamped(joint.assembly, method)
        return follow_vibration(joint, setting, self._allowed, builds_up)

    @property
    def _loose(self) -> str:
        """Hint for needle bodies in a ring with gaps, which a vibration moves together."""
        room = room_for_needles(self._values)
        if room < 2 or not self._joints[-1].has_needles:
            return ""
        return f"; without a cage needles run together, and there is room for {room} more: raise needle_count"

    @property
    def _builds_up(self) -> bool:
        """Whether growing departures become a vibration: one above the unrest, or one that changes the third order."""
        heard = not self._lumped.steady or self._lumped.unrest > _BUILT_UP * self._vibration.unrest
        return heard or self._change(self._vibration.third) > self._allowed_of_third

    def _change(self, third: float) -> float:
        """Difference of a third order to lumped bearings with the vibration, beyond their numerical error."""
        return max(abs(self._lumped.third - third) - float(self._lumped.readings.amplitude_error[3]), 0.0)

    @property
    def _allowed_of_third(self) -> float:
        amplitudes = np.zeros(ORDERS.size)
        amplitudes[3] = self._lumped.third
        return float(self._allowed(amplitudes)[3])

    def _described(self, followed: FollowedVibration, needles: bool) -> JointRun:
        """Make the result, with a note on the vibration."""
        method, _ = undamped(needles, self._vibration.growth.frequency)
        growth = self._vibration.growth
        numbers = VibrationReadings(growth.factor, growth.rate, self._vibration.hertz, followed.unrest)
        readings = replace(followed.readings, vibration=numbers)
        error = float(followed.readings.amplitude_error[3])
        note = (
            f"{self._vibration.described}; followed by {method.name}, it moves the thrust by "
            f"{followed.unrest:.3g} N above order 12 (effective value); the third order is {followed.third:.4g} "
            f"+- {error:.2g} N, the mean of {followed.revolutions} revolutions with a standard deviation of "
            f"{followed.scatter:.2g} N, and {self._vibration.third:.4g} N without the vibration"
        )
        if not followed.certain:
            reason = "has not settled" if not followed.steady else "is not as certain as required"
            note = f"{note}; after {followed.followed} revolutions it {reason}"
            if followed.lacking:
                note = f"{note}, which would take about {followed.lacking:.1g} more force evaluations"
            raised = "evaluation_budget, accuracy" if followed.lacking else "accuracy"
            return JointRun(Outcome.INACCURATE, f"{note}; raise {raised} or contact damping", readings)
        return JointRun(Outcome.FINISHED, f"{note}; {self._end}", readings)

    @property
    def _end(self) -> str:
        """State in words the damping that would suppress the vibration."""
        if self._vibration.growth.rate <= 0:
            return "a kick such as the start keeps it up"
        damping = damping_against(self._values, self._vibration.states)
        if damping:
            return f"with {damping} it would not start"
        return "no contact damping that was tried ends it"
