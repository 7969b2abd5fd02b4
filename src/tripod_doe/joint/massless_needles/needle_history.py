"""Revolutions of the needles: a given number after their start, or until they repeat.

A shaft turns millions of times; the skews of its needles settle within ten to a thousand revolutions. A needle's place
along its trunnion follows the roller within a revolution or two; its skew changes slowly and independently. To find the
periodic state, skews are extrapolated after every third revolution: from the changes d_0 and d_1 in the last two and q
= d_1 / d_0, a skew will change by d_1 q / (1 - q) more (Aitken, Proc. Roy. Soc. Edinburgh 46, 1926). A skew that
accelerates, q > 1, leaves an unstable equilibrium, and moves on by some of its changes. The remaining change of every
needle must be small before the last two revolutions follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.massless_needles.load_along_needle import SKEW
from tripod_doe.joint.massless_needles.load_sharing import load_needles
from tripod_doe.joint.massless_needles.needle_constants import needle_constants_of
from tripod_doe.joint.massless_needles.needle_motion import (
    FORCE,
    MOMENT,
    SKEWED,
    record_needles,
    start_needles,
    step_on,
)
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load_three, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part

_BETWEEN = 3
"""Revolutions between extrapolations: the first adapts the places, two show the changes of the skews."""
_MOST = 200
"""Revolutions after which needles count as not periodic."""
_SMALL, _SMALL_SHARE = 5e-5, 5e-3
"""Allowed remaining change of skews: in rad, and over the skews."""
_SHARE, _AHEAD = 0.5, 100.0
"""Largest step of a skew: over the skew, and over its last change."""
_UNKNOWN = 1e3
"""Assumed remaining change of a skew over its last change, if extrapolation gives none."""
_LEAVES, _NOISE = 0.01, 1e-10
"""Skew in rad of a needle that is leaving an unstable place, and its least change that is no rounding."""


@dataclass(frozen=True, eq=False)
class NeedleForces(ByReference):
    """Effects of the needles of three trunnions in the last revolutions; arrays of shape (revolution, 3, sample)."""

    # forces, moments: of their sliding friction on the roller along and about its trunnion, over N, in 1 and mm
    forces: FloatArray
    moments: FloatArray
    places: FloatArray  # where they are along the trunnion, mm
    # mean skew of a trunnion's needles, weighted with their loads, rad, shape (revolution, 3)
    skews: FloatArray
    history: FloatArray  # number of revolutions, and 1 if needles repeat, if requested; shape (2,)

    @classmethod
    def of_last(cls, revolutions: int, samples: int) -> NeedleForces:
        """Memory for `revolutions` revolutions, at least two."""
        shape = (revolutions, 3, samples)
        return cls(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros((revolutions, 3)), np.zeros(2))


@kernel_part
def _clear(found, revolution):
    """Set the needle results of a revolution to zero."""
    for k in range(3):
        found.skews[revolution, k] = 0.0
        for j in range(found.forces.shape[2]):
            found.forces[revolution, k, j] = found.moments[revolution, k, j] = found.places[revolution, k, j] = 0.0


@kernel_part
def _remember(ring, needles):
    """Note the skews at the end of a revolution."""
    for b in range(needles.blocks):
        store(ring.past[b], 1, load_three(ring.past[b], 0))
        store(ring.past[b], 0, load_three(ring.state[b], SKEW))


@inlined_kernel
def _left(last, before):
    """Remaining change of a skew, from its last two changes."""
    if last * before <= 0.0:  # it goes to and fro, for half of what it does in two
        return 0.5 * (last + before) if last * before < 0.0 else last
    if abs(before) > (1.0 + 1.0 / _UNKNOWN) * abs(last):
        return last * last / (before - last)
    return math.copysign(max(_UNKNOWN * abs(last), _LEAVES if abs(last) > _NOISE else 0.0), last)


@kernel_part
def _left_over(ring, needles, k):
    """Remaining changes of the skews of trunnion k over the limit: mean magnitude, weighted with the needles' loads."""
    over, carried, skewed = 0.0, 0.0, 0.0
    for b in range(needles.blocks):
        for lane in range(WIDTH * k, WIDTH * (k + 1)):
            now, weight = ring.state[b, SKEW, lane], needles.loads[b, 0, lane]
            left = _left(now - ring.past[b, 0, lane], ring.past[b, 0, lane] - ring.past[b, 1, lane])
            over, carried, skewed = over + weight * abs(left), carried + weight, skewed + weight * abs(now)
    return over / (_SMALL * carried + _SMALL_SHARE * skewed)


