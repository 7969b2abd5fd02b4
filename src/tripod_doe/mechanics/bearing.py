"""A needle bearing as one element: load zone with clearance, and the friction of needles at a prescribed skew.

Frame: t is the trunnion's axis, A the middle of the needles on it; the bore's axis h = t + g (scaled so that h t = 1)
pierces the plane across t at the station s in A + s t + o(s), with o(s) = o_0 + s g across t. At the angle gamma from
-o the trunnion and the bore press a slice of needle by

    Delta = D cos gamma - c,    D = |o|,    c the radial clearance and twice the drop of the crown,

which its two contacts share: f = C (Delta / 2)^m. The slice is smeared over the circumference with the needles' mean
spacing; its loads are the moments of the load zone J_j = (N / 2 pi) integral of f cos^j gamma, and

    bore pushed along n = -o / D by J_1 + (d / 2) D' J_2, across it by (d / 2) o'_tau (J_0 - J_2)    (Eq. 2, damping d)
    stored energy (D J_1 - c J_0) / (m + 1), the needles' loads in sum L = J_0 + (d / 2) D' J_1.

The force is that of the stored energy: it acts in the bore's axis at right angles to it, n - (n h) t, on both bodies.

Friction. A needle skewed by psi rolls freely across its axis e = cos psi t + sin psi (normal x t) and transmits
friction along it. With w the axial velocity of the bore against the trunnion at the pitch radius r_p in the middle of
the slice's load, and s the roller's spin about t, it slips on bore and trunnion alike, together by

    v = w cos psi - s r_e sin psi,    r_e = r_b r_t / r_p:

half the difference of speeds carries the needles round (planetary rolling), so virtual power finds that lever. The
needles of a slice drag by F = mu_s L tanh(v / (2 v_st)): an axial force -F cos psi on the bore where w is taken, and a
torque F r_e sin psi about t. Their rolling resistance mu_r f d_n / 2 at both contacts, whose relative angular
velocities are s r_b / d_n and s r_t / d_n, brakes the spin; by virtual power its levers add up to the pitch radius,

    T = mu_r L r_p tanh(s / s_st),

with the spin s_st at which both contacts reach their transition (each has the ratio's share of its own largest speed).

Left out: friction against the yaw of needles (tilting and yawing the roller is resisted by the slices' loads and by the
axial friction at the pitch radius); the side force F sin psi, which turns the load zone by psi mu; the friction of
needles on opposite sides of an evenly preloaded bearing against tilting.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tripod_doe.mechanics import laws
from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.pairs import add_pair
from tripod_doe.mechanics.rotations import add, cross, dot, load_attitude, load_vector, rotate, scale, subtract

__all__ = ["bearing_compression", "bearing_forces", "bearing_matrices"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


class _Fit(NamedTuple):
    """Bore against trunnion: world axes of the trunnion's frame, and in it (1, 2 across t) the offset and its rate.

    The offset at the station s is (offset_1 + s lean_1, offset_2 + s lean_2), its rate likewise.
    """

    place: tuple[float, float, float]
    first: tuple[float, float, float]
    second: tuple[float, float, float]
    axis: tuple[float, float, float]
    offset_1: float
    offset_2: float
    lean_1: float
    lean_2: float
    rate_1: float
    rate_2: float
    lean_rate_1: float
    lean_rate_2: float
    axial: float
    turn_1: float
    turn_2: float
    spin: float


class _Zone(NamedTuple):
    """Moments J_0, J_1, J_2 of a slice's load zone, and the derivatives of the first two for D."""

    total: float
    along: float
    along_twice: float
    total_slope: float
    along_slope: float


class _Slice(NamedTuple):
    """A slice that is pressed: its direction and load zone, and the motion that its friction and damping see.

    n points from the bore's axis to the trunnion's, `closing` is D', `passing` the speed of the bore's axis across n,
    `load` the needles' loads in sum, `lever` the distance of their middle from the trunnion's axis.
    """

    n_1: float
    n_2: float
    zone: _Zone
    closing: float
    passing: float
    load: float
    lever: float
    slip: float


