"""Needles that follow their roller: skew, axial place and forces of every needle of a trunnion, without its inertia.

A roller's motion on its trunnion hardly depends on what its needles do, so they are moved along a known one: the spin
s, the plunging w and the normal force N over a revolution. Frame: t is the trunnion's axis, outward, n the normal of
the trunnion at a needle, tau = t x n. A needle skewed by psi has the axis e = cos psi t - sin psi tau. At the angle
gamma from the load it is pressed by D cos gamma - c; D follows from the balance of all needles' loads f with N. As the
roller turns, a needle rolls around the trunnion by s r_b / (2 r_p), and the trunnion of a bent joint rocks about its
own axis by w_t against the load, once a revolution and mostly the other way: d gamma / dt = s r_b / (2 r_p) + w_t. To
and fro: the same few needles carry the load.

Axial place. It rolls freely across its axis, and slips along it on trunnion and bore by v_t + v_b = w cos psi - s r_e
sin psi. In an even gap a free needle slips on both alike, and moves by w / 2 along the trunnion: half of the plunging,
which is 2 e to both sides. But a roller that tilts by b and yaws by a narrows the gap outward, by beta = b cos gamma +
a sin gamma. The normal forces push the needle to the wider side by beta f, and the orbit of the trunnion, at R_p from
the axis, throws it outward by the centrifugal force F = m_n R_p omega^2. Friction must hold both:

    mu_n (tanh(v_t / v_sn) - tanh(v_b / v_sn)) = -beta + F / f.

Friction hardly grows with slip: 2 mrad, a twentieth of mu_n, take a needle with the roller by 0.6 of its motion. So a
centrifugal force of a hundredth of the friction carries needles to their outer stops within a few revolutions. Where
one is stopped by flange or retainer it rolls on in place:

    v_t = -s r_e sin(psi) / 2,    v_b = w cos psi + v_t,
    R = mu_n f (tanh(v_b / v_sn) - tanh(v_t / v_sn)) - beta f + F,

where R is the force of the outer stop. It goes on until the roller turns back. At the stop the end of the needle rubs,
as the needle moves around the trunnion by s r_b / 2: S = mu_n R tanh(s r_b / (2 v_sn)) against that motion. Trunnion
and bore bear half of S each. A skewed needle is shorter along the trunnion, by l (1 - cos psi). By virtual power it
does to the roller, along and about the trunnion,

    -mu_n f tanh(v_b / v_sn) cos psi,    mu_n f (r_e / 2) sin psi (tanh(v_t / v_sn) + tanh(v_b / v_sn)) - S r_b / 2.

Yaw. Three moments turn a needle about n:

    wedge      (psi / r_p) (sum over the spheres of f_t x^2 - f_b x^2), x the station along the needle: a skewed needle
               touches the trunnion with its middle and the bore with its ends, and is pressed straight.
    stop       R (l / 2) sin psi: the stop pushes the end along t, not along e, as a load buckles a column.
    rubbing    +- S l / 2 at the outer and the inner stop.

Against them acts the friction of the spheres that slip across, at stations x by x psi': while a needle slips along its
axis by v, friction yields to a slip across as if it were viscous, so that

    psi' mu_n f (<x^2>_t tanh(v_t / v_sn) / v_t + <x^2>_b tanh(v_b / v_sn) / v_b) = the sum of the moments.

A needle is held in its skew where it hardly slips along its axis, and yaws per millimetre of that slip elsewhere: no
time enters, and the speed of the joint by the centrifugal force alone.

A needle without load is thrown against its outer stop, and lies along its neighbour that carries load. Left out are
forces between needles, and the needles' inertia but for the centrifugal force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.needles.needle_constants import needle_constants_of
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, inner_kernel, kernel, kernel_part
from tripod_doe.mechanics.laws.contact import contact_secant
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent, secant_slope

MOST_NEEDLES = 100
"""Of a trunnion."""
FARTHEST = 0.35
"""Place of a load along a needle over its length, at most."""

NEEDLE = np.dtype(
    [
        (name, float)
        for name in (
            "place",  # along the trunnion from the middle, mm
            "skew",  # psi, rad
            "load",  # f, N
            "known",  # whether it is known how the load is spread
            "stop",  # force of the outer stop, negative that of the inner one, N
        )
    ]
)
"""State of a needle."""
NEEDLE_CONTACT = np.dtype([(name, float) for name in ("depth", "lean", "variance")])
"""State of a needle's contact with trunnion or bore: compression in its middle and its slope, <(x - x_f)^2>."""

