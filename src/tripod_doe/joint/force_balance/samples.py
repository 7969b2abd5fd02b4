"""One revolution of one point: the unknowns at every groove and sample, and functions that both balances share.

Samples are kept and computed eight at a time (`simd_lanes`): a record of `EIGHT_SAMPLES` for each groove and eight
samples, padded beyond the last sample with the first samples, so that padding never affects a decision.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.force_balance.added_motion import inertial_force, spider_load, upright_spin, yawed
from tripod_doe.joint.force_balance.periodic_system import LinearLap
from tripod_doe.joint.force_balance.point_constants import PointConstants, mean_load, point_constants_of
from tripod_doe.joint.force_balance.roller_forces import Skew, spider_wrench
from tripod_doe.joint.geometry.kinematics import ideal_motion
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load, pick, select, spread, store
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part

EIGHT_SAMPLES = np.dtype(
    [
        (name, float, (1, WIDTH))
        for name in (
            "cosine",
            "sine",  # of the groove's angle ahead of the trunnions
            "slip",  # along the rolling direction, mm/s
            "lean",  # force along the trunnion over N
            "root",  # a_H of the contact ellipse, mm
            "normal",  # N
            "moved",
            "far",  # whether a sweep changed slip or lean, and strongly
            "across_1",
            "across_2",
            "about_shaft",  # load of the groove on the spider over N
            "load_1",
            "load_2",
            "load_about",  # inertial load on the spider
            "past_tilt",
            "past_spin",  # part of backward differences from earlier samples
            "tilt",
            "tilt_gain",
            "spin",
            "spin_gain",  # sin a and spin, and what the unknowns' changes add
            "slip_step",
            "slip_carry",
            "lean_step",
            "lean_carry",  # wanted changes, and what earlier ones add to them
            "needle_force",
            "needle_moment",
            "needle_swing",
            "steering",  # terms from needles and yaw (`AddedMotion`)
        )
    ]
)
"""Fields of eight samples of a groove; those from `load_1` on are used by the kinetostatic model."""


@dataclass(frozen=True, eq=False)
class Memory(ByReference):
    """Memory of the kernels while they solve a point."""

    samples: int  # samples of a revolution
    eights: NDArray[np.void]  # records of `EIGHT_SAMPLES`, shape (3, eights)
    turns: FloatArray  # cosine and sine of the skew of each trunnion's needles, shape (3, 2)
    powers: FloatArray  # of the five mechanisms and the input shaft, shape (6, eights, 8)
    # state, kept: all numbers in `eights`, and room to keep them
    state: FloatArray
    kept: FloatArray
    # lap, noted, wide: of `coupled_newton`: its linear system, four notes of the unknowns, shape (4, 3, sample, 5),
    # and the row with enlarged transition velocities
    lap: LinearLap
    noted: FloatArray
    wide: FloatArray

    @classmethod
    def for_samples(cls, samples: int) -> Memory:
        """Memory for a number of samples per revolution."""
        eights = -(-samples // WIDTH)
        records = np.zeros((3, eights), EIGHT_SAMPLES)
        state = records.view(float).reshape(-1)
        return cls(
            samples,
            records,
            np.zeros((3, 2)),
            np.zeros((6, eights, WIDTH)),
            state,
            np.zeros_like(state),
            LinearLap.for_samples(samples),
            np.zeros((4, 3, samples, 5)),
            np.zeros(len(PointConstants._fields)),
        )


@inlined_kernel
def motion_at(p, cos_phi, sin_phi):
    """Ideal motion of a roller at eight samples."""
    return ideal_motion(cos_phi, sin_phi, p.cos_theta, p.sin_theta, p.pitch_radius, p.omega)


@inlined_kernel
def skew_of(turns, k):
    """Skew of the needles of trunnion k, of which `turns` holds cosine and sine, shape (3, 2)."""
    return Skew(turns[k, 0], turns[k, 1])


@kernel_part
def _steer(p, eights, samples, most):
    """Store how the roller of a groove is steered by its yaw, at most `most` rad.

    `spin` holds its spin about the normal, `steering` the direction in which yaw steers it.
    """
    yaw = 0.0
    for j in range(2 * samples):  # the first lap gives the state before the first sample
        e, i = eights[(j % samples) // WIDTH], j % samples % WIDTH
        yaw = yawed(p, yaw, most, e.spin[0, i])
        if j >= samples:
            e.steering[0, i], e.spin[0, i] = e.steering[0, i] * yaw, 0.0
    for j in range(samples, WIDTH * eights.size):
        first, e = eights[(j - samples) // WIDTH], eights[j // WIDTH]
        e.steering[0, j % WIDTH], e.spin[0, j % WIDTH] = first.steering[0, (j - samples) % WIDTH], 0.0


@kernel_part
def _steer_as_first(eights, k, samples):
    """Steer the roller of groove k like the first roller a third of a revolution (k = 1) or two thirds later."""
    for j in range(WIDTH * eights.shape[1]):
        first, e = (j + k * samples // 3) % samples, eights[k, j // WIDTH]
        e.steering[0, j % WIDTH] = eights[0, first // WIDTH].steering[0, first % WIDTH]
        e.spin[0, j % WIDTH] = 0.0


@kernel
def start(row, psi, cosines, sines, memory):
    """Start a point without slip and with even loads.

    Args:
        row: Of the table of `PointConstants`.
        psi: Skews of the needles of each trunnion in rad, shape (3,).
        cosines, sines: Of the rotation angle of every groove, shape (3, eights, 8).
        memory: `Memory`.
    """
    p, eights, turns = point_constants_of(row), memory.eights, memory.turns
    for k in range(3):
        turns[k, 0], turns[k, 1] = math.cos(psi[k]), math.sin(psi[k])
    even_load = mean_load(p)
    root = spread(p.axis_factor * even_load ** (1.0 / 3.0))
    nothing, normal = spread(0.0), spread(even_load)
    cos_lag, sin_lag = math.cos(p.lag), math.sin(p.lag)
    for k in range(3):
        for b in range(eights.shape[1]):
            e = eights[k, b]
            cosine, sine = load(cosines[k], b), load(sines[k], b)
            cosine, sine = cosine * cos_lag + sine * sin_lag, sine * cos_lag - cosine * sin_lag
            store(e.cosine, 0, cosine)
            store(e.sine, 0, sine)
            store(e.slip, 0, nothing)
            store(e.lean, 0, nothing)
            store(e.root, 0, root)
            store(e.normal, 0, normal)
            m = motion_at(p, cosine, sine)
            across_1, across_2, about_shaft = spider_load(p, m, cosine, sine)
            store(e.load_1, 0, across_1)
            store(e.load_2, 0, across_2)
            store(e.load_about, 0, about_shaft)
            store(e.past_tilt, 0, nothing)
            store(e.past_spin, 0, nothing)
            store(e.tilt, 0, nothing)
            w_n, way = upright_spin(p, m)
            store(e.spin, 0, w_n if p.yaw > 0.0 else nothing)
            store(e.steering, 0, way if p.yaw > 0.0 else nothing)
            store(e.needle_force, 0, nothing)
            store(e.needle_moment, 0, nothing)
            store(e.needle_swing, 0, nothing)
        if p.yaw > 0.0 and (k == 0 or memory.samples % 3 > 0):
            _steer(p, eights[k], memory.samples, p.yaw * p.spinning_friction * p.axis_factor * even_load ** (1.0 / 3.0))
        elif p.yaw > 0.0:
            _steer_as_first(eights, k, memory.samples)


@kernel_part
def store_wrench(p, m, g, e, cos_phi, sin_phi):
    """Store the load of a groove on the spider."""
    across_1, across_2, about_shaft, _ = spider_wrench(p, m, g, cos_phi, sin_phi)
    store(e.across_1, 0, across_1)
    store(e.across_2, 0, across_2)
    store(e.about_shaft, 0, about_shaft)


@inlined_kernel
def _wrench(e):
    return load(e.across_1, 0), load(e.across_2, 0), load(e.about_shaft, 0)


@inlined_kernel
def _cross(a, b):
    """Cross product of the loads of two grooves on the spider."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel_part
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


