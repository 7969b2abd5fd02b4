"""Contact and friction between a row of spheres and a plane or cylinder: forces, and their derivatives.

For a sphere of radius r whose centre lies at the distance rho from a plane or from the axis of a cylinder of radius R,
the penetration is r - rho (plane), r + R - rho (convex) or r - R + rho (concave); n is the normal from the surface to
the sphere. At the sphere's surface act, on the sphere, with slip v = v_rel - (v_rel n) n and relative angular
velocity w = w_n n + w_t,

    f = N n - mu_s N (tanh(|v| / v_st) / |v|) v                                        (Eq. 2, 3)
    M = -mu_r N (D/2) (tanh(|w_t| / w_rt) / |w_t|) w_t - k N^(4/3) tanh(w_n / w_st) n  (Eq. 4, 6, 7)

and their opposites on the surface. The point of contact is on the undeformed sphere: taken in the middle of the
overlap, a needle that is loaded unevenly along its length would roll like a cone and yaw.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tripod_doe.mechanics import laws
from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.rotations import (
    add,
    cross,
    dot,
    load_attitude,
    load_vector,
    rotate,
    scale,
    subtract,
)  # fmt: skip

__all__ = ["contact_forces", "contact_matrices", "largest_penetration"]


class _Row(NamedTuple):
    """A row and its surface in world axes."""

    centre: tuple[float, float, float]
    axis: tuple[float, float, float]
    point: tuple[float, float, float]
    direction: tuple[float, float, float]
    velocity: tuple[float, float, float]
    rotation: tuple[float, float, float]


class _Touch(NamedTuple):
    """Geometry and slip of one sphere that touches; levers are from the row's centre."""

    penetration: float
    rate: float
    normal: tuple[float, float, float]
    distance: float
    lever: tuple[float, float, float]
    sphere: tuple[float, float, float]
    slip: tuple[float, float, float]
    slip_speed: float
    roll: tuple[float, float, float]
    roll_speed: float
    spin: float


@inlined_kernel
def _row(contact, positions, velocities):
    """Place a row in the world, with the relative motion of its body against the surface's at its centre."""
    a, b = contact.body_a, contact.body_b
    attitude_a, attitude_b = load_attitude(positions[a]), load_attitude(positions[b])
    arm = rotate(attitude_a, load_vector(contact.centre, 0))
    centre = add(load_vector(positions[a], 0), arm)
    origin = load_vector(positions[b], 0)
    turn_a, turn_b = load_vector(velocities[a], 3), load_vector(velocities[b], 3)
    velocity_a = add(load_vector(velocities[a], 0), cross(turn_a, arm))
    velocity_b = add(load_vector(velocities[b], 0), cross(turn_b, subtract(centre, origin)))
    return _Row(
        centre,
        rotate(attitude_a, load_vector(contact.axis, 0)),
        add(origin, rotate(attitude_b, load_vector(contact.point, 0))),
        rotate(attitude_b, load_vector(contact.direction, 0)),
        subtract(velocity_a, velocity_b),
        subtract(turn_a, turn_b),
    )


@inlined_kernel
def _penetration(contact, row, k):
    """Penetration, radius, normal and distance from the axis (inf for a plane) of sphere k, and its lever."""
    place = (k + 0.5) / contact.count - 0.5
    radius = contact.radius - 4.0 * contact.crown * place * place
    sphere = scale(contact.length * place, row.axis)
    offset = subtract(add(row.centre, sphere), row.point)
    along = dot(offset, row.direction)
    if contact.sign == 0.0:
        return radius - along, radius, row.direction, math.inf, sphere
    across = subtract(offset, scale(along, row.direction))
    distance = math.sqrt(dot(across, across)) + 1e-300
    depth = radius + contact.sign * (contact.surface_radius - distance)
    return depth, radius, scale(contact.sign / distance, across), distance, sphere