RECORD = np.dtype([(name, float) for name in ("load", "angle", "place", "skew", "stop", "line")])
"""State of a needle that is recorded: `NEEDLE`, its angle from the load, largest load per length on the trunnion."""

_EXPONENT = 10.0 / 9.0
_STEPS = 360
"""Steps of a revolution, at least."""
_REFRESHED = 4
"""Steps for which the loads' distribution along a needle is kept."""
_NEWTON = 60
"""Iterations of a bearing's balance, at most; two are usual."""
_MOST_SLIP = 40.0
"""Slip of a needle over its transition velocity, where it is limited for the exponential's sake."""
_HOLDS = 1e-6
"""Resistance to yaw over the largest that is possible, from which on a needle is taken to have any."""


@inlined_kernel
def _station(c, i):
    """Station of sphere i along its needle."""
    return c.length * ((i + 0.5) / c.spheres - 0.5)


@kernel_part
def _load_on_both(c, pressed):
    """Load of a straight needle pressed between trunnion and bore, and its derivative."""
    if c.drop == 0.0:
        secant = 0.5 * contact_secant(c.stiffness, _EXPONENT, 0.5 * pressed)
        return secant * pressed, _EXPONENT * secant
    load, slope = 0.0, 0.0
    for i in range(int(c.spheres)):
        station = _station(c, i)
        compressed = 0.5 * pressed - c.drop * station * station
        if compressed > 0.0:
            secant = contact_secant(c.stiffness / c.spheres, _EXPONENT, compressed)
            load += secant * compressed
            slope += 0.5 * _EXPONENT * secant
    return load, slope


@inner_kernel
def _spread(c, contact, load, centre, drop, iterations):
    """Find how a load with its centre off the middle is spread along a needle: depth, lean and variance of stations."""
    most = (c.spheres * load / c.stiffness) ** 0.9  # depth of a sphere that carries all
    for _ in range(iterations):
        total, first, second, rise, rise_1, rise_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(int(c.spheres)):
            station = _station(c, i)
            compressed = contact.depth + (contact.lean - drop * station) * station
            if compressed > 0.0:
                secant = contact_secant(c.stiffness / c.spheres, _EXPONENT, compressed)
                total += secant * compressed
                first += secant * compressed * station
                second += secant * compressed * station * station
                rise += _EXPONENT * secant
                rise_1 += _EXPONENT * secant * station
                rise_2 += _EXPONENT * secant * station * station
        if total == 0.0:
            contact.depth, contact.lean = most, 0.0
            continue
        missing, moment = load - total, load * centre - first
        determinant = rise * rise_2 - rise_1 * rise_1
        if determinant > 1e-9 * rise * rise * c.length * c.length:
            deeper = (rise_2 * missing - rise_1 * moment) / determinant
            leaning = (rise * moment - rise_1 * missing) / determinant
        else:  # one sphere alone: it does not say how the needle leans
            deeper, leaning = missing / rise, 0.0
        contact.depth += min(max(deeper, -most), most)
        contact.lean += min(max(leaning, -2.0 * most / c.length), 2.0 * most / c.length)
        contact.variance = second / total - (first / total) * (first / total)


@kernel_part
def _distribute(c, needle, contacts, offset):
    """Find how the loads of a needle are spread along it on trunnion and bore."""
    bend = 0.5 * needle.skew * needle.skew / c.pitch_radius
    centre = min(max(offset - needle.place, -FARTHEST * c.length), FARTHEST * c.length)
    iterations = 1
    if needle.known == 0.0:
        iterations, needle.known = 8, 1.0
        for contact in contacts:
            contact.depth, contact.lean = (needle.load / c.stiffness) ** 0.9, 0.0
    _spread(c, contacts[0], needle.load, centre, c.drop + bend, iterations)
    _spread(c, contacts[1], needle.load, centre, c.drop - bend, iterations)


