"""Automatic refinement of a run: it chooses its tolerance so that the orders reach the required accuracy.

The first pass follows all revolutions with a coarse tolerance (`first_tolerance`). The sampled revolutions are then run
again in finer steps, from the first pass's state a little before them: the difference of two passes gives the error of
the finer one by the order of the method, and the next steps follow from that error. So every run also gives a result,
and dropped revolutions are run once (except with needles, whose skew depends on all previous steps).

Where revolutions repeat, one is run again in finer steps, and its signals are extrapolated to steps of zero
(`sampled_signals`): the error that is stated is then what the extrapolation adds.

Rattling parts make revolutions scatter. If scatter is the larger part of the error, both passes go on for more
revolutions, and the orders are means without the initial transient. A pass that would cost far more than the first one
does not start: the result states the remaining error and the cost of that pass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.multibody.order_noise import mean_and_chance, swung_in
from tripod_doe.joint.multibody.passes import Extrapolation, FollowedJoint, Motion, Pass
from tripod_doe.joint.multibody.run_result import StoppedError
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.values import JointValues

_RESOLVED = math.pi / 360
"""Coarsest tolerance of the first pass of `rollers`: steps of a degree. Of 19 bent joints of the field, the third order
is then off by 1 % in the median, and with half of it by 0.4 %; by more than a tenth at two, where further passes
follow."""

_RESOLVED_NEEDLES = math.pi / 1080
"""The same for `needles`, a third of a degree at any force: their friction damps a roller's swing, and steps must
resolve how needles knock against each other, by the rotation. At 24 joints (19 of the tests' needles_held_out.csv, five
of benchmarks/full_model.py) the third order is off by 0.09 % in the median with this tolerance, by 1.1 % at most,
and with half of it by 0.04 and 0.17 %. With the next larger one it is off by up to 1.8 % at 10, for more work."""

_LEFT = 0.5
"""Error of the third order that the second pass leaves over the tolerance of the first one, at half of these joints;
higher orders are off by more. Where it leaves more a third pass follows, which costs what finer ones from the start
would."""

_LEFT_NEEDLES = 0.85
"""The same for `needles`, at half of these joints."""

_UNRESOLVED = 0.1
"""Error over the size of an order above which steps do not resolve the motion: the error then does not follow the order
of the method, and steps are halved."""

_LEAST_REFINED, _MOST_REFINED = 1.5, 4.0
"""Least and largest factor of one refinement: closer passes estimate the error badly, and estimates are no better than
the larger factor."""

_AIM = 0.8
"""Share of the allowed error that the next pass aims at."""

_UNSURE = 0.5
"""Share of the error aimed at by chance above which steps are refined by the most: two passes then differ by chance,
which counts for the less, the farther apart their steps are."""

_MOST_LONGER = 4
"""Factor by which the number of sampled revolutions grows at once."""

_ALIKE, _LEFT_OF_SWING, _LONGEST = 0.05, 0.5, 128
"""Difference of two revolutions, and what is left of a swing that falls, over the allowed error up to which a motion
counts as settled; and revolutions in which it is waited for."""

_MOST_EXPENSIVE = 256
"""Force evaluations of a further pass over those of the first one above which it is not begun."""


@dataclass(frozen=True)
class _Comparison:
    """Comparison of two passes with the required accuracy."""

    by_steps: FloatArray  # error of every order by the steps of the finer pass, shape (order,)
    by_chance: FloatArray  # error of every order by rattling, shape (order,)
    # sizes, allowed: reference of relative errors, and allowed errors (infinite without requirement), shape (order,)
    sizes: FloatArray
    allowed: FloatArray
    swung_in: int  # first revolutions of both passes that are dropped

    @classmethod
    def of(
        cls,
        coarse: Pass,
        fine: Pass,
        method_order: int,
        accuracy: OrderAccuracy,
        values: JointValues[float],
        remembers: bool,
        repeated: Pass | None = None,
    ) -> _Comparison:
        """Errors of the finer of two passes.

        A method of order p whose result changes by d from steps h to r h is still off by d r^p / (1 - r^p). Chance
        moves all orders alike; an order that moves more, as while a motion still grows, counts by itself. Scatter of
        the finer pass is no error of its steps. Scatter of the coarser pass is not subtracted: steps that do not
        resolve the motion could hide in it.

        With needle bodies, revolutions differ in any steps while skews still change. There only the difference of the
        two passes in the same revolution is scatter, half of its variance each.

        Args:
            repeated: The pass whose revolutions scatter like those of the finer one, which has a single revolution.
        """
        allowed = accuracy.allowed(np.abs(fine.orders.mean(0)), values)
        asked = np.isfinite(allowed)
        dropped = swung_in(fine.orders[:, asked] / allowed[asked])
        parts = (fine.orders - coarse.orders) / math.sqrt(2) if remembers else (repeated or fine).orders
        mean, (_, chance) = fine.orders[dropped:].mean(0), mean_and_chance(parts[dropped:, None])
        alike = math.sqrt(float((chance[1:] ** 2).mean()))
        change = np.abs(mean - coarse.orders[dropped - len(fine.orders) :].mean(0))
        left = (fine.setting / coarse.setting) ** method_order
        by_steps = np.sqrt(np.maximum(change**2 - alike**2 / 2, 0)) * left / (1 - left)
        sizes, allowed = (of(np.abs(mean), values) for of in (accuracy.sizes, accuracy.allowed))
        return cls(by_steps, np.maximum(chance, alike), sizes, allowed, dropped)

    @property
    def error(self) -> FloatArray:
        """Both parts together."""
        both: FloatArray = np.hypot(self.by_steps, self.by_chance)
        return both

    @property
    def worst(self) -> int:
        """The order with the largest error over the allowed one."""
        return int((self.error / self.allowed).argmax())

    @property
    def settles(self) -> bool:
        """Whether to stop: the errors are small enough, or not finite."""
        return not np.isfinite(self.error).all() or bool((self.error <= self.allowed).all())

    def next_pass(self, fine: Pass, method_order: int) -> tuple[int, float]:
        """Sampled revolutions and setting of the next pass: more revolutions, or finer steps."""
        order, sampled = self.worst, len(fine.orders)
        steps, chance, aim = self.by_steps[order], self.by_chance[order], _AIM * self.allowed[order]
        if chance > steps:
            wanted = self.swung_in + math.ceil((sampled - self.swung_in) * (chance / aim) ** 2)
            return min(max(wanted, sampled + 1), _MOST_LONGER * sampled), fine.setting
        if steps > _UNRESOLVED * self.sizes[order]:
            return sampled, fine.setting / 2
        factor = math.inf if chance > _UNSURE * aim else (steps / aim) ** (1 / method_order)
        return sampled, fine.setting / float(np.clip(factor, _LEAST_REFINED, _MOST_REFINED))

    def miss(self) -> str:
        """State the error of the worst order in words."""
        order, size = self.worst, self.sizes[self.worst]
        error, asked = (100 * part[order] / size for part in (self.error, self.allowed))
        text = f"the numerical error of order {order} is {error:.2g} % of {size:.3g} N"
        return f"{text}, where {asked:.2g} % is required"


def first_tolerance(accuracy: OrderAccuracy, needles: bool) -> float:
    """Coarsest tolerance of `adaptive-euler` that the first pass of an operating point is likely to need."""
    resolved, left = (_RESOLVED_NEEDLES, _LEFT_NEEDLES) if needles else (_RESOLVED, _LEFT)
    return min(resolved, *(3 / max(order, 3) * _AIM * share / left for order, share in accuracy.orders.items()))


def refine(joint: FollowedJoint, accuracy: OrderAccuracy, setting: float) -> Motion:
    """Follow a joint, refining steps and adding revolutions until they are accurate enough.

    Args:
        setting: Tolerance or step of the first pass.
    """
    order = 1 if joint.method.controlled else joint.method.order
    setting, error, dropped = joint.settled(setting), np.full(ORDERS.size, math.nan), 0
    missed, repeats = "", True
    try:
        first, swings = _once_swung_in(joint, joint.first(setting), accuracy)
        finest = coarse = first
    except StoppedError as stop:
        return Motion(stop.stopped, 0, setting, 0.0, error, "", tuple(joint.runs))
    revolutions, setting = len(first.orders), joint.settled(first.setting / 2)
    repeated: Pass | None = None
    while True:
        if not repeated and revolutions == len(finest.orders) and _repeats(joint, finest, accuracy):
            repeated, revolutions = finest, 1
        try:
            if revolutions > len(finest.orders):
                coarse, finest = (joint.longer(each, revolutions) for each in (coarse, finest))
            else:
                coarse, finest = finest, joint.again(finest, setting, revolutions)
        except StoppedError as stop:
            missed = f"in finer steps the run ends as {stop.stopped.outcome.label}: {stop.stopped.detail}"
            break
        compared = _Comparison.of(coarse, finest, order, accuracy, joint.values, joint.remembers, repeated)
        error, dropped = compared.error, compared.swung_in
        if compared.settles:
            break
        revolutions, setting = compared.next_pass(finest, order)
        setting = joint.settled(setting)
        if costs := _too_expensive(joint, coarse, finest, revolutions, setting):
            missed, repeats = f"{compared.miss()}; {costs}", revolutions == len(finest.orders)
            break
    sampled, lag, whole = len(finest.orders) - dropped, joint.lag(finest.setting), joint.motion(first, finest)
    extrapolation = None
    if repeated and len(finest.orders) == 1:
        extrapolation = Extrapolation.of(joint, repeated, coarse, finest)
    return Motion(
        whole,
        sampled,
        finest.setting,
        lag,
        error,
        swings or missed,
        tuple(joint.runs),
        bool(swings),
        repeats,
        extrapolation,
    )


def _repeats(joint: FollowedJoint, one: Pass, accuracy: OrderAccuracy) -> bool:
    """Whether no order differs between the last two revolutions of a pass by what matters to the required accuracy."""
    if not joint.extrapolates or len(one.parts) > 1:
        return False
    allowed = accuracy.allowed(np.abs(one.orders.mean(0)), joint.values).min()
    return bool(np.abs(one.orders[-1] - one.orders[-2]).max() <= _ALIKE * allowed)


def _once_swung_in(joint: FollowedJoint, first: Pass, accuracy: OrderAccuracy) -> tuple[Pass, str]:
    """Continue the first pass until its transient has ended; with a reason if it has not.

    Some joints settle slowly, those of small angles at high speed for a hundred revolutions: coarse steps are cheap
    for that. The rest of a swing is extrapolated from how its changes from one revolution to the next decrease. Needles
    are left out: their skew changes in all revolutions.
    """
    while not joint.remembers:
        count, allowed = len(first.orders), accuracy.allowed(np.abs(first.orders[-2:].mean(0)), joint.values)
        asked = np.isfinite(allowed)
        scaled = first.orders[:, asked] / allowed[asked]
        apart = np.abs(np.diff(scaled, axis=0)).max(axis=1)
        if apart[-1] <= _ALIKE or (
            count > 2 and (_left_of_swing(apart) <= _LEFT_OF_SWING or swung_in(scaled) < count // 2)
        ):
            break
        if count >= _LONGEST:
            return joint.last(first, 2), f"after {count} revolutions the joint has not settled; raise cycles"
        first = joint.longer(first, 2 * count)
    return first if len(first.orders) == 2 else joint.last(first, 2), ""


def _left_of_swing(apart: FloatArray) -> float:
    """Sum of all further changes of a swing, from its changes so far, shape (step,), by a geometric series."""
    half = len(apart) // 2
    falls = float(apart[-1] / max(apart[half], 1e-300)) ** (1 / max(len(apart) - 1 - half, 1))
    return float(apart[-1]) * falls / (1 - falls) if falls < 1 else math.inf


def _too_expensive(joint: FollowedJoint, coarse: Pass, finest: Pass, revolutions: int, setting: float) -> str:
    """State the cost of the next pass if it is too high; else empty."""
    more = revolutions - len(finest.orders)
    if more:
        price = joint.samples * more * (coarse.evaluations_per_sample + finest.evaluations_per_sample)
        what = f"an average over {revolutions} revolutions"
    else:
        price = joint.samples * revolutions * finest.evaluations_per_sample * finest.setting / setting
        what = f"{'relative_tolerance' if joint.method.controlled else 'step_s'} = {setting:.2g}"
    if price <= min(joint.left, _MOST_EXPENSIVE * joint.runs[0].force_evaluations):
        return ""
    return f"{what} would take about {price:,.0f} more force evaluations"
