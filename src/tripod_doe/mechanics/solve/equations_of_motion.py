"""Equations of motion, Eq. 1: generalized forces, accelerations and multipliers of a scene, and its projections."""

from __future__ import annotations

import math

from tripod_doe.mechanics.arithmetic.rotations import load_attitude, load_vector, move, rotate
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part
from tripod_doe.mechanics.forces.bearing import bearing_forces
from tripod_doe.mechanics.forces.bearing_derivatives import bearing_matrices
from tripod_doe.mechanics.forces.constraints import evaluate_constraints, factorise_schur, solve_schur
from tripod_doe.mechanics.forces.inertia import (
    add_inertia_forces,
    add_inertia_matrices,
    divide_by_mass,
    velocity_at_rest,
)
from tripod_doe.mechanics.forces.sphere_contact import add_contacts
from tripod_doe.mechanics.forces.springs import add_springs
from tripod_doe.mechanics.tables import EVALUATIONS, FIRST, LINEARISATIONS, Slopes

_PROJECTION_SWEEPS = 4


@kernel
def copy_vectors(source, target):
    """Copy rows of bodies, as many columns as both have."""
    for i in range(source.shape[0]):
        for d in range(min(source.shape[1], target.shape[1])):
            target[i, d] = source[i, d]


@inlined_kernel
def larger(worst, size):
    """The larger of two non-negative numbers; infinite if one is NaN, which must not be lost."""
    if size <= worst:
        return worst
    return size if size > worst else math.inf


@inlined_kernel
def _power(frame, position, velocity, force, free, kind):
    """Power, in inertial axes, of the components of force and moment whose velocities are free (1) or locked (0)."""
    linear, angular = velocity_at_rest(frame, position, velocity)
    power = 0.0
    for d in range(3):
        power += force[d] * linear[d] if free[d] == kind else 0.0
        power += force[3 + d] * angular[d] if free[3 + d] == kind else 0.0
    return power


@kernel
def generalized_forces(tables, work, positions, velocities):
    """Evaluate Q of Eq. 1: loads, gravity, elements and inertia forces, and the energy ledger.

    Energies are those in inertial axes. The power of locked velocities is the power of the reaction -Q that keeps them
    constant.
    """
    work.counters[EVALUATIONS] += 1
    _add_elements(tables, work, positions, velocities, Slopes(1.0, 0.0, 0.0), work.matrix)
    add_inertia_forces(tables, work, positions, velocities)


@inlined_kernel
def linearise(tables, work, positions, velocities, secant, by_velocity, by_position, matrix):
    """Evaluate Q as `generalized_forces` does, and by_velocity D + by_position K with D = -dQ/dv and K = -dQ/dq.

    Args:
        secant: 1 for the secant slope of friction, 0 for its tangent; see `tables.Slopes`.
        by_velocity, by_position: Factors, not both zero.
        matrix: Receives the sum, shape (block, 6, 8).
    """
    linearise_elements(tables, work, positions, velocities, Slopes(secant, by_velocity, by_position), matrix)
    add_inertia_forces(tables, work, positions, velocities)
    add_inertia_matrices(tables, positions, velocities, by_velocity, matrix)


@kernel_part
def linearise_elements(tables, work, positions, velocities, slopes, matrix):
    """As `linearise`, but without inertia forces: for methods that follow momenta instead of accelerations."""
    work.counters[EVALUATIONS] += 1
    work.counters[LINEARISATIONS] += 1
    clear(matrix)
    _add_elements(tables, work, positions, velocities, slopes, matrix)


@kernel_part
def _add_elements(tables, work, positions, velocities, slopes, matrix):
    """Evaluate all forces and the ledger and, unless both factors are zero, add the elements' parts of D and K."""
    force, ledger, frame = work.force, work.ledger, load_vector(tables.frame, 0)
    clear(ledger)
    for i in range(tables.bodies.size):
        body = tables.bodies[i]
        for d in range(6):
            force[i, d] = body.load[d]
        if body.block >= 0:
            own = rotate(load_attitude(positions[i]), load_vector(body.own_moment, 0))
            for d in range(3):
                force[i, d] += body.mass * tables.gravity[d]
                force[i, 3 + d] += own[d]
        ledger[1] += _power(frame, positions[i], velocities[i], force[i], body.free, 1.0)
    add_contacts(tables, work, FIRST, tables.contacts.size, positions, velocities, slopes, matrix)
    add_springs(tables, work, positions, velocities, slopes, matrix)
    bearing_forces(tables.bearings, positions, velocities, force, ledger)
    if slopes.by_velocity != 0.0 or slopes.by_position != 0.0:
        bearing_matrices(tables, work, positions, velocities, slopes, matrix)
    for i in range(tables.bodies.size):  # power that moves locked bodies and the ground
        ledger[1] -= _power(frame, positions[i], velocities[i], force[i], tables.bodies[i].free, 0.0)


