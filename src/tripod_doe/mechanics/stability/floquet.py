"""Stability of a motion: the growth rate of its fastest growing departure (Floquet's theory).

A method that damps unresolved motion follows a smooth motion even if the exact motion is unstable: a joint with
friction may vibrate by itself. So small departures (q, v) of positions and velocities are followed along the motion;
their equation is

    q' = v + omega x q        v' = A_q q + A_v v        with A_q = da/dq, A_v = da/dv

with the cross product for rotations only, and a the accelerations of Eq. 1 with all reactions, differentiated
numerically at some states of the motion. Constraints leave as many independent coordinates as there are degrees of
freedom: q and v are the departures of these, which all others follow. Between two states the matrix is assumed
constant; its exponential propagates departures.

Source: e.g. P. Hagedorn, Non-Linear Oscillations, Clarendon Press, 1988, ch. 2. Cost: 2 evaluations a degree of
freedom and state, and an exponential of a matrix of twice that size a state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, qr

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.mechanics.arithmetic.rotations import cross, load_vector, move
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.constraints import evaluate_constraints
from tripod_doe.mechanics.solve.equations_of_motion import constraint_rate, copy_vectors, evaluate
from tripod_doe.process.one_thread import one_thread

_DIFFERENCE = 1e-6
"""Steps of the differences over the scales of the scene: between curvature and rounding (inverse)."""


_LARGEST_LOG = 709.0  # of a number that can be represented

_REDUNDANT = 1e-10
"""Size of what is left of a constraint equation by others, over the largest one, below which it is redundant."""

_AT, _SPEEDS, _BEFORE = range(3)
"""Rows of `Work.stages`: the state that is evaluated, and the accelerations before a difference."""


@dataclass(frozen=True)
class Growth:
    """The fastest growing departure from a motion."""

    # least growth over the tested motion, up to 8e307; magnitude of a Floquet multiplier if the motion is a period
    factor: float
    rate: float  # the same as a rate, 1/time: negative if all departures decay
    frequency: float  # angular frequency of the departure at its fastest growth; zero if none oscillates
    # logarithm of the growth in the parts of the motion with growing oscillations; larger than log(factor) if
    # departures decay in other parts
    climb: float = 0.0


def departure_matrices(assembly: Assembly, states: Sequence[State]) -> FloatArray:
    """The matrices of the equation of departures, shape (state, 2 x dof, 2 x dof).

    Args:
        states: States at the middles of equal parts of the motion, in order. Coordinates that are independent at the
            first one must be so at all.
    """
    tables, scene, count = assembly.tables, assembly.scene, len(states)
    size = 6 * tables.body_of_row.size
    times = np.array([state.time for state in states])
    places, velocities = (np.array([getattr(each, name) for each in states]) for name in ("positions", "velocities"))
    jacobians, rates = np.zeros((count, tables.rows.size, size // 6, 6)), np.zeros((count, tables.rows.size))
    _constrain(tables, assembly.memory, times, places, velocities, jacobians, rates)
    turn = scene.length_scale * scene.rotation_scale / scene.speed_scale
    scales = [[scene.length_scale, turn], [scene.speed_scale, scene.rotation_scale]]
    steps = _DIFFERENCE * np.tile(np.repeat(scales, 3, axis=1), size // 6)
    free = np.flatnonzero(tables.bodies["free"][tables.body_of_row].ravel())
    slopes = jacobians.reshape(count, tables.rows.size, size)
    dependent = free[_leading(slopes[0][:, free] * steps[0, free])]
    independent = np.setdiff1d(free, dependent)
    keep = np.zeros_like(slopes)
    keep[:, :, dependent] = -np.linalg.pinv(slopes[:, :, dependent]).swapaxes(1, 2)
    motions = slopes[:, :, independent].swapaxes(1, 2) @ keep
    motions[:, np.arange(independent.size), independent] = 1.0
    changes = np.zeros((count, 3, independent.size, size // 6, 6))
    back, along = keep.reshape(jacobians.shape), motions.reshape(changes[:, 0].shape)
    steps = np.ascontiguousarray(steps[:, independent])
    _differentiate(tables, assembly.memory, times, places, velocities, steps, along, back, rates, changes)
    turned, *slopes_of = changes.reshape(count, 3, independent.size, size)[..., independent].transpose(1, 0, 3, 2)
    speeds = np.broadcast_to(np.eye(independent.size), turned.shape)
    return np.concatenate([np.concatenate([turned, speeds], axis=2), np.concatenate(slopes_of, axis=2)], axis=1)


def fastest_growth(matrices: FloatArray, duration: float) -> Growth:
    """Growth of the fastest growing departures.

    Args:
        matrices: Of equal parts of a motion (`departure_matrices`).
        duration: How long the motion takes.
    """
    with one_thread():
        return _growth(matrices.copy(), duration / len(matrices))


def oscillating_rates(matrices: FloatArray, slowest: float) -> FloatArray:
    """Largest growth rate of an oscillating departure at each state, as if the motion stayed there; shape (state,).

    Args:
        matrices: Of states of a motion (`departure_matrices`).
        slowest: Least angular frequency that counts as an oscillation.
    """
    with one_thread():
        rates = np.linalg.eigvals(matrices)
    return np.asarray(np.where(rates.imag > slowest, rates.real, -np.inf).max(axis=1))


def _growth(matrices: FloatArray, part: float) -> Growth:
    """Growth of departures through parts of a motion of equal duration with these matrices, which are overwritten."""
    half = len(matrices[0]) // 2
    stiffest = float(np.abs(matrices[0, half:, :half]).max()) ** 0.5
    matrices[:, :half, half:] *= stiffest  # scales places like speeds: the exponential needs fewer squarings
    matrices[:, half:, :half] /= stiffest
    carried, log_scale = np.eye(2 * half), 0.0
    for matrix in matrices:
        moved, log_moved = _exponential(part * matrix)
        carried = moved @ carried
        exponent = math.frexp(float(np.abs(carried).max()))[1]
        carried = np.ldexp(carried, -exponent)  # at low speed departures overflow within a revolution
        log_scale += log_moved + exponent * math.log(2)
    log_factor = math.log(float(np.abs(np.linalg.eigvals(carried)).max())) + log_scale
    frequency = climb = 0.0
    if log_factor > 0:
        rates = np.linalg.eigvals(matrices)
        frequency = abs(float(rates.flat[rates.real.argmax()].imag))
        climb = part * float(np.where(rates.imag > 0, rates.real, 0.0).max(axis=1).sum())
    rate = log_factor / (part * len(matrices))
    return Growth(math.exp(min(log_factor, _LARGEST_LOG)), rate, frequency, climb)


def _exponential(matrix: FloatArray) -> tuple[FloatArray, float]:
    """The exponential of a matrix, divided by a factor whose logarithm is the second result."""
    with np.errstate(over="ignore", invalid="ignore"):
        exponential = expm(matrix)
    if np.isfinite(exponential).all():
        return exponential, 0.0
    largest = float(np.linalg.eigvals(matrix).real.max())
    return expm(matrix - largest * np.eye(len(matrix))), largest


def _leading(slopes: FloatArray) -> IntArray:
    """Columns that determine all others: as many as there are independent rows."""
    if not slopes.size:
        return np.zeros(0, int)
    triangle, order = qr(slopes, mode="r", pivoting=True, check_finite=False)
    sizes = np.abs(np.diagonal(triangle))
    return np.asarray(order[: int((sizes > _REDUNDANT * sizes[0]).sum())])


@kernel
def _constrain(tables, work, times, positions, velocities, slopes, rates):
    """Slopes of constraint equations by velocities, shape (state, equation, row, 6), and rates, (state, equation)."""
    rows = tables.rows
    for n in range(times.size):
        at, speeds = positions[n], velocities[n]
        evaluate_constraints(rows, at, speeds, times[n], work.phi, work.phi_t, work.gamma, work.jacobian)
        for k in range(rows.size):
            rates[n, k] = constraint_rate(rows[k], work.jacobian[k], speeds) + work.phi_t[k]
            for side in range(2):
                row = tables.bodies[rows[k].body_a if side == 0 else rows[k].body_b].block
                if row >= 0:
                    for d in range(6):
                        slopes[n, k, row, d] += work.jacobian[k, 6 * side + d]


@kernel
def _differentiate(tables, work, times, places, velocities, steps, motions, keep, rates, changes):
    """Turns of every motion (0) and derivatives of all accelerations by it (1) and by its velocity (2), by differences.

    Args:
        times, places, velocities: States, the last two of shape (state, body, 7) and (state, body, 6).
        steps: Differences, shape (2, motion).
        motions: Motions that constraints allow, shape (state, motion, row, 6).
        keep: Velocities that take a unit rate of an equation back, shape (state, equation, row, 6).
        rates: Rates of the equations, which all motions leave as they are, shape (state, equation).
        changes: Receives the derivatives, shape (state, 3, motion, row, 6).
    """
    at, speeds, before, shift = work.stages[_AT], work.stages[_SPEEDS], work.stages[_BEFORE], work.displacement[0]
    bodies = tables.body_of_row
    for n in range(times.size):
        copy_vectors(places[n], at)
        copy_vectors(velocities[n], speeds)
        evaluate(tables, work, at, speeds, times[n], 0.0)
        copy_vectors(work.acceleration, before)
        for m in range(motions.shape[1]):
            for kind in range(2):
                step = steps[kind, m]
                for row in range(bodies.size):
                    body = bodies[row]
                    for d in range(6):
                        speeds[body, d] = velocities[n, body, d] + kind * step * motions[n, m, row, d]
                        shift[d] = (1 - kind) * step * motions[n, m, row, d]
                    move(places[n, body], shift, at[body])
                if kind == 0:
                    _keep_rates(tables, work, at, speeds, times[n], keep[n], rates[n])
                evaluate(tables, work, at, speeds, times[n], 0.0)
                for row in range(bodies.size):
                    for d in range(6):
                        change = work.acceleration[bodies[row], d] - before[bodies[row], d]
                        changes[n, 1 + kind, m, row, d] = change / step
            for row in range(bodies.size):
                turned = cross(load_vector(velocities[n, bodies[row]], 3), load_vector(motions[n, m, row], 3))
                for d in range(3):
                    changes[n, 0, m, row, 3 + d] = turned[d]


@kernel
def _keep_rates(tables, work, positions, speeds, time, keep, rates):
    """Change velocities after a motion so that constraint equations keep their rates."""
    rows = tables.rows
    evaluate_constraints(rows, positions, speeds, time, work.phi, work.phi_t, work.gamma, work.jacobian)
    for k in range(rows.size):
        work.gamma[k] = constraint_rate(rows[k], work.jacobian[k], speeds) + work.phi_t[k] - rates[k]
    for k in range(rows.size):
        for row in range(keep.shape[1]):
            for d in range(6):
                speeds[tables.body_of_row[row], d] += work.gamma[k] * keep[k, row, d]