@kernel_part
def _hasten(ring, needles):
    """Move all skews to their extrapolated values."""
    for b in range(needles.blocks):
        for lane in range(3 * WIDTH):
            now = ring.state[b, SKEW, lane]
            last = now - ring.past[b, 0, lane]
            left = _left(last, ring.past[b, 0, lane] - ring.past[b, 1, lane])
            most = min(_SHARE * abs(now) + _SMALL, _AHEAD * abs(last))
            ring.state[b, SKEW, lane] = now + min(max(left, -most), most)


@kernel
def follow_rollers(row, skew, tilt, at, needles, ring, found, skews, records):
    """Move the needles of three trunnions along a revolution of their rollers, again and again.

    Parameters
    ----------
    row
        Of the table of `NeedleConstants`.
    skew
        Of all needles of each trunnion at the start, rad, shape (3,).
    tilt
        Of the rollers over the distance of their load from the middle of the needles, rad/mm.
    at
        `NeedleSteps` after `press_needles`.
    needles, ring
        `NeedleLoads` and `NeedleRing` for as many needles as carry.
    found
        `NeedleForces`, which receives what the needles do.
    skews
        Receives the skew of the needle that carries the most, over all revolutions, shape (3, cycles sample); where
        needles shall repeat, the last two are those that do.
    records
        Receives a `RECORD` of every needle over the last two revolutions, shape (3, 2 x sample, needle), or is empty.
    """
    c, samples, slots = needle_constants_of(row), at.steps // at.parts, WIDTH * needles.blocks
    load_needles(c, at, needles)
    start_needles(c, skew, tilt, at, needles, ring)
    duration, cycles, kept = 2.0 * math.pi / c.speed / at.steps, int(c.cycles), found.forces.shape[0]
    for revolution in range(kept):
        _clear(found, revolution)
    waits, turned, cycle, since = c.settles > 0.0, 0, 0, 0
    found.history[1] = 0.0
    while cycle < cycles:
        revolution = cycle - cycles + kept
        if revolution >= 0:
            _clear(found, revolution)
        for step in range(at.steps):
            i, n, sample = step // WIDTH, step % WIDTH, step // at.parts
            step_on(c, tilt, at, needles, ring, step, duration)
            if step % at.parts > 0:
                continue
            for k in range(3):
                most, lane = at.most[k, i, n] % slots, WIDTH * k
                skews[k, cycle * samples + sample] = ring.state[most // WIDTH, SKEW, lane + most % WIDTH]
                if cycle >= cycles - 2 and not waits and records.size > 0:
                    at_sample = (cycle - cycles + 2) * samples + sample
                    record_needles(c, at, needles, ring.state, k, step, records[k, at_sample])
                if revolution >= 0:
                    over = 1.0 / at.bearing_loads[k, i, n]
                    found.forces[revolution, k, sample] = over * ring.sums[1, lane + FORCE]
                    found.moments[revolution, k, sample] = over * ring.sums[1, lane + MOMENT]
                    found.places[revolution, k, sample] = ring.placed[0, k]
                    found.skews[revolution, k] += ring.sums[0, lane + SKEWED] / at.carried[k, i, n] / samples
        turned += 1
        if waits and cycle == cycles - 2:
            since += 1
            if since == _BETWEEN:
                since, over = 0, 0.0
                for k in range(3):
                    over = max(over, _left_over(ring, needles, k))
                found.history[1] = 1.0 if over <= 1.0 else 0.0
                waits = over > 1.0 and turned < _MOST
                if waits:
                    _hasten(ring, needles)
        else:
            cycle += 1
        _remember(ring, needles)
    found.history[0] = turned