@kernel_part
def follow_root(p, e):
    """Update a_H for the normal force by one Newton step; returns change and new value."""
    floor = 1e-3 * abs(p.torque) / p.pitch_radius
    before = load(e.root, 0)
    radius = before * (1.0 / p.axis_factor)
    root = p.axis_factor / 3.0 * (2.0 * radius + max(load(e.normal, 0), floor) / (radius * radius))
    store(e.root, 0, root)
    return abs(root - before), root


@inlined_kernel
def changed(change, limit):
    """1 if a change is larger than its limit, or NaN."""
    return select(change <= limit, 0.0, 1.0)


@inlined_kernel
def sum_of(lanes):
    """Sum of eight numbers."""
    total = pick(lanes, 0)
    for place in range(1, WIDTH):
        total += pick(lanes, place)
    return total


@inlined_kernel
def force_scale(p):
    """Limit of the force along a trunnion over the mean normal force."""
    return p.groove_friction + p.needle_friction + inertial_force(p, 1.0)[0] / mean_load(p)


@kernel
def remember(memory, before):
    """Store the contributions of tilts and spins to the backward differences of later samples.

    Before the first samples come the last ones, or with `before` = 0 a roller upright and at rest.
    """
    eights, samples = memory.eights, memory.samples
    for k in range(3):
        e, i = eights[k, (samples - 1) // WIDTH], (samples - 1) % WIDTH
        tilt_1, spin_1 = before * e.tilt[0, i], before * e.spin[0, i]
        e, i = eights[k, (samples - 2) // WIDTH], (samples - 2) % WIDTH
        tilt_2, spin_2 = before * e.tilt[0, i], before * e.spin[0, i]
        for j in range(samples):
            e, i = eights[k, j // WIDTH], j % WIDTH
            e.past_tilt[0, i], e.past_spin[0, i] = 0.5 * tilt_2 - 2.0 * tilt_1, 0.5 * spin_2 - 2.0 * spin_1
            tilt_1, tilt_2, spin_1, spin_2 = e.tilt[0, i], tilt_1, e.spin[0, i], spin_1
        for j in range(samples, WIDTH * eights.shape[1]):
            place = j - samples
            first, e, i = eights[k, place // WIDTH], eights[k, j // WIDTH], j % WIDTH
            e.past_tilt[0, i], e.past_spin[0, i] = first.past_tilt[0, place % WIDTH], first.past_spin[0, place % WIDTH]


@kernel
def repeat_first(memory):
    """Copy the first samples to the entries beyond the last sample."""
    eights, samples = memory.eights, memory.samples
    for k in range(3):
        for j in range(samples, WIDTH * eights.shape[1]):
            first, i = eights[k, (j - samples) // WIDTH], (j - samples) % WIDTH
            e, n = eights[k, j // WIDTH], j % WIDTH
            e.slip[0, n], e.lean[0, n], e.root[0, n] = first.slip[0, i], first.lean[0, i], first.root[0, i]
            e.normal[0, n], e.past_tilt[0, n] = first.normal[0, i], first.past_tilt[0, i]
            e.past_spin[0, n] = first.past_spin[0, i]
