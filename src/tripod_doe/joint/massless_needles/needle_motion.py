"""Needles that follow their roller: skew, axial place and forces of every needle of a trunnion, without its inertia.

A roller's motion on its trunnion hardly depends on its needles, so they move with a given motion: the spin s, the
plunging w and the normal force N over a revolution. Frame: t is the trunnion's axis, outward, n the normal of the
trunnion at a needle, tau = t x n. A needle skewed by psi has the axis e = cos psi t - sin psi tau. At the angle gamma
from the load it is pressed by D cos gamma - c; D follows from the balance of all needles' loads f with N. As the roller
turns, a needle rolls around the trunnion by s r_b / (2 r_p), and the trunnion of a bent joint rocks about its
own axis by w_t against the load, once a revolution and mostly in the opposite direction: d gamma / dt = s r_b / (2 r_p)
+ w_t. The motion oscillates: the same few needles carry the load.

Axial place. It rolls freely across its axis, and slips along it on trunnion and bore by v_t + v_b = w cos psi - s r_e
sin psi. In an even gap a free needle slips on both alike, and moves by w / 2 along the trunnion: half of the plunging,
which is 2 e to both sides. But a roller that tilts by b and yaws by a narrows the gap outward, by beta = b cos gamma +
a sin gamma. The normal forces push the needle to the wider side by beta f, and the orbit of the trunnion, at R_p from
the axis, throws it outward by the centrifugal force F = m_n R_p omega^2. Friction must hold both:

    mu_n (tanh(v_t / v_sn) - tanh(v_b / v_sn)) = -beta + F / f.

Friction hardly grows with slip: 2 mrad, a twentieth of mu_n, take a needle with the roller by 0.6 of its motion. So a
centrifugal force of a hundredth of the friction carries needles to their outer stops within a few revolutions. A needle
that flange or retainer stops rolls on in place:

    v_t = -s r_e sin(psi) / 2,    v_b = w cos psi + v_t,
    R = mu_n f (tanh(v_b / v_sn) - tanh(v_t / v_sn)) - beta f + F,

where R is the force of the outer stop. This lasts until the roller turns back. At the stop the end of the needle rubs,
as the needle moves around the trunnion by s r_b / 2: S = mu_n R tanh(s r_b / (2 v_sn)) against that motion. Trunnion
and bore bear half of S each. A skewed needle is shorter along the trunnion, by l (1 - cos psi). Virtual power gives its
force and moment on the roller, along and about the trunnion,

    -mu_n f tanh(v_b / v_sn) cos psi,    mu_n f (r_e / 2) sin psi (tanh(v_t / v_sn) + tanh(v_b / v_sn)) - S r_b / 2.

Yaw. Three moments turn a needle about n:

    wedge      (psi / r_p) (sum over the spheres of f_t x^2 - f_b x^2), x the station along the needle: a skewed needle
               touches the trunnion with its middle and the bore with its ends; the load straightens it.
    stop       R (l / 2) sin psi: the stop pushes the end along t, not along e, as a load buckles a column.
    rubbing    +- S l / 2 at the outer and the inner stop.

Against them acts the friction of the spheres that slip across, at stations x by x psi': while a needle slips along its
axis by v, friction yields to a slip across as if it were viscous, so that

    psi' mu_n f (<x^2>_t tanh(v_t / v_sn) / v_t + <x^2>_b tanh(v_b / v_sn) / v_b) = the sum of the moments.

A needle with little axial slip keeps its skew; else its yaw is proportional to the slip path. Time has no influence;
the speed of the joint only through the centrifugal force.

An unloaded needle is thrown against its outer stop, and lies along its loaded neighbour. Not included: forces between
needles, and the needles' inertia except for the centrifugal force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.massless_needles.load_along_needle import (
    BORE,
    DEPTH,
    LEAN,
    PLACE,
    ROWS,
    SIDE,
    SKEW,
    STOP,
    TRUNNION,
    VARIANCE,
    deepest,
    follow_spread,
    load_centre,
)
from tripod_doe.joint.massless_needles.load_sharing import EXPONENT, OFFSET, PLUNGE, RUBBING, SPIN, YAW, station
from tripod_doe.mechanics.arithmetic.simd_lanes import (
    WIDTH,
    everywhere,
    exponential,
    load,
    logarithm,
    row_of_sums,
    select,
    sine_cosine,
    spread,
    store,
)
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel_part
from tripod_doe.mechanics.laws.contact import contact_secant
from tripod_doe.mechanics.laws.friction import relative_tangent

RECORD = np.dtype([(name, float) for name in ("load", "angle", "place", "skew", "stop", "line")])
"""Recorded state of a needle: its angle from the load, largest load per length on the trunnion, and others."""

_REFRESHED = 4
"""Steps between updates of the load distribution along straight needles. For crowned needles each step updates it: it
changes more with the load, and with it all resistance to yaw."""
_FIRST_LOOKS = 3
"""Newton steps for the load distribution of a newly loaded needle."""
_MOST_SLIP = 300.0
"""Limit of a needle's slip over its transition velocity: larger values overflow the exponential."""
_HOLDS = 1e-6
"""Least resistance to yaw over its largest possible value; below it the resistance counts as zero."""


