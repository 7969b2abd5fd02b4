"""Equations of motion, Eq. 1: generalized forces, accelerations and multipliers of a scene, and its energy."""

from __future__ import annotations

import math

from tripod_doe.mechanics.bearing import bearing_forces, bearing_matrices
from tripod_doe.mechanics.compilation import inlined_kernel, kernel, kernel_part
from tripod_doe.mechanics.constraints import evaluate_constraints, factorise_schur, solve_schur
from tripod_doe.mechanics.contact import add_contacts
from tripod_doe.mechanics.lanes import clear
from tripod_doe.mechanics.pairs import add_pair
from tripod_doe.mechanics.rotations import (
    add,
    cross,
    dot,
    load_attitude,
    load_vector,
    move,
    rotate,
    rotate_back,
    rotation_by,
    scale,
    subtract,
)  # fmt: skip
from tripod_doe.mechanics.tables import EVALUATIONS, FIRST, LINEARISATIONS, Slopes

__all__ = [
    "accelerate", "add_inertia_forces", "add_inertia_matrices", "add_mass_blocks", "add_mass_product",
    "add_momenta", "add_reaction_power", "clear", "constraint_rate", "copy_vectors", "evaluate",
    "generalized_forces", "kinetic_energies", "larger", "linearise", "linearise_elements", "project_positions",
    "project_velocities", "settle", "velocity_at_rest",
]  # fmt: skip

_PROJECTION_SWEEPS = 4


@kernel
def copy_vectors(source, target):
    """Copy rows of bodies, as many columns as both have."""
    for i in range(source.shape[0]):
        for d in range(min(source.shape[1], target.shape[1])):
            target[i, d] = source[i, d]


@inlined_kernel
def larger(worst, size):
    """The larger of two sizes that are not negative, infinite where one is not a number: NaN must not be lost."""
    if size <= worst:
        return worst
    return size if size > worst else math.inf


@inlined_kernel
def _angular_momentum(body, attitude, omega):
    """Inertia times angular velocity, in world axes."""
    local = rotate_back(attitude, omega)
    return rotate(attitude, (body.inertia[0] * local[0], body.inertia[1] * local[1], body.inertia[2] * local[2]))


@inlined_kernel
def _inertia_force(body, frame, position, velocity):
    """Gyroscopic, Coriolis and centrifugal force and moment in axes that turn with the angular velocity `frame`.

    With w = omega + frame: -m (2 frame x v + frame x (frame x r)) and -w x I w + I (omega x frame).
    """
    swing = add(scale(2.0, load_vector(velocity, 0)), cross(frame, load_vector(position, 0)))
    attitude, omega = load_attitude(position), load_vector(velocity, 3)
    whole = add(omega, frame)
    turned = cross(whole, _angular_momentum(body, attitude, whole))
    carried = _angular_momentum(body, attitude, cross(omega, frame))
    return scale(-body.mass, cross(frame, swing)), subtract(carried, turned)


@inlined_kernel
def velocity_at_rest(frame, position, velocity):
    """Velocity and angular velocity of a body in axes at rest."""
    carried = cross(frame, load_vector(position, 0))
    return add(load_vector(velocity, 0), carried), add(load_vector(velocity, 3), frame)


@inlined_kernel
def _power(frame, position, velocity, force, free, kind):
    """Power, in axes at rest, of the components of force and moment whose velocities are free (1) or locked (0)."""
    linear, angular = velocity_at_rest(frame, position, velocity)
    power = 0.0
    for d in range(3):
        power += force[d] * linear[d] if free[d] == kind else 0.0
        power += force[3 + d] * angular[d] if free[3 + d] == kind else 0.0
    return power


