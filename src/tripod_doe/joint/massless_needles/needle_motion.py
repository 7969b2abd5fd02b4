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
    UNKNOWN,
    VARIANCE,
    balance_unknown,
    follow_spread,
    load_centre,
)
from tripod_doe.joint.massless_needles.load_sharing import EXPONENT, OFFSET, PLUNGE, RUBBING, SPIN, YAW, station
from tripod_doe.mechanics.arithmetic.elementary_functions import exponential, exponentials, logarithm, sine_cosine
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, across, clear, load_three, row_of_sums, select, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel_part
from tripod_doe.mechanics.laws.contact import contact_secant

RECORD = np.dtype([(name, float) for name in ("load", "angle", "place", "skew", "stop", "line")])
"""Recorded state of a needle: its angle from the load, largest load per length on the trunnion, and others."""

_REFRESHED = 4
"""Steps between updates of the load distribution along straight needles. For crowned needles each step updates it: it
changes more with the load, and with it all resistance to yaw."""
_MOST_SLIP = 200.0
"""Limit of a needle's slip over its transition velocity: products of larger exponentials overflow."""
_LITTLE_SLIP = 1e-2
"""Slip over its transition velocity below which friction is a power series."""
_HOLDS = 1e-6
"""Least resistance to yaw over its largest possible value; below it the resistance counts as zero."""


@inlined_kernel
def _free_slip(c, total, slope):
    """Slip of free needles on the trunnion: they slip by `total` on both, in a gap that narrows outward by `slope`.

    With u and v, the slips on trunnion and bore over the transition velocity, tanh u - tanh v = 2 sinh(u - v) /
    (cosh(u + v) + cosh(u - v)), a quadratic equation for exp(|u - v|). Returned are the slip, exp(u + v), and this.
    """
    both = min(max(total * (1.0 / c.transition), -_MOST_SLIP), _MOST_SLIP)
    held = min(abs(slope * (1.0 / c.sliding)), 1.0)
    growth, decay = exponentials(both)
    spread = 0.25 * held * (growth + decay)
    root = math.sqrt(spread * spread + 1.0 - 0.25 * held * held)
    apart = (spread + root) * (1.0 / (1.0 - 0.5 * held))
    difference = c.transition * logarithm(apart)
    return 0.5 * (total + select(slope > 0.0, -difference, difference)), growth, apart


@inlined_kernel
def _little(slip):
    """tanh(u) / u of little slip."""
    square = slip * slip
    return 1.0 - square * (1 / 3 - square * (2 / 15 - square * (17 / 315)))


@inlined_kernel
def _grips(slips, tops, bottoms):
    """tanh(u) / u of two slips, of which exp(2 u) is top over bottom: one division for both."""
    (u, v), (top_u, top_v), (bottom_u, bottom_v) = slips, tops, bottoms
    little_u, little_v = abs(u) < _LITTLE_SLIP, abs(v) < _LITTLE_SLIP
    under_u, under_v = (top_u + bottom_u) * select(little_u, 1.0, u), (top_v + bottom_v) * select(little_v, 1.0, v)
    over = 1.0 / (under_u * under_v)
    grip_u, grip_v = (top_u - bottom_u) * (under_v * over), (top_v - bottom_v) * (under_u * over)
    return select(little_u, _little(u), grip_u), select(little_v, _little(v), grip_v)