@inlined_kernel
def _touch(row, depth, radius, normal, distance, sphere):
    """Relative motion at the point of contact."""
    lever = subtract(sphere, scale(radius, normal))
    velocity = add(row.velocity, cross(row.rotation, lever))
    approach = -dot(velocity, normal)
    slip = add(velocity, scale(approach, normal))
    spin = dot(row.rotation, normal)
    roll = subtract(row.rotation, scale(spin, normal))
    return _Touch(
        depth, approach, normal, distance, lever, sphere,
        slip, math.sqrt(dot(slip, slip)), roll, math.sqrt(dot(roll, roll)), spin,
    )  # fmt: skip


@kernel
def contact_forces(contacts, positions, velocities, force, ledger, slips):
    """Add the forces and moments of all contacts, and their energies.

    Parameters
    ----------
    contacts
        Table of contacts.
    positions, velocities
        Shapes (body, 7) and (body, 6).
    force
        Receives forces and moments about the centres of mass, shape (body, 6).
    ledger
        Receives stored energy and lost powers (`tables.LEDGER`).
    slips
        Receives the slip vector of every sphere, zero without contact, shape (sphere, 3).
    """
    for i in range(contacts.size):
        contact = contacts[i]
        row = _row(contact, positions, velocities)
        total, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for k in range(contact.count):
            depth, radius, normal, distance, sphere = _penetration(contact, row, k)
            slot = slips[contact.first + k]
            if not depth > 0.0:
                slot[0], slot[1], slot[2] = 0.0, 0.0, 0.0
                continue
            t = _touch(row, depth, radius, normal, distance, sphere)
            slot[0], slot[1], slot[2] = t.slip
            elastic = laws.contact_force(contact.stiffness, contact.exponent, depth)
            load = elastic * laws.damping_factor(contact.damping, t.rate)
            drag = contact.sliding * load * laws.secant_slope(t.slip_speed, contact.sliding_transition)
            pull = subtract(scale(load, normal), scale(drag, t.slip))
            ledger[0] += laws.contact_energy(elastic, contact.exponent, depth)
            ledger[2] += drag * t.slip_speed * t.slip_speed
            ledger[5] += (load - elastic) * t.rate
            total, moment = add(total, pull), add(moment, cross(t.lever, pull))
            if contact.rolling > 0.0:
                resistance = laws.rolling_moment(contact.rolling, load, contact.lever)
                resistance *= laws.secant_slope(t.roll_speed, contact.rolling_transition)
                moment = subtract(moment, scale(resistance, t.roll))
                ledger[4] += resistance * t.roll_speed * t.roll_speed
            if contact.spinning > 0.0:
                brake = laws.spinning_moment(contact.spinning, load)
                brake *= laws.secant_slope(abs(t.spin), contact.spinning_transition) * t.spin
                moment = subtract(moment, scale(brake, normal))
                ledger[3] += brake * t.spin
        _apply(force, positions, contact.body_a, row.centre, total, moment, 1.0)
        _apply(force, positions, contact.body_b, row.centre, total, moment, -1.0)


@inlined_kernel
def _apply(force, positions, body, place, pull, moment, sign):
    """Add a force at a place, and a moment, to a body."""
    turned = add(moment, cross(subtract(place, load_vector(positions[body], 0)), pull))
    for d in range(3):
        force[body, d] += sign * pull[d]
        force[body, 3 + d] += sign * turned[d]


@inlined_kernel
def _add_at_levers(block, c, left, right):
    """Add [I; [left]x] C [I, -[right]x] to a 6 x 6 block, C in the first three columns of three rows of scratch c."""
    for i in range(3):
        c0, c1, c2 = c[i, 0], c[i, 1], c[i, 2]
        c[i, 3] = right[1] * c2 - right[2] * c1
        c[i, 4] = right[2] * c0 - right[0] * c2
        c[i, 5] = right[0] * c1 - right[1] * c0
    for j in range(6):
        x, y, z = c[0, j], c[1, j], c[2, j]
        block[0, j] += x
        block[1, j] += y
        block[2, j] += z
        block[3, j] += left[1] * z - left[2] * y
        block[4, j] += left[2] * x - left[0] * z
        block[5, j] += left[0] * y - left[1] * x


