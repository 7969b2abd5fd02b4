"""Results of a solved point: the thrust at each groove, its parts, the powers, and their balance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.force_balance.added_motion import moving_forces
from tripod_doe.joint.force_balance.point_constants import point_constants_of
from tripod_doe.joint.force_balance.roller_forces import spider_wrench, thrust_of_each
from tripod_doe.joint.force_balance.samples import Memory, motion_at, skew_of
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load, pick, spread, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part

_LEAST_LOSS = 1e-3  # of the transmitted power; reference for joints with less friction


class Solution(NamedTuple):
    """Arrays that the kernels fill, one entry per point; see `equilibrium.Equilibrium`."""

    # thrust, parts: shapes (point, 3, eights, 8) and (point, 6, eights, 8)
    thrust: FloatArray
    parts: FloatArray
    # power, residual, unexplained: shapes (point, 5), (point,) and (point,)
    power: FloatArray
    residual: FloatArray
    unexplained: FloatArray
    extremes: FloatArray  # largest and smallest normal force, shape (point, 2)
    # sweeps, settled: shape (point,)
    sweeps: IntArray
    settled: NDArray[np.bool_]

    @classmethod
    def of_nothing(cls, points: int, samples: int) -> Solution:
        """Zero thrust and power, for points without torque."""
        eights = -(-samples // WIDTH)
        return cls(
            np.zeros((points, 3, eights, WIDTH)),
            np.zeros((points, 6, eights, WIDTH)),
            np.zeros((points, 5)),
            np.zeros(points),
            np.zeros(points),
            np.zeros((points, 2)),
            np.zeros(points, np.int64),
            np.zeros(points, np.bool_),
        )


@inlined_kernel
def _largest_of(lanes):
    """Largest of eight numbers."""
    largest = pick(lanes, 0)
    for place in range(1, WIDTH):
        largest = max(largest, pick(lanes, place))
    return largest


@inlined_kernel
def _add(sums, b, k, value):
    """Sum over the grooves; k = 0 starts the sum."""
    store(sums, b, (spread(0.0) if k == 0 else load(sums, b)) + value)


@kernel_part
def _account(p, m, g, e, k, b, thrust, parts, powers):
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


@kernel_part
def _account_lanes(row, memory, thrust, parts):
    """Thrust of each groove, and at each sample its parts and the powers."""
    p = point_constants_of(row)
    for b in range(memory.eights.shape[1]):
        for k in range(3):
            e = memory.eights[k, b]
            m = motion_at(p, load(e.cosine, 0), load(e.sine, 0))
            g = moving_forces(p, m, e, skew_of(memory.turns, k), 1.0)
            _account(p, m, g, e, k, b, thrust, parts, memory.powers)


@kernel_part
def _summarise(row, memory, power, residual, unexplained, extremes):
    """Mean powers of one point, its energy residual and unexplained power (shape (1,)), extremes of normal forces."""
    p, eights, powers, samples = point_constants_of(row), memory.eights, memory.powers, memory.samples
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
        unexplained[0] = (means[5] - p.torque * p.omega - lost) / transmitted
    largest, smallest = load(eights[0, 0].normal, 0), load(eights[0, 0].normal, 0)
    for k in range(3):
        for b in range(eights.shape[1]):
            normal = load(eights[k, b].normal, 0)
            largest, smallest = max(largest, normal), min(smallest, normal)
    extremes[0], extremes[1] = _largest_of(largest), -_largest_of(-smallest)


@kernel
def _account_point(row, memory, thrust, parts, power, residual, unexplained, extremes):
    """Compute all results of a point from its balance."""
    _account_lanes(row, memory, thrust, parts)
    _summarise(row, memory, power, residual, unexplained, extremes)


@kernel
def thrust_alone(row, memory, thrust):
    """Write only the thrust of a balance at each groove, shape (3, eights, 8)."""
    p = point_constants_of(row)
    for k in range(3):
        for b in range(memory.eights.shape[1]):
            e = memory.eights[k, b]
            m = motion_at(p, load(e.cosine, 0), load(e.sine, 0))
            g = moving_forces(p, m, e, skew_of(memory.turns, k), 1.0)
            store(thrust[k], b, -load(e.normal, 0) * g.friction_z)


def account(row: FloatArray, memory: Memory, solution: Solution, i: int) -> None:
    """Write the results of point i from its balance in `memory`; `row` holds its constants."""
    _account_point(
        row,
        memory,
        solution.thrust[i],
        solution.parts[i],
        solution.power[i],
        solution.residual[i : i + 1],
        solution.unexplained[i : i + 1],
        solution.extremes[i],
    )
