"""One revolution of one point: what is known at every groove and sample, and what both balances do with it.

Samples are kept and computed eight at a time (`lanes`): a record of `EIGHT_SAMPLES` for each groove and eight samples,
of which those beyond the last repeat the first ones, so that they never decide anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.kinematics import ideal_motion
from tripod_doe.joint.moving_roller import inertial_force
from tripod_doe.joint.roller_balance import Skew, spider_wrench, thrust_of_each
from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.lanes import WIDTH, load, pick, select, spread, store

__all__ = [
    "EIGHT_SAMPLES", "Memory", "Solution", "account", "balance_spider", "changed", "follow_root", "force_scale",
    "motion_at", "skew_of", "start", "store_wrench", "sum_of", "summarise",
]  # fmt: skip

FloatArray = NDArray[np.float64]

EIGHT_SAMPLES = np.dtype([
    (name, float, (1, WIDTH))
    for name in (
        "cosine", "sine",                                 # of the groove's angle ahead of the trunnions
        "slip",                                           # along the rolling direction, mm/s
        "lean",                                           # force along the trunnion over N
        "root",                                           # a_H of the contact ellipse, mm
        "normal",                                         # N
        "moved", "far", "normal_before",                  # whether a sweep changed slip or lean, and by much; N before
        "stubborn",                                       # 1 where the last sweep changed an unknown
        "across_1", "across_2", "about_shaft",            # what the groove does to the spider over N
        "load_1", "load_2", "load_about",                 # what inertia does to the spider
        "past_tilt", "past_spin",                         # earlier samples' part of backward differences
        "tilt", "tilt_gain", "spin", "spin_gain",         # sin a and spin, and what the unknowns' changes add
        "slip_step", "slip_carry", "lean_step", "lean_carry",  # wanted changes, and what earlier ones add to them
    )
])  # fmt: skip
"""Fields of eight samples of a groove; those from `load_1` on are used by the kinetostatic model."""

_LEAST_LOSS = 1e-3  # of the transmitted power; a joint with less friction is measured against that


class Solution(NamedTuple):
    """Arrays that the kernels fill, one entry a point; see `equilibrium.Equilibrium`.

    Attributes
    ----------
    thrust, parts
        Shapes (point, 3, eights, 8) and (point, 6, eights, 8).
    power, residual
        Shapes (point, 5) and (point,).
    extremes
        Largest and smallest normal force, shape (point, 2).
    sweeps, settled
        Shape (point,).
    """

    thrust: FloatArray
    parts: FloatArray
    power: FloatArray
    residual: FloatArray
    extremes: FloatArray
    sweeps: NDArray[np.int64]
    settled: NDArray[np.bool_]

    @classmethod
    def of_nothing(cls, points: int, samples: int) -> Solution:
        """No thrust, no power: what points without a torque have."""
        eights = -(-samples // WIDTH)
        return cls(
            np.zeros((points, 3, eights, WIDTH)), np.zeros((points, 6, eights, WIDTH)), np.zeros((points, 5)),
            np.zeros(points), np.zeros((points, 2)), np.zeros(points, np.int64), np.zeros(points, np.bool_),
        )  # fmt: skip


class Memory(NamedTuple):
    """What the kernels write while they solve a point.

    Attributes
    ----------
    eights
        Records of `EIGHT_SAMPLES`, shape (3, eights).
    packed, places
        Samples that are solved together though they do not follow each other: a record, shape (1,), and which they
        are, shape (8,).
    turns
        Cosine and sine of the skew of each trunnion's needles, shape (3, 2).
    powers
        Of the five mechanisms and the input shaft, shape (6, eights, 8).
    """

    eights: NDArray[np.void]
    packed: NDArray[np.void]
    places: NDArray[np.int64]
    turns: FloatArray
    powers: FloatArray

    @classmethod
    def for_samples(cls, samples: int) -> Memory:
        """Memory for so many samples a revolution."""
        eights = -(-samples // WIDTH)
        return cls(
            np.zeros((3, eights), EIGHT_SAMPLES), np.zeros(1, EIGHT_SAMPLES), np.zeros(WIDTH, np.int64),
            np.zeros((3, 2)), np.zeros((6, eights, WIDTH)),
        )  # fmt: skip


@inlined_kernel
def motion_at(p, cos_phi, sin_phi):
    """Ideal motion of a roller at eight samples."""
    return ideal_motion(cos_phi, sin_phi, p.cos_theta, p.sin_theta, p.pitch_radius, p.omega)


@inlined_kernel
def skew_of(turns, k):
    """Skew of the needles of trunnion k, of which `turns` holds cosine and sine, shape (3, 2)."""
    return Skew(turns[k, 0], turns[k, 1])


@kernel
def start(p, eights, turns, psi, cosines, sines):
    """Start a point without slip and with even loads; cosines and sines of shape (3, eights, 8)."""
    for k in range(3):
        turns[k, 0], turns[k, 1] = math.cos(psi[k]), math.sin(psi[k])
    mean_load = abs(p.torque) / (3.0 * p.pitch_radius)
    root = spread(p.axis_factor * mean_load ** (1.0 / 3.0))
    nothing, normal = spread(0.0), spread(mean_load)
    cos_lag, sin_lag = math.cos(p.lag), math.sin(p.lag)
    for k in range(3):
        for b in range(eights.shape[1]):
            e = eights[k, b]
            cosine, sine = load(cosines[k], b), load(sines[k], b)
            store(e.cosine, 0, cosine * cos_lag + sine * sin_lag)
            store(e.sine, 0, sine * cos_lag - cosine * sin_lag)
            store(e.slip, 0, nothing)
            store(e.lean, 0, nothing)
            store(e.root, 0, root)
            store(e.normal, 0, normal)
            store(e.stubborn, 0, nothing)
            store(e.load_1, 0, nothing)
            store(e.load_2, 0, nothing)
            store(e.load_about, 0, nothing)
            store(e.past_tilt, 0, nothing)
            store(e.past_spin, 0, nothing)


@inlined_kernel
def store_wrench(p, m, g, e, cos_phi, sin_phi):
    """Note what a groove does to the spider."""
    across_1, across_2, about_shaft, _ = spider_wrench(p, m, g, cos_phi, sin_phi)
    store(e.across_1, 0, across_1)
    store(e.across_2, 0, across_2)
    store(e.about_shaft, 0, about_shaft)


@inlined_kernel
def _wrench(e):
    return load(e.across_1, 0), load(e.across_2, 0), load(e.about_shaft, 0)


@inlined_kernel
def _cross(a, b):
    """Cross product of what two grooves do to the spider."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined_kernel
