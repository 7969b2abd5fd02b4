"""Loads of the needles of a bearing at every step of a revolution, eight steps at a time (`simd_lanes`).

The roller's motion alone determines them, not the needles' places and skews: the compression of a needle at the angle
gamma from the load is D cos gamma - c; D follows from the balance of all needle loads and the bearing load. Needle i
starts at i / count of a turn; all move together, and numbers continue around the trunnion. After a revolution all
needles are assumed to be at their start; in fact skewed ones creep by some 1e-4 rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.massless_needles.needle_constants import needle_constants_of
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, clear, everywhere, load, select, spread, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part
from tripod_doe.mechanics.laws.contact import contact_secant
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent

MOST_NEEDLES = 100
"""Of a trunnion."""
EXPONENT = 10.0 / 9.0
"""Of Eq. 2 for needles."""
SPIN, PLUNGE, OFFSET, YAW, RUBBING = range(5)
"""Rows of `NeedleSteps.motion`; the last is tanh of the slip of a needle's end on its stop over v_sn."""
_LEAST_STEPS = 360
"""Fewest steps of a revolution."""
_NEWTON = 60
"""Most iterations of the bearings' balances; two are usual."""
_NEARLY = 1e-5
"""Limit of the last change of a shift over the shift: the remaining error is of the order of its square."""