@inlined_kernel
def _free_slip(c, total, slope):
    """Slip of free needles on the trunnion: they slip by `total` on both, in a gap that narrows outward by `slope`.

    tanh u - tanh v = 2 sinh(u - v) / (cosh(u + v) + cosh(u - v)), a quadratic equation for exp(|u - v|).
    """
    both = min(max(total * (1.0 / c.transition), -_MOST_SLIP), _MOST_SLIP)
    held = min(abs(slope * (1.0 / c.sliding)), 1.0)
    growth = exponential(both)
    spread = 0.25 * held * (growth + 1.0 / growth)
    root = math.sqrt(spread * spread + 1.0 - 0.25 * held * held)
    apart = c.transition * logarithm((spread + root) / (1.0 - 0.5 * held))
    return 0.5 * (total + select(slope > 0.0, -apart, apart))


@kernel_part
def _move(c, state, carried, motion, gap, turned, duration):
    """Move eight needles of a trunnion on by a step: their forces along it on the roller, and moments about it.

    `motion` is spin, plunging of the bore, place of the load, and rubbing; `gap` the roller's tilt and yaw and their
    rates; `turned` cosine and sine of the needles' angles. Centrifugal force counts as a widening gap.
    """
    spin, plunge, offset, rubs = motion
    tilt, yaw, tilting, yawing = gap
    place, skew = load(state, PLACE), load(state, SKEW)
    on_t, on_b = load(state, TRUNNION + VARIANCE), load(state, BORE + VARIANCE)
    sine, cosine = sine_cosine(skew)
    bore = plunge - c.bore_radius * (tilting * (1.0 - turned[0]) - yawing * turned[1])
    turning = 0.5 * c.lever * spin * sine
    total = bore * cosine - 2.0 * turning
    # limited to what friction on trunnion and bore can hold
    slope = tilt * turned[0] + yaw * turned[1] - min(c.thrown / max(carried, 1e-30), 2.0 * c.sliding)
    free = _free_slip(c, total, slope)
    moved = (free + turning) / cosine * duration
    wanted = place + moved
    reach = c.reach + 0.5 * c.length * (1.0 - cosine)
    stopped = abs(wanted) > reach
    side = select(wanted > 0.0, spread(1.0), spread(-1.0))
    # part of a step with the needle at its stop: in the step of arrival, the part after it
    rest = min((abs(wanted) - reach) / max(abs(moved), 1e-30), 1.0)
    share = select(stopped, select(side * load(state, SIDE) > 0.0, 1.0, rest), 0.0)
    store(state, SIDE, select(stopped, side, 0.0))
    new_place = select(stopped, side * reach, wanted)
    on_trunnion = select(stopped, -turning, free)
    steepest = 1.0 / c.transition
    over_t, over_b = steepest * on_trunnion, steepest * (total - on_trunnion)
    hold_t, hold_b = relative_tangent(abs(over_t)), relative_tangent(abs(over_b))
    drag_t, drag_b = c.sliding * over_t * hold_t, c.sliding * over_b * hold_b
    yields = on_t * hold_t + on_b * hold_b
    if not everywhere(share * (1.0 - share) <= 0.0):
        hold_t, hold_b = relative_tangent(abs(steepest * free)), relative_tangent(abs(steepest * (total - free)))
        yields = share * yields + (1.0 - share) * (on_t * hold_t + on_b * hold_b)
    stop = select(stopped, max(side * (drag_b - drag_t - slope), 0.0), 0.0)
    store(state, STOP, side * stop * carried)
    stop = share * stop
    rubbing = rubs * stop
    wedge = (1.0 / c.pitch_radius) * (on_t - on_b)
    held = c.sliding / c.transition * yields
    lever = 0.5 * c.length - side * load_centre(c, offset, new_place)
    moments = wedge * skew + lever * (stop * sine + side * rubbing)
    # the wedge grows with the cube of the skew: implicit in the skew, so that it never overshoots
    resistance = held + 3.0 * duration * max(-wedge, 0.0)
    # one sphere alone gives no skew
    holds = held > _HOLDS * c.sliding * c.length * c.length / c.transition
    store(state, SKEW, skew + select(holds, duration * moments / resistance, 0.0))
    store(state, PLACE, new_place)
    force = -drag_b * cosine
    moment = 0.5 * c.lever * sine * (drag_t + drag_b) - 0.5 * c.bore_radius * rubbing
    return carried * force, carried * moment