@inlined_kernel
def _fit(bearing, positions, velocities):
    """Place the bore in the trunnion's frame, with its motion against the trunnion."""
    a, b = bearing.body_a, bearing.body_b
    attitude_a, attitude_b = load_attitude(positions[a]), load_attitude(positions[b])
    arm = rotate(attitude_a, load_vector(bearing.point_a, 0))
    axis = rotate(attitude_a, load_vector(bearing.axis_a, 0))
    first = rotate(attitude_a, load_vector(bearing.across_a, 0))
    second = cross(axis, first)
    place = add(load_vector(positions[a], 0), arm)
    between = subtract(load_vector(positions[b], 0), place)
    turn_a, turn_b = load_vector(velocities[a], 3), load_vector(velocities[b], 3)
    velocity = subtract(load_vector(velocities[b], 0), cross(turn_b, between))
    velocity = subtract(velocity, add(load_vector(velocities[a], 0), cross(turn_a, arm)))
    turn = subtract(turn_b, turn_a)
    between = add(between, rotate(attitude_b, load_vector(bearing.point_b, 0)))
    bore = rotate(attitude_b, load_vector(bearing.axis_b, 0))
    bore = scale(1.0 / dot(bore, axis), bore)
    offset = subtract(between, scale(dot(between, axis), bore))
    moving, leaning = add(velocity, cross(turn, offset)), cross(turn, bore)
    rate = subtract(moving, scale(dot(moving, axis), bore))
    lean_rate = subtract(leaning, scale(dot(leaning, axis), bore))
    return _Fit(
        place, first, second, axis, dot(offset, first), dot(offset, second), dot(bore, first), dot(bore, second),
        dot(rate, first), dot(rate, second), dot(lean_rate, first), dot(lean_rate, second),
        dot(velocity, axis), dot(turn, first), dot(turn, second), dot(turn, axis),
    )  # fmt: skip


@inlined_kernel
def _offset(bearing, fit, k):
    """Station of slice k along the needles, its clearance, and the offset of the bore's axis there."""
    share = (k + 0.5) / bearing.slices - 0.5
    station = bearing.length * share
    x, y = fit.offset_1 + station * fit.lean_1, fit.offset_2 + station * fit.lean_2
    return station, bearing.clearance + 8.0 * bearing.crown * share * share, x, y, math.sqrt(x * x + y * y)


@inlined_kernel
def _clear_zone(bearing, reach, clearance):
    """Load zone of a slice with clearance (or none) whose bore is off by D = reach > clearance.

    With sin(gamma / 2) = k x and k^2 = (D - c) / (2 D) the compression is (D - c)(1 - x^2): one power for the whole
    zone, and moments of (1 - x^2)^m (1 - 2 k^2 x^2)^j / sqrt(1 - k^2 x^2), for which Gauss and Gegenbauer's rule of the
    weight (1 - x^2)^m converges to rounding with a few points.
    """
    depth = reach - clearance
    part = 0.5 * depth / reach
    j_0, j_1, j_2, slope_0, slope_1 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(bearing.node.size):
        bend = part * bearing.node[i]
        inverse = 1.0 / (1.0 - bend)
        weight = bearing.weight[i] * math.sqrt(inverse)
        cosine = 1.0 - 2.0 * bend
        change = 0.5 * bearing.node[i] * inverse
        j_0 += weight
        j_1 += weight * cosine
        j_2 += weight * cosine * cosine
        slope_0 += weight * change
        slope_1 += weight * (cosine * change - 2.0 * bearing.node[i])
    factor = 4.0 * math.sqrt(part) * laws.contact_force(bearing.density, bearing.exponent, 0.5 * depth)
    growth = bearing.exponent / depth + 0.5 * clearance / (reach * depth)
    widening = 0.5 * clearance / (reach * reach)
    return _Zone(
        factor * j_0,
        factor * j_1,
        factor * j_2,
        factor * (growth * j_0 + widening * slope_0),
        factor * (growth * j_1 + widening * slope_1),
    )


@kernel
def _preloaded_zone(bearing, reach, clearance):
    """Load zone of a slice with preload, beyond a right angle to both sides, by Gauss's rule in gamma."""
    half_zone = math.acos(max(clearance / reach, -1.0)) if reach > 0.0 else math.pi
    j_0, j_1, j_2, slope_0, slope_1 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(_NODES.size):
        cosine = math.cos(0.5 * half_zone * (1.0 + _NODES[i]))
        depth = max(reach * cosine - clearance, 1e-300)
        load = half_zone * _WEIGHTS[i] * laws.contact_force(bearing.density, bearing.exponent, 0.5 * depth)
        j_0 += load
        j_1 += load * cosine
        j_2 += load * cosine * cosine
        slope_0 += bearing.exponent * load * cosine / depth
        slope_1 += bearing.exponent * load * cosine * cosine / depth
    return _Zone(j_0, j_1, j_2, slope_0, slope_1)


@inlined_kernel
def _zone(bearing, reach, clearance):
    """Load zone of a slice, whose D must be larger than its clearance."""
    if clearance >= 0.0:
        return _clear_zone(bearing, reach, clearance)
    return _preloaded_zone(bearing, reach, clearance)