@inlined_kernel
def _spring_state(spring, positions, velocities):
    """Arms, unit vector from a to b, velocity of b's end against a's, and length."""
    a, b = spring.body_a, spring.body_b
    arm_a = rotate(load_attitude(positions[a]), load_vector(spring.point_a, 0))
    arm_b = rotate(load_attitude(positions[b]), load_vector(spring.point_b, 0))
    between = subtract(add(load_vector(positions[b], 0), arm_b), add(load_vector(positions[a], 0), arm_a))
    closing = subtract(
        add(load_vector(velocities[b], 0), cross(load_vector(velocities[b], 3), arm_b)),
        add(load_vector(velocities[a], 0), cross(load_vector(velocities[a], 3), arm_a)),
    )
    length = math.sqrt(dot(between, between)) + 1e-300
    return arm_a, arm_b, scale(1.0 / length, between), closing, length


@kernel
def _add_springs(tables, work, positions, velocities, slopes, matrix):
    """Add the forces of springs and dampers, their energies and, unless both factors are zero, their derivatives."""
    force, drift, ledger = work.force, work.drift, work.ledger
    for i in range(tables.springs.size):
        spring = tables.springs[i]
        arm_a, arm_b, along, closing, length = _spring_state(spring, positions, velocities)
        rate, stretch = dot(along, closing), length - spring.free_length
        tension = spring.stiffness * stretch + spring.damping * rate
        ledger[0] += 0.5 * spring.stiffness * stretch * stretch
        ledger[5] += spring.damping * rate * rate
        _apply_between(force, spring, arm_a, arm_b, scale(tension, along))
        if slopes.by_velocity != 0.0 or slopes.by_position != 0.0:
            across = spring.stiffness * stretch / length
            axial = spring.stiffness - across
            _apply_between(drift, spring, arm_a, arm_b, add(scale(-across, closing), scale(-axial * rate, along)))
            block = work.pair[0]
            clear(block)
            for d in range(3):
                block[d, d] = slopes.by_position * across
                for e in range(3):
                    along_both = slopes.by_velocity * spring.damping + slopes.by_position * axial
                    block[d, e] += along_both * along[d] * along[e]
            add_pair(matrix, spring.pair, block, arm_a, arm_b)


@inlined_kernel
def _apply_between(force, spring, arm_a, arm_b, pull):
    """Add a force that pulls body a, and its opposite on body b."""
    moment_a, moment_b = cross(arm_a, pull), cross(arm_b, pull)
    for d in range(3):
        force[spring.body_a, d] += pull[d]
        force[spring.body_a, 3 + d] += moment_a[d]
        force[spring.body_b, d] -= pull[d]
        force[spring.body_b, 3 + d] -= moment_b[d]


@kernel
def generalized_forces(tables, work, positions, velocities):
    """Evaluate Q of Eq. 1: loads, gravity, elements and inertia forces, and the energy ledger.

    Energies are those in axes at rest. The power of locked velocities is that of the reaction -Q which keeps them.
    """
    work.counters[EVALUATIONS] += 1
    _add_elements(tables, work, positions, velocities, Slopes(1.0, 0.0, 0.0), work.matrix)
    add_inertia_forces(tables, work, positions, velocities)


@inlined_kernel
def linearise(tables, work, positions, velocities, secant, by_velocity, by_position, matrix):
    """Evaluate Q as `generalized_forces` does, and by_velocity D + by_position K with D = -dQ/dv and K = -dQ/dq.

    Parameters
    ----------
    secant
        1 for the secant slope of friction, 0 for its tangent; see `tables.Slopes`.
    by_velocity, by_position
        Factors, not both zero.
    matrix
        Receives the sum, shape (block, 6, 8); `work.drift` receives K times the velocities.
    """
    linearise_elements(tables, work, positions, velocities, secant, by_velocity, by_position, matrix)
    add_inertia_forces(tables, work, positions, velocities)
    add_inertia_matrices(tables, positions, velocities, by_velocity, matrix)


