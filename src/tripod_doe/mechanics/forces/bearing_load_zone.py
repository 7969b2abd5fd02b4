"""Load zone of a needle bearing with clearance: position of a bore on its trunnion, and needle loads.

Frame: t is the trunnion's axis, A the middle of the needles on it; the bore's axis h = t + g (scaled so that h t = 1)
pierces the plane across t at the station s in A + s t + o(s), with o(s) = o_0 + s g across t. At the angle gamma from
-o the trunnion and the bore press a slice of needle by

    Delta = D cos gamma - c,    D = |o|,    c the radial clearance and twice the drop of the crown,

which its two contacts share: f = C (Delta / 2)^m. The slice is smeared over the circumference with the needles' mean
spacing; its loads are the moments of the load zone J_j = (N / 2 pi) integral of f cos^j gamma.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tripod_doe.mechanics.arithmetic.rotations import (
    add,
    cross,
    dot,
    load_attitude,
    load_vector,
    rotate,
    scale,
    subtract,
)
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.laws.contact import contact_force, damped_force, damping_slope

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
    `pressed` the force along n, `load` the needles' loads in sum, `lever` the distance of their middle from the
    trunnion's axis.
    """

    n_1: float
    n_2: float
    zone: _Zone
    closing: float
    passing: float
    pressed: float
    load: float
    lever: float
    slip: float


@inlined_kernel
def place_bore(bearing, positions, velocities):
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
        place,
        first,
        second,
        axis,
        dot(offset, first),
        dot(offset, second),
        dot(bore, first),
        dot(bore, second),
        dot(rate, first),
        dot(rate, second),
        dot(lean_rate, first),
        dot(lean_rate, second),
        dot(velocity, axis),
        dot(turn, first),
        dot(turn, second),
        dot(turn, axis),
    )


@inlined_kernel
def slice_offset(bearing, fit, k):
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
    factor = 4.0 * math.sqrt(part) * contact_force(bearing.density, bearing.exponent, 0.5 * depth)
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
        load = half_zone * _WEIGHTS[i] * contact_force(bearing.density, bearing.exponent, 0.5 * depth)
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
def slice_turning(zone, reach):
    """Stiffness of a slice across n: its load turns with the offset."""
    return zone.along / reach if reach > 0.0 else zone.along_slope


@inlined_kernel
def slice_damping(bearing, s, reach):
    """Damping coefficients of a slice along and across n."""
    factor, time, zone = 0.5 * bearing.damping, bearing.damping_time, s.zone
    limit = damping_slope(zone.along, time * zone.along_slope * s.closing)
    along = factor * zone.along_twice + time * zone.along_slope * limit
    return along, factor * (zone.total - zone.along_twice) + time * slice_turning(zone, reach)


@inlined_kernel
def press_slice(bearing, fit, station, clearance, x, y, reach):
    """Load a slice whose D is larger than its clearance."""
    n_1, n_2 = (-x / reach, -y / reach) if reach > 0.0 else (1.0, 0.0)
    zone = _zone(bearing, reach, clearance)
    rate_1, rate_2 = fit.rate_1 + station * fit.lean_rate_1, fit.rate_2 + station * fit.lean_rate_2
    closing = -n_1 * rate_1 - n_2 * rate_2
    pitch = 0.5 * (bearing.trunnion_radius + bearing.bore_radius)
    lever = pitch * zone.along / max(zone.total, 1e-300)
    factor, time = 0.5 * bearing.damping * closing, bearing.damping_time * closing
    axial = fit.axial + lever * (fit.turn_1 * n_2 - fit.turn_2 * n_1)
    return _Slice(
        n_1,
        n_2,
        zone,
        closing,
        n_1 * rate_2 - n_2 * rate_1,
        damped_force(zone.along, factor * zone.along_twice, time * zone.along_slope),
        damped_force(zone.total, factor * zone.along, time * zone.total_slope),
        lever,
        bearing.cosine * axial - bearing.skew_lever * fit.spin,
    )


@inlined_kernel
def in_world(fit, first, second, third):
    """Vector of the trunnion's frame in world axes."""
    return add(add(scale(first, fit.first), scale(second, fit.second)), scale(third, fit.axis))