@kernel_part
def _press(c, needles, load, turned, shift):
    """Find the loads of all needles that carry a bearing load, outward from the one that is nearest to it.

    Returns the roller's shift D across its trunnion, the number of that needle, and how many to either side carry load.
    Numbers count on around the trunnion: needle i stands at i / count of a turn, and `turned` on.
    """
    count = int(c.needles)
    spacing = 2.0 * math.pi / c.needles
    nearest = round(-turned / spacing)
    before, after = 0, 0
    for _ in range(_NEWTON):
        along, slope = 0.0, 0.0
        for direction in (1, -1):
            reached = 0
            for number in range(0 if direction == 1 else 1, count // 2 + 1 if direction == 1 else (count + 1) // 2):
                at = nearest + direction * number
                cosine = math.cos(at * spacing + turned)
                pressed = shift * cosine - c.clearance
                if not pressed > 0.0:
                    break
                carried, rise = _load_on_both(c, pressed)
                needles[at % count].load = carried
                along += carried * cosine
                slope += rise * cosine * cosine
                reached = number
            if direction == 1:
                after = reached
            else:
                before = reached
        if not along > 0.0:
            shift = 1.5 * shift + 1e-4
            continue
        change = (load - along) / slope
        if abs(change) <= 1e-6 * shift:
            break
        shift = max(shift + change, 0.5 * shift)
    return shift, nearest, before, after


@kernel_part
def _free_slip(c, total, slope):
    """Slip of a free needle on the trunnion: it slips by `total` on both, in a gap that narrows outward by `slope`.

    tanh u - tanh v = 2 sinh(u - v) / (cosh(u + v) + cosh(u - v)), a quadratic equation for exp(u - v).
    """
    both = min(max(total / c.transition, -_MOST_SLIP), _MOST_SLIP)
    held = -min(max(slope / c.sliding, -1.0), 1.0)
    spread = 0.5 * held * math.cosh(both)
    root = math.sqrt(spread * spread + 1.0 - 0.25 * held * held)
    return 0.5 * (total + c.transition * math.log((spread + root) / (1.0 - 0.5 * held)))


@inlined_kernel
def _thrown(c, needle):
    """Centrifugal force of a needle over its load, as far as its friction on trunnion and bore can hold it."""
    most = 2.0 * c.sliding
    return c.thrown / needle.load if c.thrown < most * needle.load else most


@kernel_part
def _move(c, needle, contacts, spin, plunge, offset, narrowing, duration):
    """Move a needle on by a step; its force along the trunnion on the roller, and its moment about it.

    `narrowing` is the slope by which the gap narrows outward; what throws the needle outward counts as a widening one.
    """
    slope = narrowing - _thrown(c, needle)
    sine, cosine = math.sin(needle.skew), math.cos(needle.skew)
    turning, around = 0.5 * c.lever * spin * sine, 0.5 * c.bore_radius * spin
    total = plunge * cosine - 2.0 * turning
    free = _free_slip(c, total, slope)
    wanted = needle.place + (free + turning) / cosine * duration
    reach = c.reach + 0.5 * c.length * (1.0 - cosine)
    needle.place = min(max(wanted, -reach), reach)
    stopped = needle.place != wanted
    side = 1.0 if wanted > 0.0 else -1.0
    on_trunnion = -turning if stopped else free
    on_bore = total - on_trunnion
    drag_t = c.sliding * hyperbolic_tangent(on_trunnion / c.transition)
    drag_b = c.sliding * hyperbolic_tangent(on_bore / c.transition)
    stop = max(side * (drag_b - drag_t - slope), 0.0) if stopped else 0.0
    needle.stop = side * stop * needle.load
    rubbing = c.sliding * stop * hyperbolic_tangent(around / c.transition)
    wedge = (contacts[0].variance - contacts[1].variance) / c.pitch_radius
    held = contacts[0].variance * secant_slope(abs(on_trunnion), c.transition)
    held = c.sliding * (held + contacts[1].variance * secant_slope(abs(on_bore), c.transition))
    lever = 0.5 * c.length - side * min(max(offset - needle.place, -FARTHEST * c.length), FARTHEST * c.length)
    moments = wedge * needle.skew + lever * (stop * sine + side * rubbing)
    # the wedge grows with the cube of the skew: implicit in it, so that it never overshoots
    stiffening = 3.0 * max(-wedge, 0.0)
    if held > _HOLDS * c.sliding * c.length * c.length / c.transition:  # one sphere alone says nothing of the skew
        needle.skew += duration * moments / (held + duration * stiffening)
    force = -drag_b * cosine
    moment = 0.5 * c.lever * sine * (drag_t + drag_b) - 0.5 * c.bore_radius * rubbing
    return needle.load * force, needle.load * moment


@kernel_part
def _admit(c, needles, nearest, before, after):
    """Let needles that come under load be as they were without: at the outer stop, along the one next to them."""
    count = int(c.needles)
    for direction, reached in ((1, after), (-1, before)):
        for number in range(1, reached + 1):
            needle = needles[(nearest + direction * number) % count]
            if needle.known == 0.0:
                needle.skew, needle.place = needles[(nearest + direction * (number - 1)) % count].skew, c.reach
    for number in range(after + 1, count - before):
        needles[(nearest + number) % count].known = 0.0


@inlined_kernel
def _between(values, j, share):
    """Value between sample j and the next, around the revolution."""
    after = j + 1 if j + 1 < values.size else 0
    return values[j] + share * (values[after] - values[j])


@kernel_part
def _step(c, needles, contacts, motion, gap, duration, refresh, zone):
    """Move all needles that carry load on by a step: force and moment on the roller, mean skew and place.

    `motion` is spin, plunging of the bore at the load, and place of the load; `gap` the roller's tilt and yaw and their
    rates; `zone` how far needles have moved around, the nearest needle, and how many to either side carry load.
    Also returns the skew of the needle that carries the most.
    """
    spin, plunge, offset = motion
    tilt, yaw, tilting, yawing = gap
    turned, nearest, before, after = zone
    force, moment, leaning, placed, carried, most = 0.0, 0.0, 0.0, 0.0, 0.0, nearest % int(c.needles)
    for at in range(nearest - before, nearest + after + 1):
        slot = at % int(c.needles)
        needle = needles[slot]
        if needle.load > needles[most].load:
            most = slot
        leaning, placed = leaning + needle.load * needle.skew, placed + needle.load * needle.place
        carried += needle.load
        if refresh or needle.known == 0.0:
            _distribute(c, needle, contacts[slot], offset)
        angle = 2.0 * math.pi / c.needles * at + turned
        cosine, sine = math.cos(angle), math.sin(angle)
        bore = plunge - c.bore_radius * (tilting * (1.0 - cosine) - yawing * sine)
        along, about = _move(c, needle, contacts[slot], spin, bore, offset, tilt * cosine + yaw * sine, duration)
        force, moment = force + along, moment + about
    carried = max(carried, 1e-300)
    return force, moment, leaning / carried, placed / carried, needles[most].skew


@kernel_part
def _line_load(c, contact, bend):
    """Largest load per length along a needle's contact with its trunnion."""
    deepest = 0.0
    for i in range(int(c.spheres)):
        station = _station(c, i)
        deepest = max(deepest, contact.depth + (contact.lean - (c.drop + bend) * station) * station)
    return contact_secant(c.stiffness, _EXPONENT, deepest) * deepest / c.length


@kernel_part
def _record(c, needles, contacts, zone, records, at):
    """Record all needles; those without load lie at their outer stop."""
    turned, nearest, before, after = zone
    count, spacing = int(c.needles), 2.0 * math.pi / c.needles
    for number in range(nearest - before, nearest - before + count):
        needle, record = needles[number % count], records[number % count, at]
        record.angle, record.skew, record.place = number * spacing + turned, needle.skew, c.reach
        record.load, record.stop, record.line = 0.0, 0.0, 0.0
        if number <= nearest + after:
            record.load, record.stop, record.place = needle.load, needle.stop, needle.place
            bend = 0.5 * needle.skew * needle.skew / c.pitch_radius
            record.line = _line_load(c, contacts[number % count, 0], bend)


@dataclass(frozen=True, eq=False)
class RollerMotion(ByReference):
    """A roller over one revolution; arrays of shape (sample,)."""

    # spins, turns: of the roller on its trunnion, and of the trunnion about its axis against the load, rad/s
    spins: FloatArray
    turns: FloatArray
    plunges: FloatArray  # of the bore along the trunnion, outward, mm/s
    loads: FloatArray  # normal force, N
    offsets: FloatArray  # place of the load along the needles, from their middle, mm
    yaws: FloatArray  # which narrow the gap outward at gamma = 90 deg, rad


@dataclass(frozen=True, eq=False)
class NeedleForces(ByReference):
    """What the needles of a trunnion do, the mean of the last two revolutions; arrays of shape (sample,)."""

    # forces, moments: of their sliding friction on the roller along and about its trunnion, over N, in 1 and mm
    forces: FloatArray
    moments: FloatArray
    places: FloatArray  # where they are along the trunnion, mm


@kernel
def follow_roller(row, skew, tilt, roller, needles, contacts, found, skews, records=None):
    """Move the needles of one trunnion along a revolution of their roller, again and again.

    Parameters
    ----------
    row
        Of the table of `NeedleConstants`.
    skew
        Of all needles at the start, rad.
    tilt
        Of the roller over the distance of its load from the middle of the needles, rad/mm.
    roller
        `RollerMotion`.
    needles, contacts
        Memory for `MOST_NEEDLES` records of `NEEDLE`, and as many pairs of `NEEDLE_CONTACT`.
    found
        `NeedleForces`, which receives what the needles do.
    skews
        Receives the skew of the needle that carries the most, over all revolutions, shape (cycles sample,).
    records
        Receives a `RECORD` of every needle over the last two revolutions, shape (needle, 2 x sample), or is empty.

    Returns
    -------
    float
        Mean skew over the last two revolutions, weighted with the loads.
    """
    spins, turns, plunges = roller.spins, roller.turns, roller.plunges
    loads, offsets, yaws = roller.loads, roller.offsets, roller.yaws
    forces, moments, places = found.forces, found.moments, found.places
    c, samples = needle_constants_of(row), spins.size
    for j in range(int(c.needles)):
        needles[j].place, needles[j].skew, needles[j].known = 0.0, skew, 0.0
    for j in range(samples):
        forces[j], moments[j], places[j] = 0.0, 0.0, 0.0
    cycles, parts = int(c.cycles), -(-_STEPS // samples)
    duration = 2.0 * math.pi / c.speed / (samples * parts)
    shift, turned, weighted = max(c.clearance, 0.0) + 2.0 * (loads[0] / c.stiffness) ** 0.9, 0.0, 0.0
    tilted, yawed, place = tilt * offsets[0], yaws[0], 0.0
    for j in range(cycles * samples):
        sample = j % samples
        for part in range(parts):
            share = part / parts
            spin, load = _between(spins, sample, share), _between(loads, sample, share)
            shift, nearest, before, after = _press(c, needles, load, turned, shift)
            if j > 0 or part > 0:
                _admit(c, needles, nearest, before, after)
            offset, yaw = _between(offsets, sample, share), _between(yaws, sample, share)
            lean = tilt * (offset - place)
            gap = (lean, yaw, (lean - tilted) / duration, (yaw - yawed) / duration)
            tilted, yawed = lean, yaw
            motion = (spin, _between(plunges, sample, share), offset)
            refresh = (j * parts + part) % _REFRESHED == 0
            force, moment, mean, place, first = _step(
                c, needles, contacts, motion, gap, duration, refresh, (turned, nearest, before, after)
            )
            before_step = turned
            turned += (0.5 * c.bore_radius / c.pitch_radius * spin + _between(turns, sample, share)) * duration
            if part > 0:
                continue
            skews[j] = first
            if j >= (cycles - 2) * samples:
                if records is not None:  # noqa: SIM102 - numba leaves out what follows a test for None alone
                    if records.size > 0:
                        zone = (before_step, nearest, before, after)
                        _record(c, needles, contacts, zone, records, j - (cycles - 2) * samples)
                forces[sample] += 0.5 * force / load
                moments[sample] += 0.5 * moment / load
                places[sample] += 0.5 * place
                weighted += mean / (2 * samples)
    return weighted