@kernel
def _weigh_by_mass(tables, work, positions):
    """M^-1 Phi_q^T of every constraint equation, and the factors of their Schur complement."""
    for k in range(tables.rows.size):
        clear(work.weighted[k])
        a, b = tables.rows[k].body_a, tables.rows[k].body_b
        if tables.bodies[a].block >= 0:
            divide_by_mass(tables.bodies[a], positions[a], work.jacobian[k], 0, work.weighted[k, a])
        if tables.bodies[b].block >= 0:
            divide_by_mass(tables.bodies[b], positions[b], work.jacobian[k], 6, work.weighted[k, b])
    factorise_schur(tables.rows, work.jacobian, work.weighted, work.schur, work.pivots)


@inlined_kernel
def constraint_rate(row, jacobian, vectors):
    """Phi_q times the vectors of the two bodies of one equation."""
    total = 0.0
    for d in range(6):
        total += jacobian[d] * vectors[row.body_a, d] + jacobian[6 + d] * vectors[row.body_b, d]
    return total


@inlined_kernel
def add_reaction_power(tables, work, positions, velocities, factor):
    """Add to the ledger the power of reactions: of drives, and of locked velocities under loads from joints.

    Args:
        factor: Factor on `work.multipliers`.
    """
    frame = load_vector(tables.frame, 0)
    for k in range(tables.rows.size):
        for side in range(2):
            i = tables.rows[k].body_a if side == 0 else tables.rows[k].body_b
            pull = work.jacobian[k, 6 * side : 6 * side + 6]
            power = _power(frame, positions[i], velocities[i], pull, tables.bodies[i].free, 1.0)
            work.ledger[1] -= factor * work.multipliers[k] * power


@kernel
def accelerate(tables, work, positions, velocities, time, baumgarte):
    """Accelerations and multipliers of Eq. 1 from the forces of the last evaluation.

    Args:
        baumgarte: Rate alpha of gamma - 2 alpha Phi' - alpha^2 Phi; zero for none.
    """
    acceleration = work.acceleration
    clear(acceleration)
    for i in range(tables.bodies.size):
        if tables.bodies[i].block >= 0:
            divide_by_mass(tables.bodies[i], positions[i], work.force[i], 0, acceleration[i])
    if tables.rows.size == 0:
        return
    rows = tables.rows
    evaluate_constraints(rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian)
    _weigh_by_mass(tables, work, positions)
    for k in range(rows.size):
        rate = constraint_rate(rows[k], work.jacobian[k], velocities) + work.phi_t[k]
        wanted = work.gamma[k] - baumgarte * (2.0 * rate + baumgarte * work.phi[k])
        work.gamma[k] = constraint_rate(rows[k], work.jacobian[k], acceleration) - wanted
    solve_schur(work.schur, work.pivots, work.gamma, work.multipliers)
    for k in range(rows.size):
        if work.multipliers[k] != 0.0:
            for i in (rows[k].body_a, rows[k].body_b):
                for d in range(6):
                    acceleration[i, d] -= work.multipliers[k] * work.weighted[k, i, d]
    add_reaction_power(tables, work, positions, velocities, 1.0)


@kernel_part
def evaluate(tables, work, positions, velocities, time, baumgarte):
    """Forces and accelerations of a state."""
    generalized_forces(tables, work, positions, velocities)
    accelerate(tables, work, positions, velocities, time, baumgarte)


@kernel
def project_positions(tables, work, positions, velocities, time):
    """Put positions back onto the constraints along M^-1 Phi_q^T, by Newton's method."""
    rows = tables.rows
    for _ in range(_PROJECTION_SWEEPS):
        evaluate_constraints(rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian)
        worst = 0.0
        for k in range(rows.size):
            worst = max(worst, abs(work.phi[k]))
        if worst <= 1e-14 * tables.scales[0]:
            return
        _weigh_by_mass(tables, work, positions)
        solve_schur(work.schur, work.pivots, work.phi, work.multipliers)
        shift = work.acceleration
        clear(shift)
        for k in range(rows.size):
            for i in (rows[k].body_a, rows[k].body_b):
                for d in range(6):
                    shift[i, d] -= work.multipliers[k] * work.weighted[k, i, d]
        for i in range(tables.bodies.size):
            move(positions[i], shift[i], positions[i])


@kernel
def project_velocities(tables, work, positions, velocities, time):
    """Put velocities back onto Phi_q q' + Phi_t = 0 along M^-1 Phi_q^T."""
    rows = tables.rows
    evaluate_constraints(rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian)
    _weigh_by_mass(tables, work, positions)
    for k in range(rows.size):
        work.gamma[k] = constraint_rate(rows[k], work.jacobian[k], velocities) + work.phi_t[k]
    solve_schur(work.schur, work.pivots, work.gamma, work.multipliers)
    for k in range(rows.size):
        for i in (rows[k].body_a, rows[k].body_b):
            for d in range(6):
                velocities[i, d] -= work.multipliers[k] * work.weighted[k, i, d]


@kernel
def project(tables, work, positions, velocities, time, settings):
    """Project a new state onto its constraints if requested."""
    if settings.projection and tables.rows.size > 0:
        project_positions(tables, work, positions, velocities, time)
        project_velocities(tables, work, positions, velocities, time)


@kernel
def settle(tables, work, positions, velocities, time, settings):
    """Project a new state onto its constraints if requested, and evaluate it: forces, slips and ledger."""
    project(tables, work, positions, velocities, time, settings)
    evaluate(tables, work, positions, velocities, time, settings.baumgarte)