@inlined_kernel
def _slope(secant, magnitude, transition):
    """Slope of a friction law along the motion: the tangent, but not below a share of the secant."""
    chord = laws.secant_slope(magnitude, transition)
    return chord if secant == 1.0 else max(laws.tangent_slope(magnitude, transition), secant * chord)


@kernel
def _add_sphere(contact, row, k, secant, damping, stiffness, scratch):
    """Add the derivatives of one sphere's force by relative velocity and displacement, about the row's centre."""
    depth, radius, normal, distance, sphere = _penetration(contact, row, k)
    if not depth > 0.0:
        return
    t = _touch(row, depth, radius, normal, distance, sphere)
    elastic = laws.contact_force(contact.stiffness, contact.exponent, depth)
    factor = laws.damping_factor(contact.damping, t.rate)
    load = elastic * factor
    by_depth = contact.exponent * load / depth
    by_rate = elastic * contact.damping if factor > 0.0 else 0.0
    across = contact.sliding * load * laws.secant_slope(t.slip_speed, contact.sliding_transition)
    along = contact.sliding * load * _slope(secant, t.slip_speed, contact.sliding_transition)
    extra = (along - across) / max(t.slip_speed * t.slip_speed, 1e-300)
    # a change dN of the normal force changes the whole force by dN times this vector
    pull = subtract(normal, scale(across / load, t.slip)) if load > 0.0 else normal
    bend = load * contact.sign / distance if contact.sign != 0.0 else 0.0
    for i in range(3):
        for j in range(3):
            unit = 1.0 if i == j else 0.0
            tangent = unit - normal[i] * normal[j]
            scratch[0, i, j] = across * tangent + extra * t.slip[i] * t.slip[j] + by_rate * pull[i] * normal[j]
            scratch[1, i, j] = by_depth * pull[i] * normal[j] - bend * (tangent - row.direction[i] * row.direction[j])
    _add_at_levers(damping, scratch[0], t.lever, t.lever)
    _add_at_levers(stiffness, scratch[1], t.lever, t.sphere)
    if contact.rolling > 0.0 or contact.spinning > 0.0:
        resistance = laws.rolling_moment(contact.rolling, load, contact.lever)
        across = resistance * laws.secant_slope(t.roll_speed, contact.rolling_transition)
        along = resistance * _slope(secant, t.roll_speed, contact.rolling_transition)
        extra = (along - across) / max(t.roll_speed * t.roll_speed, 1e-300)
        spinning = laws.spinning_moment(contact.spinning, load)
        brake = spinning * _slope(secant, abs(t.spin), contact.spinning_transition)
        held = 4.0 / 3.0 * spinning * laws.secant_slope(abs(t.spin), contact.spinning_transition) * t.spin
        # a change dN of the normal force changes the moment by -dN times this vector
        by_load = scale(1.0 / load if load > 0.0 else 0.0, add(scale(across, t.roll), scale(held, normal)))
        turning = cross(t.lever, normal)
        for i in range(3):
            for j in range(3):
                unit = 1.0 if i == j else 0.0
                turned = across * (unit - normal[i] * normal[j]) + extra * t.roll[i] * t.roll[j]
                damping[3 + i, 3 + j] += turned + brake * normal[i] * normal[j] - by_rate * by_load[i] * turning[j]
                damping[3 + i, j] -= by_rate * by_load[i] * normal[j]
                stiffness[3 + i, j] -= by_depth * by_load[i] * normal[j]
                stiffness[3 + i, 3 + j] -= by_depth * by_load[i] * turning[j]


