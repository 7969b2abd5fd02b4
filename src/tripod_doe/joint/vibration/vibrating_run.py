"""A joint that vibrates by itself, followed until the mean orders of its thrust are certain.

The vibration is not in step with the rotation: revolutions differ by chance, and an order is the mean over revolutions.
With three trunnions thirds of a revolution are alike but for their skews: a revolution tells by its thirds what chance
makes of it (`scatter`).

The joint is followed from its start in steps that resolve the vibration. The beginning is dropped, and the joint is
followed for longer until the vibration has stopped growing. Where the vibration builds up within a revolution, a second
one is enough. It builds up from the kick of the start: from the smooth motion steps would be so long that they damp it
(seen: 657 N in place of 441 N). As many revolutions, or few where chance hardly matters, go on in
finer steps: what the two means differ by, beyond chance, tells the errors of both. The answer is the mean of all
revolutions where steps hardly matter, and of those in finer steps where they do. Still finer steps follow, or more
revolutions, whichever error is the larger, until the orders are as certain as they are asked to be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.joint.multibody.revolutions import JointInTurns, Revolution
from tripod_doe.joint.multibody.run_result import Readings
from tripod_doe.joint.multibody.scatter import mean_and_chance
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.integrators.registry import METHODS

Allowed = Callable[[FloatArray], FloatArray]

_FINER = 4.0
"""Factor by which errors fall with the next finer tolerance or step."""

_FIRST, _DROPPED, _MOST = 4, 1 / 3, 256
"""Revolutions that are followed at first, share of them that is dropped, and revolutions that are followed at most.
Half of these may have the first steps."""

_FEWEST, _HARDLY = 2, 0.5
"""Revolutions that an answer is made of at least, also in finer steps unless the vibration builds up in one of them;
where chance makes more than such a share of the allowed error, as many as in the steps before."""

_RESERVE, _DEARER = 0.75, 2.0
"""Share of the budget left that stays for finer steps, and what a revolution costs in those over the one before."""

_AIM = 0.95
"""Share of the allowed error that is aimed at by more revolutions."""

_COARSELY = 1.6
"""Chance over the allowed error up to which a mean tells the error of its steps: that is a third of what it tells. With
this, revolutions in coarse and in finer steps cost the least together."""

_STEADY = 0.1
"""Relative change of the vibration between two halves of the revolutions that passes as none, if chance makes less."""


def undamped(needles: bool, frequency: float) -> tuple[Method, float]:
    """The method that leaves a vibration alone, and the tolerance or step in s to begin with.

    Rosenbrock's method of third order controls its step. At 9 deg, 57 N m, 1173 rpm, groove friction 0.18, where the
    vibration reduces the third order from 51.0 N to 41.3 N, a tolerance of 1e-3 gives 41.4 +- 0.2 N in 24 revolutions
    and costs a third of generalized-alpha or BDF2 at 4e-6 s (41.3 and 41.3 +- 0.2 N); those at 1e-5 s 41.2 and 41.0 N
    for twice its price. Needles rattle, and limit its steps to a microsecond; BDF2 follows them at a fifth of the price
    in steps that damp a vibration by less than its contacts do.

    Parameters
    ----------
    needles
        Whether needles are bodies.
    frequency
        Angular frequency of the vibration.
    """
    if needles:
        return METHODS["bdf2"], min(_LONGEST_STEP, _ANGLE / frequency)
    return METHODS["rosenbrock"], _TOLERANCE


_TOLERANCE, _LONGEST_STEP, _ANGLE = 4e-3, 3e-5, 0.25
"""Tolerance; step in s, and what a vibration turns its phase by in a step: BDF2 damps that by (1/4) 0.25^4 a step."""


@dataclass(frozen=True)
class FollowedVibration:
    """What following a vibration came to."""

    # revolutions, followed: number of revolutions that the orders are the mean of, and of all that were followed
    revolutions: int
    followed: int
    setting: float  # tolerance or step of the finest of them
    # third, scatter: third order of the thrust, and the standard deviation of that of a revolution
    third: float
    scatter: float
    unrest: float  # effective value of the thrust above the orders that are reported
    steady: bool  # whether the vibration has stopped growing
    certain: bool  # whether all orders are as certain as asked for, too
    # about how many force evaluations that would take besides, where the budget did not allow them; 0 elsewhere
    lacking: float
    # its results; the error of an order is by chance (twice the standard deviation of the mean) and by the steps
    readings: Readings


def follow_vibration(
    joint: JointInTurns, setting: float, allowed: Allowed, builds_up: bool = False
) -> FollowedVibration:
    """Follow a joint from its start until the mean orders of its thrust are certain, or its budget is nearly used up.

    Parameters
    ----------
    joint
        The joint, with a method that leaves vibrations alone.
    setting
        Tolerance or step to begin with.
    allowed
        Errors that orders of such amplitudes may have, infinite where any will do; shape (order,) each.
    builds_up
        Whether the vibration builds up within a revolution, so that only the first one is dropped.

    Raises
    ------
    StoppedError
        If the run stops on its way, or its budget is used up before anything is known of the error.
    """
    first, fewest = max(_FIRST, int(joint.values.cycles)), _FEWEST
    if builds_up:
        joint.follow(1, setting)
        first = fewest = 1
    finer = _FINER if joint.method.controlled else _FINER ** (1 / joint.method.order)
    passed = joint.follow(first, setting)
    kept = passed[round(_DROPPED * first) :]
    while (more := min(_to_tell_steps(kept, allowed), _MOST // 2 - len(passed), _afforded(joint, 1 - _RESERVE))) > 0:
        passed += joint.follow(more, setting)
        kept = passed[round(_DROPPED * len(passed)) :]
    while True:
        setting /= finer
        joint.change_to(setting)
        more = min(_in_finer_steps(kept, allowed, fewest), max(_afforded(joint), 1))
        coarse, kept = kept, joint.follow(more, setting)
        found = _Compared.of(coarse, kept, allowed)
        while more := _more(found, coarse, kept, min(_MOST - len(passed) - len(kept), _afforded(joint))):
            kept += joint.follow(more, setting)
            found = _Compared.of(coarse, kept, allowed)
        passed += kept
        if found.certain or len(passed) >= _MOST or joint.affordable < _DEARER * _FEWEST:
            return _followed(joint, passed, coarse, kept, setting, found)


def _afforded(joint: JointInTurns, share: float = 1.0) -> int:
    """How many revolutions like the last one a share of the budget left allows, at most as many as are followed."""
    return int(min(share * joint.affordable, _MOST))


@dataclass(frozen=True)
class _Compared:
    """Revolutions in finer steps held against those before."""

    pooled: bool  # whether the mean is that of both
    mean: ComplexArray  # mean complex orders, shape (order,)
    # by_steps, by_chance, allowed: errors of each, and what they may be, shape (order,)
    by_steps: FloatArray
    by_chance: FloatArray
    allowed: FloatArray

    @classmethod
    def of(cls, coarse: Sequence[Revolution], fine: Sequence[Revolution], allowed: Allowed) -> _Compared:
        """The mean of the finer revolutions or of both, whichever is the more certain; few finer ones only if need be.

        What the two means differ by beyond chance is three times the error of the finer steps, but no difference is
        known better than its standard deviation; the error of the coarser steps is four times as large.
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
        """Largest error of an order over what it may be."""
        return float((self.error / self.allowed).max())

    @property
    def certain(self) -> bool:
        """Whether all orders are as certain as asked for."""
        return self.miss <= 1

    @property
    def wants_revolutions(self) -> bool:
        """Whether the order that misses most wants more revolutions rather than finer steps."""
        worst = int((self.error / self.allowed).argmax())
        return not self.certain and bool(self.by_chance[worst] > self.by_steps[worst])

    def lacking(self, coarse: int, fine: int) -> int:
        """How many more finer revolutions are needed after so many of both, as far as chance is known from them."""
        counted = fine + (coarse if self.pooled else 0)
        worst = int((self.error / self.allowed).argmax())
        left = (_AIM * self.allowed[worst]) ** 2 - self.by_steps[worst] ** 2
        excess = float(self.by_chance[worst] ** 2) / left - 1 if left > 0 else math.inf
        return max(math.ceil(counted * min(excess, 1e3)), 1)


