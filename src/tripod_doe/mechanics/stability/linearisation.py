"""Limits of a step: the fastest rates of a scene's linearisation M u' + D u + K q = 0 about a state.

contact
    The stiffest mode of the contacts, omega with omega^2 the largest eigenvalue of M^-1 K.
friction
    The fastest relaxation by friction and damping, the largest eigenvalue of M^-1 D with the exact tangent of every
    law: mu f_n / (v_st m) for a body that hardly slips, times m r^2 / I where friction turns it with the lever r.
lag
    Error of a linearly implicit step from the secant (lagged) slope of friction. With D_s the secant's matrix and D the
    tangent's, such a step solves M u' + h (D_s - D) u' + ... to first order in h, so in a motion that changes at the
    rate P the error of velocities is h P times (K / (i P) + D + i P M)^-1 (D_s - D): the rate is P times its largest
    eigenvalue, and the step times the rate is the relative error.

Explicit methods are unstable beyond fixed multiples of 1/contact and 1/friction (`method_interface.Method.reach`).
All matrices act only on motions that constraints allow.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass

import numpy as np
from scipy.linalg import eigvals, null_space, solve

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.forces.constraints import evaluate_constraints
from tripod_doe.mechanics.forces.inertia import add_inertia_matrices, add_mass_blocks
from tripod_doe.mechanics.solve.equations_of_motion import linearise_elements
from tripod_doe.mechanics.stability.rates import Rates
from tripod_doe.mechanics.tables import Slopes


@dataclass(frozen=True)
class Matrices:
    """Linearisation of a scene, reduced to the motions that locks and constraints allow; each of shape (dof, dof)."""

    # mass, stiffness: M, and K = -dQ/dq
    mass: FloatArray
    stiffness: FloatArray
    # tangent, secant: D = -dQ/dv with the exact tangent of every friction law, and with its secant across and along the
    # slip
    tangent: FloatArray
    secant: FloatArray


def linear_matrices(assembly: Assembly, state: State | None = None) -> Matrices:
    """Linearise a scene about a state.

    Args:
        state: The state; the scene's start unless given.
    """
    state, work, tables = state or assembly.initial_state(), assembly.work(), assembly.tables
    motions = _motions(assembly, state)

    def reduced(blocks: FloatArray) -> FloatArray:
        matrix: FloatArray = motions.T @ _dense(assembly, blocks) @ motions
        return matrix

    def of_elements(secant: float, by_velocity: float, by_position: float) -> FloatArray:
        slopes = Slopes(secant, by_velocity, by_position)
        linearise_elements(tables, work, state.positions, state.velocities, slopes, work.matrix)
        add_inertia_matrices(tables, state.positions, state.velocities, by_velocity, work.matrix)
        return reduced(work.matrix)

    mass = np.zeros_like(work.matrix)
    add_mass_blocks(tables, state.positions, mass)
    return Matrices(reduced(mass), of_elements(0.0, 0.0, 1.0), of_elements(0.0, 1.0, 0.0), of_elements(1.0, 1.0, 0.0))


def _dense(assembly: Assembly, blocks: FloatArray) -> FloatArray:
    """A block matrix as an ordinary one."""
    pattern = assembly.tables.pattern
    size = pattern.own.size
    dense = np.zeros((size, 6, size, 6))
    dense[pattern.row, :, pattern.column] = blocks[:, :, :6]
    return dense.reshape(6 * size, 6 * size)


def _motions(assembly: Assembly, state: State) -> FloatArray:
    """Basis of the velocities that are neither locked nor excluded by constraints, shape (6 x row, dof)."""
    tables, work = assembly.tables, assembly.work()
    free = np.flatnonzero(tables.bodies["free"][tables.body_of_row].ravel())
    basis: FloatArray = np.eye(6 * tables.body_of_row.size)[:, free]
    if tables.rows.size == 0:
        return basis
    evaluate_constraints(
        tables.rows, state.positions, state.velocities, state.time, work.phi, work.phi_t, work.gamma, work.jacobian
    )
    rows = np.zeros((tables.rows.size, len(assembly.names), 6))
    for side, bodies in enumerate((tables.rows["body_a"], tables.rows["body_b"])):
        rows[np.arange(tables.rows.size), bodies] += work.jacobian[:, 6 * side : 6 * side + 6]
    # lengths count like mm and turns like rad: only the span of the basis matters
    left: FloatArray = basis @ null_space(rows[:, tables.body_of_row].reshape(tables.rows.size, -1) @ basis)
    return left


def rates_at(matrices: Matrices, pace: float) -> Rates:
    """The rates of one state.

    Args:
        pace: Rate at which the motion changes, for the error by the secant's lag.
    """
    m, k, d = matrices.mass, matrices.stiffness, matrices.tangent
    response = k / (1j * pace) + d + 1j * pace * m
    behind = np.abs(eigvals(solve(response, matrices.secant - d)))
    return Rates(_largest(k, m) ** 0.5, _largest(d, m), float(pace * behind.max(initial=0.0)))


def _largest(matrix: FloatArray, mass: FloatArray) -> float:
    """Largest real part of an eigenvalue of M^-1 times the matrix, not below zero."""
    return float(eigvals(matrix, mass).real.max(initial=0.0))


def fastest_rates(assembly: Assembly, states: Iterable[State], pace: float) -> Rates:
    """Limits of a step over a motion through these states.

    The fastest rates limit stability; errors by the lag add up, so its rate is the mean.
    """
    rows = np.array([astuple(rates_at(linear_matrices(assembly, state), pace)) for state in states])
    return Rates(*(float(rate) for rate in (*rows[:, :2].max(axis=0), rows[:, 2].mean())))