@inlined_kernel
def _press(bearing, fit, station, clearance, x, y, reach):
    """Load a slice whose D is larger than its clearance."""
    n_1, n_2 = (-x / reach, -y / reach) if reach > 0.0 else (1.0, 0.0)
    zone = _zone(bearing, reach, clearance)
    rate_1, rate_2 = fit.rate_1 + station * fit.lean_rate_1, fit.rate_2 + station * fit.lean_rate_2
    closing = -n_1 * rate_1 - n_2 * rate_2
    pitch = 0.5 * (bearing.trunnion_radius + bearing.bore_radius)
    lever = pitch * zone.along / max(zone.total, 1e-300)
    axial = fit.axial + lever * (fit.turn_1 * n_2 - fit.turn_2 * n_1)
    return _Slice(
        n_1, n_2, zone, closing, n_1 * rate_2 - n_2 * rate_1,
        max(zone.total + 0.5 * bearing.damping * closing * zone.along, 0.0),
        lever, bearing.cosine * axial - bearing.skew_lever * fit.spin,
    )  # fmt: skip


@kernel
def bearing_forces(bearings, positions, velocities, force, ledger):
    """Add the forces and moments of all needle bearings, and their energies.

    Parameters
    ----------
    bearings
        Table of bearings.
    positions, velocities
        Shapes (body, 7) and (body, 6).
    force
        Receives forces and moments about the centres of mass, shape (body, 6).
    ledger
        Receives stored energy and lost powers (`tables.LEDGER`).
    """
    for i in range(bearings.size):
        bearing = bearings[i]
        fit = _fit(bearing, positions, velocities)
        push_1, push_2, axial, carried = 0.0, 0.0, 0.0, 0.0
        moment_1, moment_2, torque = 0.0, 0.0, 0.0
        for k in range(bearing.slices):
            station, clearance, x, y, reach = _offset(bearing, fit, k)
            if not reach > clearance:
                continue
            s = _press(bearing, fit, station, clearance, x, y, reach)
            damped = 0.5 * bearing.damping * s.closing * s.zone.along_twice
            held = 0.5 * bearing.damping * s.passing * (s.zone.total - s.zone.along_twice)
            ledger[0] += (reach * s.zone.along - clearance * s.zone.total) / (bearing.exponent + 1.0)
            ledger[5] += damped * s.closing + held * s.passing
            load_1 = (s.zone.along + damped) * s.n_1 + held * s.n_2
            load_2 = (s.zone.along + damped) * s.n_2 - held * s.n_1
            along_axis = load_1 * fit.lean_1 + load_2 * fit.lean_2
            push_1, push_2, carried = push_1 + load_1, push_2 + load_2, carried + s.load
            drag = bearing.sliding * s.load * laws.hyperbolic_tangent(0.5 * s.slip / bearing.sliding_transition)
            ledger[2] += drag * s.slip
            axial -= along_axis + bearing.cosine * drag
            # the load acts in the bore's axis: of its moment about the trunnion only that of the damping is left
            moment_1 -= station * load_2 + y * along_axis + bearing.cosine * drag * s.lever * s.n_2
            moment_2 += station * load_1 + x * along_axis + bearing.cosine * drag * s.lever * s.n_1
            torque += reach * held + bearing.skew_lever * drag
        if carried > 0.0:
            brake = _brake(bearing, fit, carried)
            ledger[4] += brake * fit.spin
            pull = _in_world(fit, push_1, push_2, axial)
            moment = _in_world(fit, moment_1, moment_2, torque - brake)
            _apply(force, positions, bearing.body_b, fit.place, pull, moment, 1.0)
            _apply(force, positions, bearing.body_a, fit.place, pull, moment, -1.0)


@inlined_kernel
def _brake(bearing, fit, carried):
    """Torque of the needles' rolling resistance about the trunnion, against the spin."""
    pitch = 0.5 * (bearing.trunnion_radius + bearing.bore_radius)
    return bearing.rolling * carried * pitch * laws.hyperbolic_tangent(fit.spin / bearing.rolling_transition)


@inlined_kernel
def _in_world(fit, first, second, third):
    """Vector of the trunnion's frame in world axes."""
    return add(add(scale(first, fit.first), scale(second, fit.second)), scale(third, fit.axis))


@inlined_kernel
def _apply(force, positions, body, place, pull, moment, sign):
    """Add a force at a place, and a moment, to a body."""
    turned = add(moment, cross(subtract(place, load_vector(positions[body], 0)), pull))
    for d in range(3):
        force[body, d] += sign * pull[d]
        force[body, 3 + d] += sign * turned[d]