@dataclass(frozen=True, eq=False)
class NeedleRing(ByReference):
    """State of the needles of three trunnions."""

    state: FloatArray  # rows of `needle_contact` of all needles that carry, shape (3, blocks, `ROWS`, 8)
    # roller, shape (3, 3): its tilt and yaw a step ago, and the mean place of its needles
    roller: FloatArray
    carrying: IntArray  # outermost needles that carried a step ago, shape (3, 2)
    past: FloatArray  # skews of all needles one and two revolutions ago, shape (3, blocks, 2, 8)

    @classmethod
    def for_blocks(cls, blocks: int) -> NeedleRing:
        """Memory for `blocks` blocks of eight needles that carry."""
        state, past = np.zeros((3, blocks, ROWS, WIDTH)), np.zeros((3, blocks, 2, WIDTH))
        return cls(state, np.zeros((3, 3)), np.zeros((3, 2), np.int64), past)


TILTED, YAWED, PLACED = range(3)
"""Columns of `NeedleRing.roller`."""


@inlined_kernel
def _come_under_load(c, state, deep, slots, number, other):
    """Put a needle at its outer stop, along the one next to it."""
    block, lane, of = number % slots // WIDTH, number % slots % WIDTH, other % slots
    state[block, PLACE, lane], state[block, SKEW, lane] = c.reach, state[of // WIDTH, SKEW, of % WIDTH]
    state[block, SIDE, lane] = 1.0
    state[block, TRUNNION + DEPTH, lane] = state[block, BORE + DEPTH, lane] = deep
    state[block, TRUNNION + LEAN, lane] = state[block, BORE + LEAN, lane] = 0.0


@kernel_part
def _admit(c, state, needles, k, step, carrying, first, last):
    """Start newly loaded needles in their unloaded state, along their neighbours; returns whether there are any."""
    slots = WIDTH * needles.blocks
    if first >= carrying[0] and last <= carrying[1]:
        carrying[0], carrying[1] = first, last
        return False
    for number in range(carrying[1] + 1, last + 1):
        slot = number % slots
        deep = deepest(c, needles.loads[k, slot // WIDTH, step, slot % WIDTH])
        _come_under_load(c, state, deep, slots, number, number - 1)
    for number in range(carrying[0] - 1, first - 1, -1):
        slot = number % slots
        deep = deepest(c, needles.loads[k, slot // WIDTH, step, slot % WIDTH])
        _come_under_load(c, state, deep, slots, number, number + 1)
    carrying[0], carrying[1] = first, last
    return True


@kernel_part
def step_on(c, tilt, at, needles, ring, k, step, duration):
    """Move all needles of a trunnion that carry load on by a step.

    Returns sums over needles: place times load, skew times load, force along and moment about the trunnion.
    """
    i, n, state, roller = step // WIDTH, step % WIDTH, ring.state[k], ring.roller[k]
    new = _admit(c, state, needles, k, step, ring.carrying[k], at.first[k, i, n], at.last[k, i, n])
    motion = at.motion[k, step]
    offset, yaw = motion[OFFSET], motion[YAW]
    lean = tilt * (offset - roller[PLACED])
    gap = (lean, yaw, (lean - roller[TILTED]) / duration, (yaw - roller[YAWED]) / duration)
    roller[TILTED], roller[YAWED] = lean, yaw
    looks = _FIRST_LOOKS if new else 1 if c.drop > 0.0 or step % _REFRESHED == 0 else 0
    placed, skewed, force, moment = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for b in range(needles.blocks):
        carried = load(needles.loads[k, b], step)
        place, skew = load(state[b], PLACE), load(state[b], SKEW)
        placed, skewed = placed + carried * place, skewed + carried * skew
        if looks > 0:
            deep = deepest(c, carried)
            for _ in range(looks):
                follow_spread(c, state[b], carried, offset, deep)
        turned = load(needles.cosines[k, b], step), load(needles.sines[k, b], step)
        acting = (motion[SPIN], motion[PLUNGE], offset, c.sliding * motion[RUBBING])
        along, about = _move(c, state[b], carried, acting, gap, turned, duration)
        force, moment = force + along, moment + about
    return row_of_sums(placed, skewed, force, moment, 0.0, 0.0)


@kernel_part
def start_needles(c, skews, tilt, at, needles, ring):
    """Put all needles in the middle, at their initial skews."""
    for k in range(3):
        for b in range(needles.blocks):
            deep, state = deepest(c, load(needles.loads[k, b], 0)), ring.state[k, b]
            for at_row in range(ROWS):
                store(state, at_row, spread(0.0))
            store(state, SKEW, spread(skews[k]))
            store(state, TRUNNION + DEPTH, deep)
            store(state, BORE + DEPTH, deep)
        motion, roller = at.motion[k, 0], ring.roller[k]
        roller[TILTED], roller[YAWED], roller[PLACED] = tilt * motion[OFFSET], motion[YAW], 0.0
        ring.carrying[k, 0], ring.carrying[k, 1] = at.first[k, 0, 0], at.last[k, 0, 0]
        for b in range(needles.blocks):
            for _ in range(2 * _FIRST_LOOKS):
                carried = load(needles.loads[k, b], 0)
                follow_spread(c, ring.state[k, b], carried, motion[OFFSET], deepest(c, carried))


@kernel_part
def _line_load(c, state, block, lane):
    """Largest load per length along a needle's contact with its trunnion."""
    deepest_of_all, skew = 0.0, state[block, SKEW, lane]
    depth, lean = state[block, TRUNNION + DEPTH, lane], state[block, TRUNNION + LEAN, lane]
    drop = c.drop + 0.5 * skew * skew / c.pitch_radius
    for i in range(int(c.spheres)):
        along = station(c, i)
        deepest_of_all = max(deepest_of_all, depth + (lean - drop * along) * along)
    return contact_secant(c.stiffness, EXPONENT, deepest_of_all) * deepest_of_all / c.length


@kernel_part
def record_needles(c, at, needles, state, k, step, records):
    """Record all needles of a trunnion; unloaded needles lie at their outer stop, along the last loaded needle."""
    i, n, count, slots = step // WIDTH, step % WIDTH, int(c.needles), WIDTH * needles.blocks
    first, last, nearest = at.first[k, i, n], at.last[k, i, n], at.nearest[k, i, n]
    turned = math.atan2(at.sines[k, i, n], at.cosines[k, i, n])
    for number in range(first, first + count):
        one, like = records[number % count], min(number, last) % slots
        block, lane = like // WIDTH, like % WIDTH
        one.angle = turned + 2.0 * math.pi / count * (number - nearest)
        one.skew, one.place = state[block, SKEW, lane], c.reach
        one.load, one.stop, one.line = 0.0, 0.0, 0.0
        if number <= last:
            one.load, one.stop = needles.loads[k, block, step, lane], state[block, STOP, lane]
            one.place, one.line = state[block, PLACE, lane], _line_load(c, state, block, lane)