def balance_spider(p, first, second, third):
    """Normal forces of eight samples from the spider's balance: w N = b, by cross products of the columns of w."""
    w_0, w_1, w_2 = _wrench(first), _wrench(second), _wrench(third)
    b_0 = -(load(first.load_1, 0) + load(second.load_1, 0) + load(third.load_1, 0))
    b_1 = -(load(first.load_2, 0) + load(second.load_2, 0) + load(third.load_2, 0))
    b_2 = p.torque - (load(first.load_about, 0) + load(second.load_about, 0) + load(third.load_about, 0))
    x, y, z = _cross(w_1, w_2), _cross(w_2, w_0), _cross(w_0, w_1)
    factor = 1.0 / (x[0] * w_0[0] + x[1] * w_0[1] + x[2] * w_0[2])
    store(first.normal, 0, (b_0 * x[0] + b_1 * x[1] + b_2 * x[2]) * factor)
    store(second.normal, 0, (b_0 * y[0] + b_1 * y[1] + b_2 * y[2]) * factor)
    store(third.normal, 0, (b_0 * z[0] + b_1 * z[1] + b_2 * z[2]) * factor)


@inlined_kernel
def follow_root(p, e):
    """Take the contact ellipse along with its normal force, one Newton step; change and new value of a_H."""
    floor = 1e-3 * abs(p.torque) / p.pitch_radius
    before = load(e.root, 0)
    radius = before / p.axis_factor
    root = p.axis_factor / 3.0 * (2.0 * radius + max(load(e.normal, 0), floor) / (radius * radius))
    store(e.root, 0, root)
    return abs(root - before), root