def _to_tell_steps(kept: Sequence[Revolution], allowed: Allowed) -> int:
    """How many more revolutions, at most as many again, until orders are known well enough to tell what steps change.

    None where the vibration has stopped growing, and they are.
    """
    mean, chance = mean_and_chance(_thirds(kept))
    excess = float((chance / (_COARSELY * allowed(np.abs(mean)))).max()) ** 2
    if not _is_steady(kept):
        return len(kept)
    return math.ceil(len(kept) * min(excess - 1, 1.0)) if excess > 1 else 0


def _more(found: _Compared, coarse: Sequence[Revolution], fine: Sequence[Revolution], left: int) -> int:
    """How many more revolutions to follow in finer steps, at most as many again and no more than are left.

    None where they would not help.
    """
    if not _is_steady(fine):
        more = len(fine)
    elif not found.pooled and len(fine) < _FEWEST:
        more = _FEWEST - len(fine)
    elif found.wants_revolutions:
        more = found.lacking(len(coarse), len(fine))
    else:
        return 0
    return min(more, len(fine), max(left, 0))


def _in_finer_steps(kept: Sequence[Revolution], allowed: Allowed, fewest: int) -> int:
    """How many revolutions to follow in finer steps than these."""
    mean, chance = mean_and_chance(_thirds(kept))
    return fewest if (chance <= _HARDLY * allowed(np.abs(mean))).all() else len(kept)