@kernel
def bearing_compression(bearings, positions, velocities):
    """Deepest compression of a contact of all bearings in some states, and the largest share of its needle's radius.

    Parameters
    ----------
    positions, velocities
        Shapes (state, body, 7) and (state, body, 6).

    Returns
    -------
    tuple
        The deepest compression; the largest share, its compression, the body of its bore, and the state; zeros where
        nothing touches.
    """
    deepest, worst, depth_there, body, state = 0.0, 0.0, 0.0, 0, 0
    for n in range(positions.shape[0]):
        for i in range(bearings.size):
            bearing = bearings[i]
            fit = _fit(bearing, positions[n], velocities[n])
            for k in range(bearing.slices):
                _, clearance, _, _, reach = _offset(bearing, fit, k)
                depth = 0.5 * (reach - clearance)
                deepest = max(deepest, depth)
                if depth > worst * 0.5 * bearing.diameter:
                    worst, depth_there, body, state = depth / (0.5 * bearing.diameter), depth, bearing.body_b, n
    return deepest, worst, depth_there, body, state


@inlined_kernel
def _slope(secant, chord, magnitude, transition):
    """Slope of a friction law: the tangent, but not below a share of the secant (its chord)."""
    return chord if secant == 1.0 else max(laws.tangent_slope(magnitude, transition), secant * chord)


@inlined_kernel
def _add_stations(block, across, along, n_1, n_2, station):
    """Add a slice at its station, resisting motion of the bore's axis along n and across it, upper half."""
    rise = along - across
    xx, xy, yy = across + rise * n_1 * n_1, rise * n_1 * n_2, across + rise * n_2 * n_2
    block[0, 0] += xx
    block[0, 1] += xy
    block[1, 1] += yy
    block[0, 3] -= station * xy
    block[0, 4] += station * xx
    block[1, 3] -= station * yy
    block[1, 4] += station * xy
    block[3, 3] += station * station * yy
    block[3, 4] -= station * station * xy
    block[4, 4] += station * station * xx


@inlined_kernel
def _add_drag(block, slope, cosine, arm_1, arm_2, twist):
    """Add slope times z z^T, upper half: z is the slip for each component of the motion."""
    z_3, z_4 = cosine * arm_2, -cosine * arm_1
    block[2, 2] += slope * cosine * cosine
    block[2, 3] += slope * cosine * z_3
    block[2, 4] += slope * cosine * z_4
    block[2, 5] -= slope * cosine * twist
    block[3, 3] += slope * z_3 * z_3
    block[3, 4] += slope * z_3 * z_4
    block[3, 5] -= slope * z_3 * twist
    block[4, 4] += slope * z_4 * z_4
    block[4, 5] -= slope * z_4 * twist
    block[5, 5] += slope * twist * twist


@inlined_kernel
def _mirror(block):
    """Fill the lower half of a symmetric block."""
    for i in range(6):
        for j in range(i):
            block[i, j] = block[j, i]


@inlined_kernel
def _turn_to_world(fit, block):
    """Turn a 6 x 6 block from the trunnion's frame to world axes, in place."""
    for i in range(6):
        for half in range(2):
            v = _in_world(fit, block[i, 3 * half], block[i, 3 * half + 1], block[i, 3 * half + 2])
            block[i, 3 * half], block[i, 3 * half + 1], block[i, 3 * half + 2] = v
    for j in range(6):
        for half in range(2):
            v = _in_world(fit, block[3 * half, j], block[3 * half + 1, j], block[3 * half + 2, j])
            block[3 * half, j], block[3 * half + 1, j], block[3 * half + 2, j] = v