@kernel_part
def _move(c, state, carried, motion, gap, turned, duration):
    """Move eight needles of each trunnion on by a step: their forces along it on the roller, and moments about it.

    `motion` is spin, plunging of the bore, place of the load, and rubbing; `gap` the roller's tilt and yaw and their
    rates; `turned` cosine and sine of the needles' angles. Centrifugal force counts as a widening gap.
    """
    spin, plunge, offset, rubs = motion
    tilt, yaw, tilting, yawing = gap
    place, skew = load_three(state, PLACE), load_three(state, SKEW)
    on_t, on_b = load_three(state, TRUNNION + VARIANCE), load_three(state, BORE + VARIANCE)
    sine, cosine = sine_cosine(skew)
    bore = plunge - c.bore_radius * (tilting * (1.0 - turned[0]) - yawing * turned[1])
    turning = 0.5 * c.lever * spin * sine
    total = bore * cosine - 2.0 * turning
    # limited to what friction on trunnion and bore can hold
    slope = tilt * turned[0] + yaw * turned[1] - min(c.thrown / max(carried, 1e-30), 2.0 * c.sliding)
    free, growth, apart = _free_slip(c, total, slope)
    moved = (free + turning) * (duration / cosine)
    wanted = place + moved
    reach = c.reach + 0.5 * c.length * (1.0 - cosine)
    stopped = abs(wanted) > reach
    side = select(wanted > 0.0, 1.0, -1.0)
    # part of a step with the needle at its stop: in the step of arrival, the part after it
    rest = min((abs(wanted) - reach) / max(abs(moved), 1e-30), 1.0)
    share = select(stopped, select(side * load_three(state, SIDE) > 0.0, 1.0, rest), 0.0)
    store(state, SIDE, select(stopped, side, 0.0))
    new_place = select(stopped, side * reach, wanted)
    steepest, narrows, product = 1.0 / c.transition, slope > 0.0, growth * apart
    free_t, free_b = steepest * free, steepest * (total - free)
    tops, bottoms = (growth, product), (apart, 1.0)
    tops = select(narrows, tops[0], tops[1]), select(narrows, tops[1], tops[0])
    bottoms = select(narrows, bottoms[0], bottoms[1]), select(narrows, bottoms[1], bottoms[0])
    hold_t, hold_b = _grips((free_t, free_b), tops, bottoms)
    over_t, over_b = -steepest * turning, steepest * (total + turning)
    turns = exponential(min(max(2.0 * over_t, -_MOST_SLIP), _MOST_SLIP))
    stop_t, stop_b = _grips((over_t, over_b), (turns, growth * growth), (1.0 + 0.0 * turns, turns))
    yields = share * (on_t * stop_t + on_b * stop_b) + (1.0 - share) * (on_t * hold_t + on_b * hold_b)
    drag_t = c.sliding * select(stopped, over_t * stop_t, free_t * hold_t)
    drag_b = c.sliding * select(stopped, over_b * stop_b, free_b * hold_b)
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
    """State of the needles of three trunnions; rows of 24 lanes have eight needles of each."""

    state: FloatArray  # rows of `load_along_needle` of all needles that carry, shape (blocks, `ROWS`, 24)
    roller: FloatArray  # tilt and yaw of each roller a step ago, shape (2, 24)
    placed: FloatArray  # mean place of each roller's needles, shape (1, 3)
    # sums over the needles of each roller in the order of `PLACED` and so on, shape (2, 24)
    sums: FloatArray
    carrying: IntArray  # outermost needles that carried a step ago, shape (3, 2)
    past: FloatArray  # skews of all needles one and two revolutions ago, shape (blocks, 2, 24)

    @classmethod
    def for_blocks(cls, blocks: int) -> NeedleRing:
        """Memory for `blocks` blocks of eight needles that carry."""
        state, past = np.zeros((blocks, ROWS, 3 * WIDTH)), np.zeros((blocks, 2, 3 * WIDTH))
        roller, sums = np.zeros((2, 2, 3 * WIDTH))
        return cls(state, roller, np.zeros((1, 3)), sums, np.zeros((3, 2), np.int64), past)


TILTED, YAWED = range(2)
"""Rows of `NeedleRing.roller`."""
PLACED, SKEWED = range(2)
"""Sums of places and skews times loads, in the first row of `NeedleRing.sums`."""
FORCE, MOMENT = range(2)
"""Sums of forces along the trunnion and moments about it, in its second row."""