@kernel
def add_pair(matrix, pair, block, arm_a, arm_b, scratch):
    """Add a pair's 6 x 6 block, taken about a common place, to the four blocks of its bodies.

    Parameters
    ----------
    matrix
        Blocks of the scene, shape (block, 6, 6).
    pair
        Block numbers aa, ab, ba, bb, or -1.
    block
        Derivative by the relative motion at the place.
    arm_a, arm_b
        The place from the centres of mass.
    scratch
        Shape (2, 6, 6).
    """
    for side in range(4):
        if pair[side] < 0:
            continue
        left = arm_a if side < 2 else arm_b
        right = arm_a if side % 2 == 0 else arm_b
        sign = 1.0 if side == 0 or side == 3 else -1.0
        target = matrix[pair[side]]
        turned = scratch[0]
        for i in range(6):
            x, y, z = block[i, 0], block[i, 1], block[i, 2]
            turned[i, 0], turned[i, 1], turned[i, 2] = x, y, z
            turned[i, 3] = block[i, 3] + right[1] * z - right[2] * y
            turned[i, 4] = block[i, 4] + right[2] * x - right[0] * z
            turned[i, 5] = block[i, 5] + right[0] * y - right[1] * x
        for j in range(6):
            x, y, z = turned[0, j], turned[1, j], turned[2, j]
            target[0, j] += sign * x
            target[1, j] += sign * y
            target[2, j] += sign * z
            target[3, j] += sign * (turned[3, j] + left[1] * z - left[2] * y)
            target[4, j] += sign * (turned[4, j] + left[2] * x - left[0] * z)
            target[5, j] += sign * (turned[5, j] + left[0] * y - left[1] * x)


@kernel
def contact_matrices(contacts, positions, velocities, secant, dissipation, stiffness, scratch):
    """Add -dQ/dv and -dQ/dq of all contacts to the block matrices.

    Parameters
    ----------
    contacts, positions, velocities
        As in `contact_forces`.
    secant
        1 for the secant (lagged) slope of every friction law, 0 for its exact tangent, and between them the tangent but
        not less than this share of the secant.
    dissipation, stiffness
        Block matrices, shape (block, 6, 6).
    scratch
        Shape (8, 6, 6).

    Notes
    -----
    The turning of the normal with the body of the surface and the change of levers are left out of the stiffness.
    """
    for i in range(contacts.size):
        contact = contacts[i]
        row = _row(contact, positions, velocities)
        for side in range(2, 4):
            for r in range(6):
                for c in range(6):
                    scratch[side, r, c] = 0.0
        touches = False
        for k in range(contact.count):
            if _penetration(contact, row, k)[0] > 0.0:
                touches = True
                _add_sphere(contact, row, k, secant, scratch[2], scratch[3], scratch)
        if touches:
            arm_a = subtract(row.centre, load_vector(positions[contact.body_a], 0))
            arm_b = subtract(row.centre, load_vector(positions[contact.body_b], 0))
            add_pair(dissipation, contact.pair, scratch[2], arm_a, arm_b, scratch)
            add_pair(stiffness, contact.pair, scratch[3], arm_a, arm_b, scratch)


@kernel
def largest_penetration(contacts, sizes, positions, velocities):
    """Deepest penetration of all spheres, and the one that is the largest share of the size of its contact.

    Parameters
    ----------
    sizes
        Length that a contact's penetrations are small against, shape (contact,).

    Returns
    -------
    tuple
        The deepest penetration; the largest share, its penetration and the body that carries its sphere; zeros where
        nothing touches.
    """
    deepest, worst, depth_there, body = 0.0, 0.0, 0.0, 0
    for i in range(contacts.size):
        contact = contacts[i]
        row = _row(contact, positions, velocities)
        for k in range(contact.count):
            depth = _penetration(contact, row, k)[0]
            deepest = max(deepest, depth)
            if depth > worst * sizes[i]:
                worst, depth_there, body = depth / sizes[i], depth, contact.body_a
    return deepest, worst, depth_there, body