@kernel
def _linearise(bearing, fit, secant, damping, stiffness):
    """Fill the derivatives of the force on the bore by its motion against the trunnion, about A + o_0, in its frame.

    Taken in the bore's axis, a spinning roller does not move against its trunnion.

    Returns
    -------
    bool
        Whether anything touches.
    """
    for i in range(6):
        for j in range(8):  # the last two columns only fill the lanes
            damping[i, j], stiffness[i, j] = 0.0, 0.0
    carried, drags, spread_1, spread_2, tilt_1, tilt_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(bearing.slices):
        station, clearance, x, y, reach = _offset(bearing, fit, k)
        if not reach > clearance:
            continue
        s = _press(bearing, fit, station, clearance, x, y, reach)
        turning = s.zone.along / reach if reach > 0.0 else s.zone.along_slope
        _add_stations(stiffness, turning, s.zone.along_slope, s.n_1, s.n_2, station)
        held = 0.5 * bearing.damping * (s.zone.total - s.zone.along_twice)
        _add_stations(damping, held, 0.5 * bearing.damping * s.zone.along_twice, s.n_1, s.n_2, station)
        spread_1, spread_2 = spread_1 - s.zone.total_slope * s.n_1, spread_2 - s.zone.total_slope * s.n_2
        tilt_1, tilt_2 = tilt_1 - station * s.zone.total_slope * s.n_1, tilt_2 - station * s.zone.total_slope * s.n_2
        chord = laws.secant_slope(abs(s.slip), 2.0 * bearing.sliding_transition)
        slope = bearing.sliding * s.load * _slope(secant, chord, abs(s.slip), 2.0 * bearing.sliding_transition)
        arm_1, arm_2 = s.lever * s.n_1 - fit.offset_1, s.lever * s.n_2 - fit.offset_2
        _add_drag(damping, slope, bearing.cosine, arm_1, arm_2, bearing.skew_lever)
        carried, drags = carried + s.load, drags + bearing.sliding * s.load * chord * s.slip
    _mirror(damping)
    _mirror(stiffness)
    if not carried > 0.0:
        return False
    pitch = 0.5 * (bearing.trunnion_radius + bearing.bore_radius)
    chord = laws.secant_slope(abs(fit.spin), bearing.rolling_transition)
    slope = _slope(secant, chord, abs(fit.spin), bearing.rolling_transition)
    damping[5, 5] += bearing.rolling * carried * pitch * slope
    # a change of the loads changes the friction: the mean of the slices' drags is exact but for tilting speeds
    share = drags / carried
    axial = bearing.cosine * share
    torque = _brake(bearing, fit, 1.0) - bearing.skew_lever * share
    for row, factor in ((2, axial), (5, torque)):
        stiffness[row, 0] += factor * spread_1
        stiffness[row, 1] += factor * spread_2
        stiffness[row, 3] -= factor * tilt_2
        stiffness[row, 4] += factor * tilt_1
    for j in range(6):
        stiffness[3, j] -= axial * pitch * stiffness[1, j]
        stiffness[4, j] += axial * pitch * stiffness[0, j]
    return True


@kernel
def bearing_matrices(tables, work, positions, velocities, slopes, matrix):
    """Add the derivatives of all needle bearings to the block matrix.

    Parameters
    ----------
    tables, work
        The scene, and the memory of its run, of which `work.drift` receives K times the velocities.
    positions, velocities
        Shapes (body, 7) and (body, 6).
    slopes
        Which derivatives are wanted (`tables.Slopes`).
    matrix
        Receives by_velocity D + by_position K, shape (block, 6, 8).

    Notes
    -----
    The load zone's turning is in. Left out: the turning of all forces with the trunnion, the bore's lean, what damping
    adds to the stiffness and to the friction, and how the load spreads around the trunnion.
    """
    block, stiffness, drift = work.pair[0], work.pair[1], work.drift
    for n in range(tables.bearings.size):
        bearing = tables.bearings[n]
        fit = _fit(bearing, positions, velocities)
        if _linearise(bearing, fit, slopes.secant, block, stiffness):
            place = add(fit.place, _in_world(fit, fit.offset_1, fit.offset_2, 0.0))
            pull, moment = _falling(fit, stiffness)
            _apply(drift, positions, bearing.body_b, place, pull, moment, 1.0)
            _apply(drift, positions, bearing.body_a, place, pull, moment, -1.0)
            for i in range(6):
                for j in range(6):
                    block[i, j] = slopes.by_velocity * block[i, j] + slopes.by_position * stiffness[i, j]
            _turn_to_world(fit, block)
            arm_a = subtract(place, load_vector(positions[bearing.body_a], 0))
            arm_b = subtract(place, load_vector(positions[bearing.body_b], 0))
            add_pair(matrix, bearing.pair, block, arm_a, arm_b)


@inlined_kernel
def _falling(fit, stiffness):
    """Stiffness times the motion of the bore against the trunnion: force and moment in world axes."""
    moving = (fit.rate_1, fit.rate_2, fit.axial, fit.turn_1, fit.turn_2, fit.spin)
    rate_1, rate_2, rate_3, rate_4, rate_5, rate_6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(6):
        rate_1 += stiffness[0, j] * moving[j]
        rate_2 += stiffness[1, j] * moving[j]
        rate_3 += stiffness[2, j] * moving[j]
        rate_4 += stiffness[3, j] * moving[j]
        rate_5 += stiffness[4, j] * moving[j]
        rate_6 += stiffness[5, j] * moving[j]
    return _in_world(fit, rate_1, rate_2, rate_3), _in_world(fit, rate_4, rate_5, rate_6)