@inlined_kernel
def changed(change, limit):
    """1 where a change is larger than its limit, or no number."""
    return select(change <= limit, 0.0, 1.0)


@inlined_kernel
def sum_of(lanes):
    """Sum of eight numbers."""
    total = pick(lanes, 0)
    for place in range(1, WIDTH):
        total += pick(lanes, place)
    return total


@inlined_kernel
def _largest_of(lanes):
    """Largest of eight numbers."""
    largest = pick(lanes, 0)
    for place in range(1, WIDTH):
        largest = max(largest, pick(lanes, place))
    return largest


@inlined_kernel
def force_scale(p):
    """How large the force along a trunnion may be, over the mean normal force."""
    return p.groove_sliding + p.needle_sliding + 3.0 * p.pitch_radius * inertial_force(p, 1.0)[0] / abs(p.torque)


@inlined_kernel
def _add(sums, b, k, value):
    """Sum over the grooves, of which k = 0 is the first."""
    store(sums, b, (spread(0.0) if k == 0 else load(sums, b)) + value)


@inlined_kernel
def account(p, m, g, e, k, b, thrust, parts, powers):
    """Thrust of groove k at eight samples, and the parts of the thrust and the six powers (mechanisms, input shaft)."""
    normal, cos_phi, sin_phi = load(e.normal, 0), load(e.cosine, 0), load(e.sine, 0)
    store(thrust[k], b, -normal * g.friction_z)
    of_each = thrust_of_each(p, m, g)
    _add(parts[0], b, k, normal * of_each[0])
    _add(parts[1], b, k, normal * of_each[1])
    _add(parts[2], b, k, normal * of_each[2])
    _add(parts[3], b, k, normal * of_each[3])
    _add(parts[4], b, k, normal * of_each[4])
    _add(parts[5], b, k, normal * of_each[5])
    _add(powers[0], b, k, normal * g.sliding_power)
    _add(powers[1], b, k, normal * g.spinning_power)
    _add(powers[2], b, k, normal * g.rolling_power)
    _add(powers[3], b, k, normal * g.needle_sliding_power)
    _add(powers[4], b, k, normal * g.needle_rolling_power)
    _add(powers[5], b, k, normal * spider_wrench(p, m, g, cos_phi, sin_phi)[3] * p.omega)


@kernel
def summarise(p, eights, powers, samples, power, residual, extremes):
    """Mean powers of one point, its energy residual (shape (1,)), and the extremes of its normal forces."""
    means = powers[:, 0, 0]
    for mechanism in range(6):
        total = 0.0
        for j in range(samples):
            total += powers[mechanism, j // WIDTH, j % WIDTH]
        means[mechanism] = total / samples
    lost = 0.0
    for mechanism in range(5):
        power[mechanism] = means[mechanism]
        lost += means[mechanism]
    transmitted = abs(p.torque * p.omega)
    if transmitted > 0.0:
        residual[0] = (means[5] - p.torque * p.omega - lost) / max(lost, _LEAST_LOSS * transmitted)
    largest, smallest = load(eights[0, 0].normal, 0), load(eights[0, 0].normal, 0)
    for k in range(3):
        for b in range(eights.shape[1]):
            normal = load(eights[k, b].normal, 0)
            largest, smallest = max(largest, normal), min(smallest, normal)
    extremes[0], extremes[1] = _largest_of(largest), -_largest_of(-smallest)
