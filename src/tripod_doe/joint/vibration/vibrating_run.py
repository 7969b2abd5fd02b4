"""A joint that vibrates by itself, followed until the mean orders of its thrust are certain.

The vibration is not synchronous with the rotation: revolutions differ by chance, and an order is the mean over
revolutions. With three trunnions, thirds of a revolution differ only by skews: they give the scatter of a revolution
(`order_noise`).

The joint is followed from its start in steps that resolve the vibration. The beginning is dropped, and the run
continues until the vibration stops growing. If the vibration builds up within a revolution, a second revolution is
enough. The run starts with a kick: steps from the smooth motion would be so long that they damp the vibration
(measured: 657 N instead of 441 N). The same number of revolutions, or few if scatter hardly matters, follows in finer
steps: the difference of the two means beyond scatter gives both errors. The result is the mean of all revolutions if
steps hardly matter, else of the revolutions in finer steps. Still finer steps or more revolutions follow, depending on
the larger part of the error, until the orders are as certain as required.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.joint.multibody.order_noise import mean_and_chance
from tripod_doe.joint.multibody.revolutions import Revolution, RevolvingJoint
from tripod_doe.joint.multibody.run_result import Readings
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.model_interface import not_counted

Allowed = Callable[[FloatArray], FloatArray]

_FINER = 4.0
"""Reduction factor of errors with the next finer tolerance or step."""

_FIRST, _DROPPED, _MOST = 4, 1 / 3, 256
"""First number of revolutions, share of them that is dropped, and largest number of revolutions. At most half of the
largest number uses the first steps."""

_FEWEST, _HARDLY = 2, 0.5
"""Least number of revolutions of an answer, also in finer steps unless the vibration builds up in one of them; and the
share of the allowed error by scatter above which finer steps get the same number of revolutions as the steps before."""

_RESERVE, _COST_RATIO = 0.75, 2.0
"""Share of the budget left that is reserved for finer steps, and the cost ratio of a revolution in finer steps."""

_AIM = 0.95
"""Share of the allowed error that more revolutions must reach."""

_COARSELY = 1.6
"""Largest scatter over the allowed error with which a mean is good enough to estimate the error of finer steps, which
is a third of its own. With this, revolutions in coarse and in finer steps cost the least together."""

_STEADY = 0.1
"""Relative change of the vibration between two halves of the revolutions that is not significant."""


def undamped(needles: bool, frequency: float) -> tuple[Method, float]:
    """Choose a method that hardly damps a vibration, and the tolerance or step in s to begin with.

    Rosenbrock's method of third order controls its step. At 9 deg, 57 N m, 1173 rpm, groove friction 0.18, where the
    vibration reduces the third order from 51.0 N to 41.3 N, a tolerance of 1e-3 gives 41.4 +- 0.2 N in 24 revolutions
    and costs a third of generalized-alpha or BDF2 at 4e-6 s (41.3 and 41.3 +- 0.2 N); these two at 1e-5 s give 41.2 and
    41.0 N for twice its cost. Rattling needles limit its steps to a microsecond; BDF2 follows them at a fifth of the
    cost in steps that damp a vibration less than its contacts do.

    Args:
        needles: Whether needles are bodies.
        frequency: Angular frequency of the vibration.
    """
    if needles:
        return METHODS["bdf2"], min(_LONGEST_STEP, _ANGLE / frequency)
    return METHODS["rosenbrock"], _TOLERANCE


def compile_undamped(assembly: Assembly, method: Method) -> None:
    """Compile the kernels of a method for a joint, or load their machine code."""
    with not_counted(), first_compilation(f"vibrating joints with {method.name}", seconds=30):
        run(assembly, method.name, 1e-9, step=1e-9, limits=Limits(windows=0))


_TOLERANCE, _LONGEST_STEP, _ANGLE = 4e-3, 3e-5, 0.25
"""Tolerance; longest step in s, and largest phase of a vibration in a step: BDF2 damps it by (1/4) 0.25^4 per step."""


@dataclass(frozen=True)
class FollowedVibration:
    """The result of following a vibration."""

    # revolutions, followed: number of averaged revolutions, and of all followed revolutions
    revolutions: int
    followed: int
    setting: float  # tolerance or step of the finest revolutions
    # third, scatter: third order of the thrust, and its standard deviation from revolution to revolution
    third: float
    scatter: float
    unrest: float  # effective value of the thrust above the orders that are reported
    steady: bool  # whether the vibration has stopped growing
    certain: bool  # whether all orders also have the required accuracy
    # estimated further force evaluations for it, if the budget did not allow them; else 0
    lacking: float
    # its results; the error of an order is by chance (twice the standard deviation of the mean) and by the steps
    readings: Readings


def follow_vibration(
    joint: RevolvingJoint, setting: float, allowed: Allowed, builds_up: bool = False
) -> FollowedVibration:
    """Follow a joint from its start until its mean orders reach the allowed errors, or its budget is nearly used up.

    Args:
        setting: Tolerance or step to begin with.
        allowed: Allowed errors of orders of given amplitudes, infinite without a requirement; shape (order,) each.
        builds_up: Whether the vibration builds up within a revolution, so that only the first one is dropped.

    Raises:
        StoppedError: If the run stops on its way, or its budget is used up before an error estimate exists.
    """
    first, fewest = max(_FIRST, int(joint.values.cycles)), _FEWEST
    if builds_up:
        joint.follow(1, setting)
        first = fewest = 1
    finer = _FINER if joint.method.controlled else _FINER ** (1 / joint.method.order)
    passed = joint.follow(first, setting)
    kept = passed[round(_DROPPED * first) :]
    while (
        more := min(_before_finer_steps(kept, allowed), _MOST // 2 - len(passed), _afforded(joint, 1 - _RESERVE))
    ) > 0:
        passed += joint.follow(more, setting)
        kept = passed[round(_DROPPED * len(passed)) :]
    while True:
        setting /= finer
        joint.change_to(setting)
        more = min(_in_finer_steps(kept, allowed, fewest), max(_afforded(joint), 1))
        coarse, kept = kept, joint.follow(more, setting)
        compared = _Compared.of(coarse, kept, allowed)
        while more := _more(compared, coarse, kept, min(_MOST - len(passed) - len(kept), _afforded(joint))):
            kept += joint.follow(more, setting)
            compared = _Compared.of(coarse, kept, allowed)
        passed += kept
        if compared.certain or len(passed) >= _MOST or joint.affordable < _COST_RATIO * _FEWEST:
            return _followed(joint, passed, coarse, kept, setting, compared)


def _afforded(joint: RevolvingJoint, share: float = 1.0) -> int:
    """Number of revolutions like the last one that a share of the budget left allows, at most `_MOST`."""
    return int(min(share * joint.affordable, _MOST))


@dataclass(frozen=True)
class _Compared:
    """Comparison of revolutions in finer steps with those before."""

    pooled: bool  # whether the mean is taken over both
    mean: ComplexArray  # mean complex orders, shape (order,)
    # by_steps, by_chance, allowed: errors of each order and allowed errors, shape (order,)
    by_steps: FloatArray
    by_chance: FloatArray
    allowed: FloatArray

    @classmethod
    def of(cls, coarse: Sequence[Revolution], fine: Sequence[Revolution], allowed: Allowed) -> _Compared:
        """The mean of the finer revolutions or of both, with the smaller error; few finer ones only if necessary.

        The difference of the two means beyond scatter, at least its standard deviation, is three times the error of the
        finer steps; the error of the coarser steps is four times as large.
        """
        coarsely, finely = _thirds(coarse), _thirds(fine)
        (before, chance_before), (mean, chance) = mean_and_chance(coarsely, finely), mean_and_chance(finely, coarsely)
        apart_by_chance = (chance**2 + chance_before**2) / 2  # both ways
        by_steps = np.sqrt(np.maximum(np.abs(mean - before) ** 2 - apart_by_chance, apart_by_chance)) / (_FINER - 1)
        share = len(coarse) / (len(coarse) + len(fine))
        both = share * before + (1 - share) * mean
        finer = cls(False, mean, by_steps, chance, allowed(np.abs(mean)))
        pooled = cls(
            True,
            both,
            (1 + (_FINER - 1) * share) * by_steps,
            np.hypot(share * chance_before, (1 - share) * chance),
            allowed(np.abs(both)),
        )
        if pooled.certain and len(fine) < _FEWEST:
            return pooled
        return min(finer, pooled, key=lambda one: one.miss)

    @property
    def error(self) -> FloatArray:
        """Both parts together, shape (order,)."""
        both: FloatArray = np.hypot(self.by_steps, self.by_chance)
        return both

    @property
    def miss(self) -> float:
        """Largest error of an order over the allowed one."""
        return float((self.error / self.allowed).max())

    @property
    def certain(self) -> bool:
        """Whether all orders have the required accuracy."""
        return self.miss <= 1

    @property
    def wants_revolutions(self) -> bool:
        """Whether the order with the largest error needs more revolutions rather than finer steps."""
        worst = int((self.error / self.allowed).argmax())
        return not self.certain and bool(self.by_chance[worst] > self.by_steps[worst])

    def lacking(self, coarse: int, fine: int) -> int:
        """Estimate how many further revolutions in finer steps are needed, from the scatter of those so far."""
        counted = fine + (coarse if self.pooled else 0)
        worst = int((self.error / self.allowed).argmax())
        left = (_AIM * self.allowed[worst]) ** 2 - self.by_steps[worst] ** 2
        excess = float(self.by_chance[worst] ** 2) / left - 1 if left > 0 else math.inf
        return max(math.ceil(counted * min(excess, 1e3)), 1)


def _before_finer_steps(kept: Sequence[Revolution], allowed: Allowed) -> int:
    """Number of further revolutions, at most doubling them, before the effect of steps can be estimated.

    Zero if the vibration has stopped growing and the mean is accurate enough.
    """
    mean, chance = mean_and_chance(_thirds(kept))
    excess = float((chance / (_COARSELY * allowed(np.abs(mean)))).max()) ** 2
    if not _is_steady(kept):
        return len(kept)
    return math.ceil(len(kept) * min(excess - 1, 1.0)) if excess > 1 else 0


def _more(compared: _Compared, coarse: Sequence[Revolution], fine: Sequence[Revolution], left: int) -> int:
    """Number of further revolutions in finer steps, at most doubling them and no more than are left.

    Zero if they would not help.
    """
    if not _is_steady(fine):
        more = len(fine)
    elif not compared.pooled and len(fine) < _FEWEST:
        more = _FEWEST - len(fine)
    elif compared.wants_revolutions:
        more = compared.lacking(len(coarse), len(fine))
    else:
        return 0
    return min(more, len(fine), max(left, 0))


def _in_finer_steps(kept: Sequence[Revolution], allowed: Allowed, fewest: int) -> int:
    """Number of revolutions to follow in finer steps than these."""
    mean, chance = mean_and_chance(_thirds(kept))
    return fewest if (chance <= _HARDLY * allowed(np.abs(mean))).all() else len(kept)


def _is_steady(kept: Sequence[Revolution]) -> bool:
    """Whether a vibration has the same size in both halves of the revolutions, except for chance.

    In a single revolution its first and last third are compared.
    """
    sizes = np.concatenate([each.unrests for each in kept])
    half = sizes.size // 2
    first, second = sizes[:half], sizes[-half:]
    chance = 2 * math.sqrt(sum(part.var(ddof=1) / half for part in (first, second))) if half > 1 else 0.0
    return bool(abs(second.mean() - first.mean()) <= max(chance, _STEADY * sizes.mean()))


def _thirds(revolutions: Sequence[Revolution]) -> ComplexArray:
    return np.array([each.thirds for each in revolutions])


def _followed(
    joint: RevolvingJoint,
    passed: Sequence[Revolution],
    coarse: Sequence[Revolution],
    fine: Sequence[Revolution],
    setting: float,
    compared: _Compared,
) -> FollowedVibration:
    """Make the result, with the readings of the revolutions that are kept."""
    kept = [*coarse, *fine] if compared.pooled else list(fine)
    skew, summary = None, None
    if joint.has_needles:
        skew = np.concatenate([each.skew for each in passed[-2:] if each.skew is not None], axis=1)
        last = passed[-int(joint.values.cycles) :]
        summary = np.concatenate([each.skew_summary for each in last if each.skew_summary is not None], axis=1)
    parts = [each.parts for each in kept if each.parts is not None]
    readings = Readings(
        np.array([each.thrust for each in kept]),
        np.array(parts) if parts else None,
        np.mean([each.power for each in kept], axis=0),
        compared.error,
        skew,
        summary,
        max(each.penetration for each in kept),
        max((each.energy_residual for each in kept), key=abs),
    )
    scatter = float(compared.by_chance[3]) / 2 * math.sqrt(len(kept))
    steady = _is_steady(fine)
    certain, lacking = steady and compared.certain, 0.0
    if not certain and len(passed) < _MOST:
        more = len(kept) * (compared.miss**2 - 1) if compared.wants_revolutions else _COST_RATIO * len(fine)
        lacking = (more if steady else len(fine)) * joint.evaluations_per_revolution
    return FollowedVibration(
        len(kept),
        len(passed),
        setting,
        float(abs(compared.mean[3])),
        scatter,
        float(np.mean([each.unrest for each in kept])),
        steady,
        certain,
        lacking,
        readings,
    )