@kernel_part
def linearise_elements(tables, work, positions, velocities, secant, by_velocity, by_position, matrix):
    """As `linearise`, but without inertia forces: for methods that follow momenta instead of accelerations."""
    work.counters[EVALUATIONS] += 1
    work.counters[LINEARISATIONS] += 1
    clear(matrix)
    clear(work.drift)
    _add_elements(tables, work, positions, velocities, Slopes(secant, by_velocity, by_position), matrix)


@kernel_part
def _add_elements(tables, work, positions, velocities, slopes, matrix):
    """Evaluate all forces and the ledger and add, unless both factors are zero, what elements have of D and K."""
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
    _add_springs(tables, work, positions, velocities, slopes, matrix)
    bearing_forces(tables.bearings, positions, velocities, force, ledger)
    if slopes.by_velocity != 0.0 or slopes.by_position != 0.0:
        bearing_matrices(tables, work, positions, velocities, slopes, matrix)
    for i in range(tables.bodies.size):  # what keeps a locked body, and the ground, going
        ledger[1] -= _power(frame, positions[i], velocities[i], force[i], tables.bodies[i].free, 0.0)


@kernel
def add_inertia_forces(tables, work, positions, velocities):
    """Add gyroscopic, Coriolis and centrifugal forces."""
    frame = load_vector(tables.frame, 0)
    for i in range(tables.bodies.size):
        body = tables.bodies[i]
        if body.block < 0:
            continue
        push, turn = _inertia_force(body, frame, positions[i], velocities[i])
        for d in range(3):
            work.force[i, d] += push[d]
            work.force[i, 3 + d] += turn[d]


@kernel
def add_inertia_matrices(tables, positions, velocities, by_velocity, matrix):
    """Add the derivatives of the inertia forces by the velocities, column by column."""
    frame = load_vector(tables.frame, 0)
    for i in range(tables.bodies.size):
        body = tables.bodies[i]
        if body.block < 0:
            continue
        block = matrix[tables.pattern.own[body.block]]
        attitude, whole = load_attitude(positions[i]), add(load_vector(velocities[i], 3), frame)
        momentum = _angular_momentum(body, attitude, whole)
        for d in range(3):
            unit = (1.0 if d == 0 else 0.0, 1.0 if d == 1 else 0.0, 1.0 if d == 2 else 0.0)
            swing = cross(frame, unit)
            turned = add(cross(whole, _angular_momentum(body, attitude, unit)), cross(unit, momentum))
            carried = _angular_momentum(body, attitude, swing)  # -d(I (omega x frame)) is I (frame x unit)
            for e in range(3):
                block[e, d] += by_velocity * 2.0 * body.mass * swing[e]
                block[3 + e, 3 + d] += by_velocity * (turned[e] + carried[e])


@kernel
def add_momenta(tables, positions, velocities, factor, turn, out):
    """Add `factor` times the momenta that bodies have in axes at rest, as seen from axes turned by `turn` since.

    A free body keeps them: methods that follow momenta need no gyroscopic, Coriolis or centrifugal forces, and do not
    damp a body that stands still while the frame turns.

    Parameters
    ----------
    turn
        Time for which the frame has turned on since the momenta were as they are.
    out
        Shape (row of the block matrix, 6).
    """
    frame = load_vector(tables.frame, 0)
    back = rotation_by(scale(-turn, frame))
    for row in range(tables.body_of_row.size):
        i = tables.body_of_row[row]
        body = tables.bodies[i]
        speed, omega = velocity_at_rest(frame, positions[i], velocities[i])
        linear = rotate(back, scale(factor * body.mass, speed))
        angular = rotate(back, scale(factor, _angular_momentum(body, load_attitude(positions[i]), omega)))
        for d in range(3):
            out[row, d] += linear[d]
            out[row, 3 + d] += angular[d]


@inlined_kernel
def _divide_by_mass(body, position, force, start, out):
    """Acceleration of one body by a force and moment at force[start:start + 6]; zero where it is locked."""
    attitude = load_attitude(position)
    moment = (force[start + 3] * body.free[3], force[start + 4] * body.free[4], force[start + 5] * body.free[5])
    local = rotate_back(attitude, moment)
    turned = rotate(attitude, (local[0] / body.inertia[0], local[1] / body.inertia[1], local[2] / body.inertia[2]))
    for d in range(3):
        out[d] = body.free[d] * force[start + d] / body.mass
        out[3 + d] = body.free[3 + d] * turned[d]


@inlined_kernel
def add_mass_product(tables, positions, vectors, factor, out):
    """Add `factor` times M(q) times vectors to out, row by row of the block matrix.

    Parameters
    ----------
    vectors
        Shape (body, 6 or more).
    out
        Shape (row, 6).
    """
    for i in range(tables.bodies.size):
        body = tables.bodies[i]
        if body.block < 0:
            continue
        momentum = _angular_momentum(body, load_attitude(positions[i]), load_vector(vectors[i], 3))
        for d in range(3):
            out[body.block, d] += factor * body.mass * vectors[i, d]
            out[body.block, 3 + d] += factor * momentum[d]


@inlined_kernel
def add_mass_blocks(tables, positions, matrix):
    """Add M(q) to the diagonal blocks of a block matrix."""
    for i in range(tables.bodies.size):
        body = tables.bodies[i]
        if body.block < 0:
            continue
        block = matrix[tables.pattern.own[body.block]]
        attitude = load_attitude(positions[i])
        for d in range(3):
            block[d, d] += body.mass
            unit = (1.0 if d == 0 else 0.0, 1.0 if d == 1 else 0.0, 1.0 if d == 2 else 0.0)
            column = _angular_momentum(body, attitude, unit)
            for e in range(3):
                block[3 + e, 3 + d] += column[e]


@kernel
def _weigh_by_mass(tables, work, positions):
    """M^-1 Phi_q^T of every constraint equation, and the factors of their Schur complement."""
    for k in range(tables.rows.size):
        clear(work.weighted[k])
        a, b = tables.rows[k].body_a, tables.rows[k].body_b
        if tables.bodies[a].block >= 0:
            _divide_by_mass(tables.bodies[a], positions[a], work.jacobian[k], 0, work.weighted[k, a])
        if tables.bodies[b].block >= 0:
            _divide_by_mass(tables.bodies[b], positions[b], work.jacobian[k], 6, work.weighted[k, b])
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
    """Add to the ledger what reactions put in: the power of a drive, and of locked velocities that a joint pulls at.

    Parameters
    ----------
    factor
        What `work.multipliers` have to be multiplied by.
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

    Parameters
    ----------
    baumgarte
        Rate alpha of gamma - 2 alpha Phi' - alpha^2 Phi; zero for none.
    """
    acceleration = work.acceleration
    clear(acceleration)
    for i in range(tables.bodies.size):
        if tables.bodies[i].block >= 0:
            _divide_by_mass(tables.bodies[i], positions[i], work.force[i], 0, acceleration[i])
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
def settle(tables, work, positions, velocities, time, settings):
    """Put a new state back onto its constraints if that is asked for, and evaluate it: forces, slips and ledger."""
    if settings.projection and tables.rows.size > 0:
        project_positions(tables, work, positions, velocities, time)
        project_velocities(tables, work, positions, velocities, time)
    evaluate(tables, work, positions, velocities, time, settings.baumgarte)


@kernel
def kinetic_energies(tables, positions, velocities, energies):
    """Add to energies, shape (state,), the kinetic energy, in axes at rest, of all bodies that can move freely."""
    frame = load_vector(tables.frame, 0)
    for n in range(energies.size):
        for i in range(tables.bodies.size):
            body = tables.bodies[i]
            if body.block >= 0:
                speed, omega = velocity_at_rest(frame, positions[n, i], velocities[n, i])
                momentum = _angular_momentum(body, load_attitude(positions[n, i]), omega)
                energies[n] += 0.5 * (body.mass * dot(speed, speed) + dot(omega, momentum))
