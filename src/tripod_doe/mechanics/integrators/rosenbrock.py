"""ROS34PW2, a Rosenbrock-W method of order 3 with step control (Rang and Angermann, BIT 45, 2005).

Its order holds for any approximation of the Jacobian, so the stiffness matrices may leave out geometric terms and
constraints; with the exact tangent of the contact and friction laws it is L-stable. Stages solve
(I - h g J) k_i = h f(y + sum a_ij k_j) + h J sum g_ij k_j with y the displacement from the start of the step and the
velocity; eliminating the displacement leaves M + h g D + (h g)^2 K for the velocity.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.mechanics.arithmetic.rotations import load_vector, move, tangent_rate
from tripod_doe.mechanics.arithmetic.simd_lanes import clear, load, store
from tripod_doe.mechanics.compilation.kernels import kernel, kernel_part
from tripod_doe.mechanics.forces.inertia import add_mass_product
from tripod_doe.mechanics.integrators.monitor import DIVERGED, EVALUATION_LIMIT, FINISHED, STEP_LIMIT, accept
from tripod_doe.mechanics.solve.elimination import multiply
from tripod_doe.mechanics.solve.equations_of_motion import (
    accelerate,
    copy_vectors,
    evaluate,
    larger,
    linearise,
    project,
)
from tripod_doe.mechanics.solve.newton import factorise_system, gather, solve_unconstrained
from tripod_doe.mechanics.tables import EVALUATIONS, REJECTED

_START, _FIRST_VELOCITIES, _FIRST_ACCELERATIONS, _ACCELERATIONS = range(4)
_SHIFT, _MIXED, _MIXED_SPEED, _RIGHT, _ROWS = range(4, 9)
_SHIFTS, _SPEEDS = 9, 13
"""Rows of `Work.stages`: the state at the start of a step, sums of a stage, and the increments of all four stages."""

_GAMMA = 4.3586652150845900e-01
_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0],
        [8.7173304301691801e-01, 0.0, 0.0, 0.0],
        [8.4457060015369423e-01, -1.1299064236484185e-01, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ]
)
_G = np.array(
    [
        [0.0, 0.0, 0.0, 0.0],
        [-8.7173304301691801e-01, 0.0, 0.0, 0.0],
        [-9.0338057013044082e-01, 5.4180672388095326e-02, 0.0, 0.0],
        [2.4212380706095346e-01, -1.2232505839045147e00, 5.4526025533510214e-01, 0.0],
    ]
)
_B = np.array([2.4212380706095346e-01, -1.2232505839045147e00, 1.5452602553351020e00, 4.3586652150845900e-01])
_EMBEDDED = np.array([3.7810903145819369e-01, -9.6042292212423178e-02, 5.0e-01, 2.1793326075422950e-01])


@kernel
def _set_out(tables, work, positions, velocities, time, settings):
    """Take a state as the start of a step: forces and accelerations, and the matrices D and K.

    The matrices are stored separately: a rejected step is tried again with another sum of them.
    """
    linearise(tables, work, positions, velocities, 0.0, 1.0, 0.0, work.dissipation)
    linearise(tables, work, positions, velocities, 0.0, 0.0, 1.0, work.stiffness)
    accelerate(tables, work, positions, velocities, time, settings.baumgarte)
    copy_vectors(positions, work.stages[_START])
    copy_vectors(velocities, work.stages[_FIRST_VELOCITIES])
    copy_vectors(work.acceleration, work.stages[_FIRST_ACCELERATIONS])


@kernel
def _combine_blocks(work, reach):
    for k in range(work.matrix.shape[0]):
        matrix, damping, stiffness = work.matrix[k], work.dissipation[k], work.stiffness[k]
        for d in range(6):
            store(matrix, d, reach * (load(damping, d) + reach * load(stiffness, d)))


@kernel_part
def _place_stage(tables, work, stage, positions, velocities):
    """State at which a stage is evaluated, and the sums over the stages before it that its Jacobian multiplies."""
    start, first, shift = work.stages[_START], work.stages[_FIRST_VELOCITIES], work.stages[_SHIFT]
    mixed, mixed_speed = work.stages[_MIXED], work.stages[_MIXED_SPEED]
    for i in range(tables.bodies.size):
        for d in range(6):
            shift[i, d], mixed[i, d], mixed_speed[i, d] = 0.0, 0.0, 0.0
            speed = first[i, d]
            for j in range(stage):
                shift[i, d] += _A[stage, j] * work.stages[_SHIFTS + j, i, d]
                speed += _A[stage, j] * work.stages[_SPEEDS + j, i, d]
                mixed[i, d] += _G[stage, j] * work.stages[_SHIFTS + j, i, d]
                mixed_speed[i, d] += _G[stage, j] * work.stages[_SPEEDS + j, i, d]
            velocities[i, d] = speed
        move(start[i], shift[i], positions[i])


@kernel
def _stage(tables, work, stage, time, step, settings, positions, velocities):
    """Compute one stage: its increments of displacement (`_SHIFTS`) and of velocity (`_SPEEDS`)."""
    shift, right, rows = work.stages[_SHIFT], work.stages[_RIGHT], work.stages[_ROWS]
    mixed, mixed_speed = work.stages[_MIXED], work.stages[_MIXED_SPEED]
    _place_stage(tables, work, stage, positions, velocities)
    if stage > 0:
        lag = step * (_A[stage, 0] + _A[stage, 1] + _A[stage, 2])
        evaluate(tables, work, positions, velocities, time + lag, settings.baumgarte)
        copy_vectors(work.acceleration, work.stages[_ACCELERATIONS])
    else:
        copy_vectors(work.stages[_FIRST_ACCELERATIONS], work.stages[_ACCELERATIONS])
    # right-hand sides: h T u + h G u for displacements, h M0 a - h (K G q + D G u) for velocities
    for i in range(tables.bodies.size):
        rate = tangent_rate(load_vector(shift[i], 3), load_vector(velocities[i], 3))
        for d in range(6):
            speed = velocities[i, d] if d < 3 else rate[d - 3]
            right[i, d] = step * (speed + mixed_speed[i, d])
    reach = step * _GAMMA
    clear(work.blocks)
    add_mass_product(tables, work.stages[_START], work.stages[_ACCELERATIONS], step, work.blocks)
    clear(rows)
    gather(tables, mixed, step, rows)
    gather(tables, right, reach, rows)
    multiply(tables.pattern, work.stiffness, rows, -1.0, work.blocks)
    clear(rows)
    gather(tables, mixed_speed, step, rows)
    multiply(tables.pattern, work.dissipation, rows, -1.0, work.blocks)
    solve_unconstrained(tables, work, work.stages[_SPEEDS + stage])
    for i in range(tables.bodies.size):
        for d in range(6):
            work.stages[_SHIFTS + stage, i, d] = right[i, d] + reach * work.stages[_SPEEDS + stage, i, d]


@kernel
def _combine(tables, work, start, first, tolerance, positions, velocities):
    """State at the end of the step, and its error relative to the tolerance."""
    worst = 0.0
    shift = work.stages[_SHIFT]
    for i in range(tables.bodies.size):
        for d in range(6):
            total, error, speed, speed_error = 0.0, 0.0, 0.0, 0.0
            for j in range(4):
                total += _B[j] * work.stages[_SHIFTS + j, i, d]
                error += (_B[j] - _EMBEDDED[j]) * work.stages[_SHIFTS + j, i, d]
                speed += _B[j] * work.stages[_SPEEDS + j, i, d]
                speed_error += (_B[j] - _EMBEDDED[j]) * work.stages[_SPEEDS + j, i, d]
            shift[i, d] = total
            velocities[i, d] = first[i, d] + speed
            scale = tables.scales[1] if d < 3 else tables.scales[2]
            length = tables.scales[0] * scale / tables.scales[1]
            size = max(abs(error) / length, abs(speed_error) / scale) / tolerance
            if not size <= worst:
                work.failure[0] = i
            worst = larger(worst, size)
        move(start[i], shift[i], positions[i])
    return worst


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance with step control, or by equal steps without; see `method_interface`. clock[1] holds the next step."""
    start, first = work.stages[_START], work.stages[_FIRST_VELOCITIES]
    begin, taken = clock[0], 0
    equal = (end - begin) / count
    if clock[1] == 0.0:
        clock[1] = 1e-4 * (end - begin)
    _set_out(tables, work, positions, velocities, begin, settings)
    while taken < count if not settings.controlled else clock[0] < end:
        step = min(clock[1], end - clock[0]) if settings.controlled else equal
        _combine_blocks(work, step * _GAMMA)
        if not factorise_system(tables, work, start):
            return DIVERGED
        for stage in range(4):
            _stage(tables, work, stage, clock[0], step, settings, positions, velocities)
        error = _combine(tables, work, start, first, settings.tolerance, positions, velocities)
        growth = min(max(0.9 * max(error, 1e-9) ** (-1.0 / 3.0), 0.2), 5.0) if math.isfinite(error) else 0.1
        if settings.controlled and not error <= 1.0:
            work.counters[REJECTED] += 1
            copy_vectors(start, positions)
            copy_vectors(first, velocities)
            clock[1] = step * growth
            work.failure[1] = clock[1]
            if clock[1] < settings.floor:
                return STEP_LIMIT
            if work.counters[EVALUATIONS] > settings.budget:
                return EVALUATION_LIMIT
            continue
        taken += 1
        whole = clock[0] + step >= end * (1.0 - 1e-15) and settings.controlled
        time = end if whole or (taken == count and not settings.controlled) else clock[0] + step
        if step >= clock[1] or growth < 1.0:  # a step cut short by `end` says nothing about the next one
            clock[1] = step * growth
        project(tables, work, positions, velocities, time, settings)
        _set_out(tables, work, positions, velocities, time, settings)
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED
