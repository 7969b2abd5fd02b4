"""Inertia of bodies, in axes that may turn: inertia forces and their derivatives, momenta, masses, kinetic energy."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import (
    add,
    cross,
    dot,
    load_attitude,
    load_vector,
    rotate,
    rotate_back,
    rotation_by,
    scale,
    subtract,
)
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel


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
    """Velocity and angular velocity of a body in inertial axes."""
    carried = cross(frame, load_vector(position, 0))
    return add(load_vector(velocity, 0), carried), add(load_vector(velocity, 3), frame)


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
    """Add `factor` times the momenta that bodies have in inertial axes, as seen from axes turned by `turn` since.

    A free body keeps them: methods that follow momenta need no gyroscopic, Coriolis or centrifugal forces, and do not
    damp a body that stands still while the frame turns.

    Args:
        turn: Rotation time of the frame since the time of the momenta.
        out: Shape (row of the block matrix, 6).
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
def divide_by_mass(body, position, force, start, out):
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

    Args:
        vectors: Shape (body, 6 or more).
        out: Shape (row, 6).
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
def kinetic_energies(tables, positions, velocities, energies):
    """Add to energies, shape (state,), the kinetic energy, in inertial axes, of all bodies that can move freely."""
    frame = load_vector(tables.frame, 0)
    for n in range(energies.size):
        for i in range(tables.bodies.size):
            body = tables.bodies[i]
            if body.block >= 0:
                speed, omega = velocity_at_rest(frame, positions[n, i], velocities[n, i])
                momentum = _angular_momentum(body, load_attitude(positions[n, i]), omega)
                energies[n] += 0.5 * (body.mass * dot(speed, speed) + dot(omega, momentum))