@dataclass(frozen=True, eq=False)
class RollerMotions(ByReference):
    """Three rollers over one revolution; arrays of shape (3, eights, 8), not read beyond the last sample."""

    samples: int
    # spins, turns: of the roller on its trunnion, and of the trunnion about its axis against the load, rad/s
    spins: FloatArray
    turns: FloatArray
    plunges: FloatArray  # of the bore along the trunnion, outward, mm/s
    loads: FloatArray  # normal force, N
    offsets: FloatArray  # place of the load along the needles, from their middle, mm
    yaws: FloatArray  # which narrow the gap outward at gamma = 90 deg, rad

    @classmethod
    def for_samples(cls, samples: int) -> RollerMotions:
        """Memory for a number of samples per revolution."""
        shape = (3, -(-samples // WIDTH), WIDTH)
        return cls(samples, *(np.zeros(shape) for _ in range(6)))


@dataclass(frozen=True, eq=False)
class NeedleSteps(ByReference):
    """A revolution of three trunnions in steps; arrays of shape (3, eights, 8) unless said otherwise."""

    parts: int  # steps of a sample
    steps: int  # of a revolution
    motion: FloatArray  # values at every step in the order of `SPIN` and so on, shape (steps, 5, 3)
    bearing_loads: FloatArray  # N
    shifts: FloatArray  # D, mm
    # cosines, sines: of the angle from the load to the nearest needle
    cosines: FloatArray
    sines: FloatArray
    nearest: IntArray  # number of that needle
    around: FloatArray  # cosine and sine of the angle from a needle to its n-th neighbour, shape (n, 2)
    found: FloatArray  # room for three numbers of a needle at eight steps, shape (3, 8)
    # first, last, most: numbers of the outermost needles that carry, and of the one that carries the most
    first: IntArray
    last: IntArray
    most: IntArray
    carried: FloatArray  # sum of all needles' loads

    @classmethod
    def for_samples(cls, samples: int, finer: int = 1) -> NeedleSteps:
        """Memory for a number of samples per revolution; a factor refines the usual steps."""
        parts = finer * -(-_LEAST_STEPS // samples)
        steps = samples * parts
        shape = (3, -(-steps // WIDTH), WIDTH)
        reals, wholes = (lambda: np.zeros(shape)), (lambda: np.zeros(shape, np.int64))
        motion, around = np.zeros((steps, RUBBING + 1, 3)), np.zeros((MOST_NEEDLES // 2 + 1, 2))
        return cls(
            parts,
            steps,
            motion,
            reals(),
            reals(),
            reals(),
            reals(),
            wholes(),
            around,
            np.zeros((3, WIDTH)),
            wholes(),
            wholes(),
            wholes(),
            reals(),
        )


@dataclass(frozen=True, eq=False)
class NeedleLoads(ByReference):
    """Loads of all loaded needles, eight of each trunnion after the other; arrays of shape (blocks, steps, 24)."""

    blocks: int
    loads: FloatArray  # N
    # cosines, sines: of the angle from the load
    cosines: FloatArray
    sines: FloatArray

    @classmethod
    def for_blocks(cls, blocks: int, steps: int) -> NeedleLoads:
        """Memory for `blocks` blocks of eight needles that carry."""
        return cls(blocks, *(np.zeros((blocks, steps, 3 * WIDTH)) for _ in range(3)))


@inlined_kernel
def station(c, i):
    """Station of sphere i along its needle."""
    return c.length * ((i + 0.5) / c.spheres - 0.5)


@kernel_part
def _load_on_both(c, pressed):
    """Loads of straight needles pressed between trunnion and bore, and their derivatives."""
    if c.drop == 0.0:
        secant = 0.5 * contact_secant(c.stiffness, EXPONENT, 0.5 * pressed)
        return secant * pressed, EXPONENT * secant
    carried, slope = spread(0.0), spread(0.0)
    for i in range(int(c.spheres)):
        at = station(c, i)
        compressed = max(0.5 * pressed - c.drop * at * at, 0.0)
        secant = contact_secant(c.stiffness / c.spheres, EXPONENT, compressed)
        carried = carried + secant * compressed
        slope = slope + 0.5 * EXPONENT * select(compressed > 0.0, secant, 0.0)
    return carried, slope


@inlined_kernel
def _needles_towards(c, direction):
    """Numbers of needles on one side of the load; the nearest needle belongs to the first side."""
    count = int(c.needles)
    return (0, count // 2 + 1) if direction > 0.0 else (1, (count + 1) // 2)


@inlined_kernel
def _turned(around, number, direction, cosine, sine):
    """Cosine and sine of the angle from the load to the n-th needle from the nearest one."""
    along, across = around[number, 0], direction * around[number, 1]
    return cosine * along - sine * across, sine * along + cosine * across


@kernel_part
def _balance_eight(c, around, bearing_load, cosine, sine, shift):
    """Shifts of eight bearings in balance with their needle loads, and the farthest loaded needle of any bearing."""
    farthest = 0
    for _ in range(_NEWTON):
        along, slope, farthest = spread(0.0), spread(0.0), 0
        for direction in (1.0, -1.0):
            start, stop = _needles_towards(c, direction)
            for number in range(start, stop):
                toward, _ = _turned(around, number, direction, cosine, sine)
                pressed = max(shift * toward - c.clearance, 0.0)
                if everywhere(pressed <= 0.0):
                    break
                carried, rise = _load_on_both(c, pressed)
                along, slope = along + carried * toward, slope + rise * (toward * toward)
                farthest = max(farthest, number)
        some = along > 0.0
        change = (bearing_load - along) / slope
        closer = max(shift + change, 0.5 * shift)
        if everywhere(some) and everywhere(abs(change) <= _NEARLY * shift):
            return closer, farthest
        shift = select(some, closer, 1.5 * shift + 1e-4)
    return shift, farthest


@inlined_kernel
def _at_step(values, k, sample, share):
    """Value of a motion between a sample and the next, around the revolution of `values.samples` samples."""
    first = values[0][k, sample // WIDTH, sample % WIDTH]
    if share == 0.0:
        return first
    after = sample + 1 if sample + 1 < values[1] else 0
    return first + share * (values[0][k, after // WIDTH, after % WIDTH] - first)


@kernel_part
def _walk(c, roller, at, k):
    """Interpolate the motion of roller k, and follow the needles around the trunnion."""
    samples, spacing = roller.samples, 2.0 * math.pi / c.needles
    duration = 2.0 * math.pi / c.speed / at.steps
    ahead = 0.0
    for j in range(samples):
        i, n = j // WIDTH, j % WIDTH
        ahead += 0.5 * c.bore_radius / c.pitch_radius * roller.spins[k, i, n] + roller.turns[k, i, n]
    creep, turned = ahead / samples, 0.0
    for step in range(WIDTH * at.shifts.shape[1]):
        j = step % at.steps
        sample, share, i, n = j // at.parts, (j % at.parts) / at.parts, step // WIDTH, step % WIDTH
        spin = _at_step((roller.spins, samples), k, sample, share)
        nearest = round(-turned / spacing)
        angle = nearest * spacing + turned
        at.nearest[k, i, n] = nearest
        at.cosines[k, i, n], at.sines[k, i, n] = math.cos(angle), math.sin(angle)
        at.bearing_loads[k, i, n] = _at_step((roller.loads, samples), k, sample, share)
        turning = _at_step((roller.turns, samples), k, sample, share)
        turned += (0.5 * c.bore_radius / c.pitch_radius * spin + turning - creep) * duration
        if step < at.steps:
            motion = at.motion[step]
            motion[SPIN, k], motion[PLUNGE, k] = spin, _at_step((roller.plunges, samples), k, sample, share)
            motion[OFFSET, k] = _at_step((roller.offsets, samples), k, sample, share)
            motion[YAW, k] = _at_step((roller.yaws, samples), k, sample, share)
            motion[RUBBING, k] = hyperbolic_tangent(0.5 * c.bore_radius * spin / c.transition)


@kernel
def press_needles(row, roller, at):
    """Find the shift of three rollers across their trunnions at every step of a revolution.

    Parameters
    ----------
    row
        Of the table of `NeedleConstants`.
    roller
        `RollerMotions`.
    at
        `NeedleSteps`, which receives the steps.

    Returns
    -------
    int
        Largest number of needles that carry load at a time.
    """
    c, most = needle_constants_of(row), 0
    for number in range(int(c.needles) // 2 + 1):
        angle = 2.0 * math.pi * number / c.needles
        at.around[number, 0], at.around[number, 1] = math.cos(angle), math.sin(angle)
    for k in range(3):
        _walk(c, roller, at, k)
        shift = spread(max(c.clearance, 0.0) + 2.0 * (at.bearing_loads[k, 0, 0] / c.stiffness) ** 0.9)
        for i in range(at.shifts.shape[1]):
            bearing_load, cosine, sine = load(at.bearing_loads[k], i), load(at.cosines[k], i), load(at.sines[k], i)
            shift, farthest = _balance_eight(c, at.around, bearing_load, cosine, sine, shift)
            store(at.shifts[k], i, shift)
            most = max(most, 2 * farthest + 1)
    return min(most, int(c.needles))


@kernel_part
def load_needles(c, at, needles):
    """Write the loads of all needles into `needles`, a `NeedleLoads`, from the shifts in `at`, a `NeedleSteps`."""
    slots, eight = WIDTH * needles.blocks, at.found
    clear(needles.loads)
    for k in range(3):
        for i in range(at.shifts.shape[1]):
            shift, cosine, sine = load(at.shifts[k], i), load(at.cosines[k], i), load(at.sines[k], i)
            for n in range(WIDTH):
                at.most[k, i, n] = at.nearest[k, i, n] % slots  # until all are known
            carried, largest = spread(0.0), spread(0.0)
            first, last, most = carried, carried, carried
            for direction in (1.0, -1.0):
                start, stop = _needles_towards(c, direction)
                for number in range(start, stop):
                    toward, aside = _turned(at.around, number, direction, cosine, sine)
                    pressed = max(shift * toward - c.clearance, 0.0)
                    if everywhere(pressed <= 0.0):
                        break
                    found, away = _load_on_both(c, pressed)[0], direction * number
                    first = select(found > 0.0, min(first, away), first)
                    last = select(found > 0.0, max(last, away), last)
                    most, largest = select(found > largest, away, most), max(found, largest)
                    carried = carried + found
                    store(eight, 0, found)
                    store(eight, 1, toward)
                    store(eight, 2, aside)
                    for n in range(min(WIDTH, at.steps - WIDTH * i)):
                        if eight[0, n] > 0.0:
                            _put(at, needles, (k, i, n), int(away), slots)
            store(at.carried[k], i, carried)
            store(eight, 0, first)
            store(eight, 1, last)
            store(eight, 2, most)
            for n in range(WIDTH):
                nearest = at.nearest[k, i, n]
                at.first[k, i, n], at.last[k, i, n] = nearest + int(eight[0, n]), nearest + int(eight[1, n])
                at.most[k, i, n] = nearest + int(eight[2, n])


@inlined_kernel
def _put(at, needles, place, away, slots):
    """Write the load of the needle `away` places from the nearest one, whose slot `at.most` holds meanwhile."""
    k, i, n = place
    slot, step = at.most[k, i, n] + away, WIDTH * i + n
    slot += slots if slot < 0 else -slots if slot >= slots else 0
    block, lane = slot // WIDTH, WIDTH * k + slot % WIDTH
    needles.loads[block, step, lane] = at.found[0, n]
    needles.cosines[block, step, lane] = at.found[1, n]
    needles.sines[block, step, lane] = at.found[2, n]