@inlined_kernel
def _come_under_load(c, state, k, slots, number, other):
    """Put a needle of trunnion k at its outer stop, along the one next to it."""
    slot, of = number % slots, other % slots
    one, lane = state[slot // WIDTH], WIDTH * k + slot % WIDTH
    one[PLACE, lane], one[SKEW, lane] = c.reach, state[of // WIDTH, SKEW, WIDTH * k + of % WIDTH]
    one[SIDE, lane] = 1.0
    for row in (DEPTH, LEAN):
        one[TRUNNION + row, lane] = one[BORE + row, lane] = 0.0  # what is left there may be of another joint
    one[TRUNNION + VARIANCE, lane] = one[BORE + VARIANCE, lane] = UNKNOWN


@kernel_part
def _admit(c, state, needles, k, carrying, first, last):
    """Start newly loaded needles in their unloaded state, along their neighbours; returns whether there are any."""
    slots, new = WIDTH * needles.blocks, first < carrying[0] or last > carrying[1]
    if new:
        for number in range(carrying[1] + 1, last + 1):
            _come_under_load(c, state, k, slots, number, number - 1)
        for number in range(carrying[0] - 1, first - 1, -1):
            _come_under_load(c, state, k, slots, number, number + 1)
    carrying[0], carrying[1] = first, last
    return new


@kernel_part
def _look(c, needles, ring, step, motion, new):
    """Follow the spread of loads along the needles where it is time to, and find it along `new` ones."""
    usual = c.drop > 0.0 or step % _REFRESHED == 0
    if not (usual or new):
        return
    for b in range(needles.blocks):
        carried, known, looks = needles.loads[b], not new, 2 if usual else 0
        while looks > 0:
            known = follow_spread(c, ring.state[b], load_three(carried, step), across(motion, OFFSET))
            looks = 0 if known else looks - 1
        if not known:
            balance_unknown(c, ring.state[b], carried[step], motion[OFFSET])


@kernel_part
def step_on(c, tilt, at, needles, ring, step, duration):
    """Move all needles that carry load on by a step; `ring` receives their sums and mean places."""
    i, n, new = step // WIDTH, step % WIDTH, False
    for k in range(3):
        new = _admit(c, ring.state, needles, k, ring.carrying[k], at.first[k, i, n], at.last[k, i, n]) or new
    motion, pace = at.motion[step], 1.0 / duration
    offset, yaw = across(motion, OFFSET), across(motion, YAW)
    lean = tilt * (offset - across(ring.placed, 0))
    tilting, yawing = pace * (lean - load_three(ring.roller, TILTED)), pace * (yaw - load_three(ring.roller, YAWED))
    store(ring.roller, TILTED, lean)
    store(ring.roller, YAWED, yaw)
    placed, force = 0.0 * yaw, 0.0 * yaw
    skewed, moment = placed, force
    for b in range(needles.blocks):
        carried = load_three(needles.loads[b], step)
        placed = placed + carried * load_three(ring.state[b], PLACE)
        skewed = skewed + carried * load_three(ring.state[b], SKEW)
    store(ring.sums, 0, row_of_sums(placed, skewed, 0.0, 0.0, 0.0, 0.0))
    for k in range(3):
        ring.placed[0, k] = ring.sums[0, WIDTH * k + PLACED] / at.carried[k, i, n]
    _look(c, needles, ring, step, motion, new)
    acting = (across(motion, SPIN), across(motion, PLUNGE), offset, c.sliding * across(motion, RUBBING))
    for b in range(needles.blocks):
        turned = load_three(needles.cosines[b], step), load_three(needles.sines[b], step)
        carried = load_three(needles.loads[b], step)
        along, about = _move(c, ring.state[b], carried, acting, (lean, yaw, tilting, yawing), turned, duration)
        force, moment = force + along, moment + about
    store(ring.sums, 1, row_of_sums(force, moment, 0.0, 0.0, 0.0, 0.0))


@kernel_part
def start_needles(c, skews, tilt, at, needles, ring):
    """Put all needles in the middle, at their initial skews."""
    motion = at.motion[0]
    store(ring.roller, TILTED, tilt * across(motion, OFFSET))
    store(ring.roller, YAWED, across(motion, YAW))
    for k in range(3):
        ring.placed[0, k] = 0.0
        ring.carrying[k, 0], ring.carrying[k, 1] = at.first[k, 0, 0], at.last[k, 0, 0]
    clear(ring.state)
    for b in range(needles.blocks):
        state = ring.state[b]
        for lane in range(3 * WIDTH):
            state[SKEW, lane] = skews[lane // WIDTH]
            state[TRUNNION + VARIANCE, lane] = state[BORE + VARIANCE, lane] = UNKNOWN
        balance_unknown(c, state, needles.loads[b, 0], motion[OFFSET])


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
        block, lane = like // WIDTH, WIDTH * k + like % WIDTH
        one.angle = turned + 2.0 * math.pi / count * (number - nearest)
        one.skew, one.place = state[block, SKEW, lane], c.reach
        one.load, one.stop, one.line = 0.0, 0.0, 0.0
        if number <= last:
            one.load, one.stop = needles.loads[block, step, lane], state[block, STOP, lane]
            one.place, one.line = state[block, PLACE, lane], _line_load(c, state, block, lane)