def _is_steady(kept: Sequence[Revolution]) -> bool:
    """Whether a vibration is as large in the second half of revolutions as in the first, but for chance.

    A single revolution is held against itself by its first and its last third.
    """
    sizes = np.concatenate([each.unrests for each in kept])
    half = sizes.size // 2
    first, second = sizes[:half], sizes[-half:]
    chance = 2 * math.sqrt(sum(part.var(ddof=1) / half for part in (first, second))) if half > 1 else 0.0
    return bool(abs(second.mean() - first.mean()) <= max(chance, _STEADY * sizes.mean()))


def _thirds(revolutions: Sequence[Revolution]) -> ComplexArray:
    return np.array([each.thirds for each in revolutions])


def _followed(
    joint: JointInTurns,
    passed: Sequence[Revolution],
    coarse: Sequence[Revolution],
    fine: Sequence[Revolution],
    setting: float,
    found: _Compared,
) -> FollowedVibration:
    """All that was found, with what is read off the revolutions that are kept."""
    kept = [*coarse, *fine] if found.pooled else list(fine)
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
        found.error,
        skew,
        summary,
        max(each.penetration for each in passed),
        max((each.energy_residual for each in kept), key=abs),
    )
    scatter = float(found.by_chance[3]) / 2 * math.sqrt(len(kept))
    steady = _is_steady(fine)
    certain, lacking = steady and found.certain, 0.0
    if not certain and len(passed) < _MOST:
        more = len(kept) * (found.miss**2 - 1) if found.wants_revolutions else _DEARER * len(fine)
        lacking = (more if steady else len(fine)) * joint.evaluations_per_revolution
    return FollowedVibration(
        len(kept),
        len(passed),
        setting,
        float(abs(found.mean[3])),
        scatter,
        float(np.mean([each.unrest for each in kept])),
        steady,
        certain,
        lacking,
        readings,
    )
