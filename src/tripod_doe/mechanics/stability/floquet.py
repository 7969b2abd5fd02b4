"""Stability of a motion: the growth rate of its fastest growing departure (Floquet's theory).

A method that damps unresolved motion follows a smooth motion even if the exact motion is unstable: a joint with
friction may vibrate by itself. So small departures (q, v) of positions and velocities are followed along the motion;
their equation is

    q' = v + omega x q        v' = A_q q + A_v v        with A_q = da/dq, A_v = da/dv

with the cross product for rotations only, and a the accelerations of Eq. 1 with all reactions, differentiated
numerically at some states of the motion. Between two states the matrix is assumed constant; its exponential propagates
departures. Constraints are stabilised: departures that violate them decay.

Source: e.g. P. Hagedorn, Non-Linear Oscillations, Clarendon Press, 1988, ch. 2. Cost: 2 evaluations a degree of
freedom and state, and an exponential of a matrix of twice that size a state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors, evaluate
from tripod_doe.mechanics.tables import Work
from tripod_doe.one_thread import one_thread

_DIFFERENCE = 1e-6
"""Steps of the differences over the scales of the scene: between curvature and rounding (inverse)."""


_LARGEST_LOG = 709.0  # of a number that can be represented

_AT, _SPEEDS = range(2)
"""Rows of `Work.stages`: the state that is evaluated."""


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


def departure_matrices(assembly: Assembly, states: Sequence[State], duration: float) -> FloatArray:
    """The matrices of the equation of departures, shape (state, 2 x dof, 2 x dof).

    Args:
        states: States at the middles of equal parts of the motion, in order.
        duration: How long the motion takes.
    """
    work = assembly.memory
    return np.array([_departure_matrix(assembly, work, state, len(states) / duration) for state in states])


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


def _departure_matrix(assembly: Assembly, work: Work, state: State, stabilisation: float) -> FloatArray:
    """The matrix of the equation of departures at one state, shape (2 x dof, 2 x dof)."""
    tables, scene = assembly.tables, assembly.scene
    rows, count = tables.body_of_row, tables.body_of_row.size
    turn = scene.length_scale * scene.rotation_scale / scene.speed_scale
    small = _DIFFERENCE * np.array([scene.length_scale, turn, scene.speed_scale, scene.rotation_scale])
    slopes = np.zeros((2, 6 * count, 6 * count))
    _differentiate(tables, work, state.positions, state.velocities, state.time, stabilisation, small, slopes)
    matrix = np.zeros((12 * count, 12 * count))
    matrix[6 * count :, : 6 * count], matrix[6 * count :, 6 * count :] = slopes[0].T, slopes[1].T
    matrix[: 6 * count, 6 * count :] = np.eye(6 * count)
    for row, (x, y, z) in enumerate(state.velocities[rows, 3:]):
        turns = slice(6 * row + 3, 6 * row + 6)
        matrix[turns, turns] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    free = np.flatnonzero(np.tile(tables.bodies["free"][rows].ravel() > 0, 2))
    return matrix[np.ix_(free, free)]


@kernel
def _differentiate(tables, work, positions, velocities, time, stabilisation, small, slopes):
    """Derivatives of all accelerations by every place and turn (0) and every velocity (1), by differences.

    Args:
        stabilisation: Rate of Baumgarte's stabilisation.
        small: Differences of places, turns, velocities and angular velocities.
        slopes: Receives them, shape (2, column, row).
    """
    at, speeds, shift = work.stages[_AT], work.stages[_SPEEDS], work.displacement[0]
    copy_vectors(positions, at)
    copy_vectors(velocities, speeds)
    evaluate(tables, work, at, speeds, time, stabilisation)
    count = tables.body_of_row.size
    for other in range(count):
        for e in range(6):
            change = work.acceleration[tables.body_of_row[other], e]
            for column in range(6 * count):
                slopes[0, column, 6 * other + e] = slopes[1, column, 6 * other + e] = -change
    for row in range(count):
        body = tables.body_of_row[row]
        for d in range(6):
            if tables.bodies[body].free[d] == 0.0:
                continue
            for kind in range(2):
                step = small[2 * kind + d // 3]
                column = slopes[kind, 6 * row + d]
                if kind == 0:
                    for e in range(6):
                        shift[e] = step if e == d else 0.0
                    move(positions[body], shift, at[body])
                else:
                    speeds[body, d] = velocities[body, d] + step
                evaluate(tables, work, at, speeds, time, stabilisation)
                for other in range(count):
                    for e in range(6):
                        change = work.acceleration[tables.body_of_row[other], e]
                        column[6 * other + e] = (column[6 * other + e] + change) / step
                for e in range(7):
                    at[body, e] = positions[body, e]
                speeds[body, d] = velocities[body, d]
