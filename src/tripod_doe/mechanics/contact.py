"""Contact and friction between a row of spheres and a plane or cylinder: forces, and their derivatives.

For a sphere of radius r whose centre lies at the distance rho from a plane or from the axis of a cylinder of radius R,
the penetration is r - rho (plane), r + R - rho (convex) or r - R + rho (concave); n is the normal from the surface to
the sphere. At the sphere's surface act, on the sphere, with slip v = v_rel - (v_rel n) n and relative angular
velocity w = w_n n + w_t,

    f = N n - mu_s N (tanh(|v| / v_st) / |v|) v                                        (Eq. 2, 3)
    M = -mu_r N (D/2) (tanh(|w_t| / w_rt) / |w_t|) w_t - k N^(4/3) tanh(w_n / w_st) n  (Eq. 4, 6, 7)

and their opposites on the surface. The point of contact is on the undeformed sphere: taken in the middle of the
overlap, a needle that is loaded unevenly along its length would roll like a cone and yaw.

The spheres of a row go through the laws eight at a time (`lanes`), in directions of their own: the normal n, the
tangent t around the surface, and b along it. One pass gives forces, energies and derivatives.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from tripod_doe.mechanics import laws
from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.lanes import WIDTH, load, pick, ramp, row, row_of_sums, select, store
from tripod_doe.mechanics.pairs import add_pair
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

__all__ = ["add_contacts", "largest_penetration"]


class _Row(NamedTuple):
    """A row and its surface in world axes, seen from the surface.

    Sphere s along the row is at the height `height + s lean` over a plane, or along the axis of a cylinder, and in the
    direction `toward + s drift` from that axis; on a plane that direction is the normal.
    """

    centre: Any
    axis: Any
    height: Any
    lean: Any
    toward: Any
    drift: Any
    binormal: Any


class _Spheres(NamedTuple):
    """Up to eight spheres of a row: penetration (0 without contact), radius, place along the row, and directions."""

    depth: Any
    radius: Any
    station: Any
    distance: Any
    normal: Any
    tangent: Any
    binormal: Any
    arm: Any


class _Motion(NamedTuple):
    """Relative motion at the points of contact, in the spheres' own directions."""

    rate: Any
    swing: Any
    slip_t: Any
    slip_b: Any
    spin: Any
    roll_t: Any
    roll_b: Any


class _Load(NamedTuple):
    """What the laws say: elastic force, normal force and its slopes; secant slopes of friction per unit of it."""

    elastic: Any
    normal: Any
    by_depth: Any
    by_rate: Any
    slide: Any
    roll: Any
    spin: Any
    slip_speed: Any
    roll_speed: Any


@inlined_kernel
def _row(contact, positions):
    """Place a row in the world."""
    a, b = contact.body_a, contact.body_b
    attitude_a, attitude_b = load_attitude(positions[a]), load_attitude(positions[b])
    centre = add(load_vector(positions[a], 0), rotate(attitude_a, load_vector(contact.centre, 0)))
    axis = rotate(attitude_a, load_vector(contact.axis, 0))
    point = add(load_vector(positions[b], 0), rotate(attitude_b, load_vector(contact.point, 0)))
    direction = rotate(attitude_b, load_vector(contact.direction, 0))
    offset = subtract(centre, point)
    height, lean = dot(offset, direction), dot(axis, direction)
    if contact.sign == 0.0:
        across = rotate(attitude_b, load_vector(contact.across, 0))
        return _Row(centre, axis, height, lean, direction, (0.0, 0.0, 0.0), across)
    toward = subtract(offset, scale(height, direction))
    return _Row(centre, axis, height, lean, toward, subtract(axis, scale(lean, direction)), direction)


@inlined_kernel
def _is_apart(contact, place):
    """Whether no sphere of the row can touch, by the nearest that an end of it may be to the surface."""
    reach = 0.5 * contact.length
    if contact.sign == 0.0:
        clearance = place.height - reach * abs(place.lean)
    else:
        clearance = contact.sign * (math.sqrt(dot(place.toward, place.toward)) - contact.surface_radius)
        clearance -= reach * math.sqrt(dot(place.drift, place.drift))
    return not clearance < contact.radius


@inlined_kernel
def _spheres(contact, place, group):
    """Geometry of one group of eight spheres."""
    number = ramp(float(WIDTH * group))
    share = (number + 0.5) / contact.count - 0.5
    radius = contact.radius - 4.0 * contact.crown * share * share
    station = contact.length * share
    outward = add(place.toward, scale(station, place.drift))
    distance = math.sqrt(dot(outward, outward) + 1e-300)
    if contact.sign == 0.0:
        height, facing = place.height + station * place.lean, 1.0
    else:
        height, facing = contact.sign * (distance - contact.surface_radius), contact.sign
    depth = select(number < contact.count, max(radius - height, 0.0), 0.0)
    normal = scale(facing / distance, outward)
    tangent = cross(place.binormal, normal)
    return _Spheres(
        depth, radius, station, distance, normal, tangent, place.binormal, scale(station, place.axis)
    )  # fmt: skip


@inlined_kernel
def _motion(spheres, velocity, turn):
    """Relative motion of spheres, of the row's velocity and angular velocity against the surface."""
    moving = add(velocity, cross(turn, spheres.arm))
    roll_t, roll_b = dot(turn, spheres.tangent), dot(turn, spheres.binormal)
    swing = dot(moving, spheres.tangent)
    return _Motion(
        -dot(moving, spheres.normal), swing, swing - spheres.radius * roll_b,
        dot(moving, spheres.binormal) + spheres.radius * roll_t, dot(turn, spheres.normal), roll_t, roll_b,
    )  # fmt: skip


@inlined_kernel
def _load(contact, spheres, motion):
    """Apply the laws."""
    stiffness = laws.contact_secant(contact.stiffness, contact.exponent, spheres.depth)
    elastic = stiffness * spheres.depth
    factor = laws.damping_factor(contact.damping, motion.rate)
    normal = elastic * factor
    slip_speed = math.sqrt(motion.slip_t * motion.slip_t + motion.slip_b * motion.slip_b)
    roll_speed = math.sqrt(motion.roll_t * motion.roll_t + motion.roll_b * motion.roll_b)
    resistance = laws.rolling_moment(contact.rolling, 1.0, contact.lever)
    brake = laws.spinning_moment(contact.spinning, normal) / max(normal, 1e-300)
    return _Load(
        elastic, normal, contact.exponent * stiffness * factor,
        select(factor > 0.0, contact.damping * elastic, 0.0),
        contact.sliding * laws.secant_slope(slip_speed, contact.sliding_transition),
        resistance * laws.secant_slope(roll_speed, contact.rolling_transition),
        brake * laws.secant_slope(abs(motion.spin), contact.spinning_transition),
        slip_speed, roll_speed,
    )  # fmt: skip


@inlined_kernel
def _wrench(spheres, normal, t, b, twist, about_t, about_b):
    """Force, and moment about the row's centre, of forces and moments at the points of contact: six lanes."""
    force = add(scale(normal, spheres.normal), add(scale(t, spheres.tangent), scale(b, spheres.binormal)))
    turned = cross(spheres.arm, force)
    moment = add(
        scale(twist, spheres.normal),
        add(scale(spheres.radius * b + about_t, spheres.tangent),
            scale(about_b - spheres.radius * t, spheres.binormal)),
    )  # fmt: skip
    return _six(force, add(turned, moment))


@inlined_kernel
def _forces(spheres, motion, acting):
    """Forces and moments of the spheres on their body."""
    n = acting.normal
    return _wrench(
        spheres, n, -n * acting.slide * motion.slip_t, -n * acting.slide * motion.slip_b,
        -n * acting.spin * motion.spin, -n * acting.roll * motion.roll_t, -n * acting.roll * motion.roll_b,
    )  # fmt: skip


@inlined_kernel
def _powers(contact, spheres, motion, acting):
    """Entries of the ledger, summed over the spheres."""
    n, m = acting.normal, motion
    return row_of_sums(
        laws.contact_energy(acting.elastic, contact.exponent, spheres.depth), 0.0 * n,
        n * acting.slide * (m.slip_t * m.slip_t + m.slip_b * m.slip_b), n * acting.spin * m.spin * m.spin,
        n * acting.roll * (m.roll_t * m.roll_t + m.roll_b * m.roll_b), (n - acting.elastic) * m.rate,
    )  # fmt: skip


@inlined_kernel
def _store_slips(spheres, motion, slips):
    """Slip vectors, zero without contact."""
    touches = spheres.depth > 0.0
    slip_t, slip_b = select(touches, motion.slip_t, 0.0), select(touches, motion.slip_b, 0.0)
    x, y, z = add(scale(slip_t, spheres.tangent), scale(slip_b, spheres.binormal))
    store(slips, 0, x)
    store(slips, 1, y)
    store(slips, 2, z)


@inlined_kernel
def _slopes(coefficient, secant, speed, transition, x, y):
    """Symmetric slopes of a friction law by two components x, y: its chord across them, along them `_slope`."""
    across = coefficient * laws.secant_slope(speed, transition)
    extra = (_slope(coefficient, secant, speed, transition) - across) / max(speed * speed, 1e-300)
    return across + extra * x * x, extra * x * y, across + extra * y * y


@inlined_kernel
def _slope(coefficient, secant, speed, transition):
    """Slope of a friction law along the motion: the tangent, but not below a share of the secant."""
    chord = laws.secant_slope(speed, transition)
    return coefficient * max(laws.tangent_slope(speed, transition), secant * chord)


@inlined_kernel
def _six(a, b):
    """Six numbers of two vectors."""
    return (a[0], a[1], a[2], b[0], b[1], b[2])


@inlined_kernel
def _twist(spheres, d, twists):
    """Row d of the change of moment by change of angular velocity that friction against turning gives."""
    of_t, of_b = scale(spheres.tangent[d], twists[0]), scale(spheres.binormal[d], twists[1])
    return add(add(of_t, of_b), scale(spheres.normal[d], twists[2]))


@inlined_kernel
def _mix(p, a, q, b):
    """Two multiples of six lanes each, p a + q b."""
    return (
        p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2],
        p * a[3] + q * b[3], p * a[4] + q * b[4], p * a[5] + q * b[5],
    )  # fmt: skip


@inlined_kernel
def _sums(a, b, c, x, y, z, twist):
    """One row of a x + b y + c z, summed over the spheres, with three more for the rotations."""
    return row_of_sums(
        a * x[0] + b * y[0] + c * z[0], a * x[1] + b * y[1] + c * z[1], a * x[2] + b * y[2] + c * z[2],
        a * x[3] + b * y[3] + c * z[3] + twist[0], a * x[4] + b * y[4] + c * z[4] + twist[1],
        a * x[5] + b * y[5] + c * z[5] + twist[2],
    )  # fmt: skip


@inlined_kernel
def _add_derivatives(contact, spheres, motion, acting, slopes, block):
    """Add by_velocity times -dQ/dv and by_position times -dQ/dq about the row's centre; return K times the motion.

    Every sphere gives three dyads of a change of force by a change of motion: by penetration and its rate, and by the
    motion along the two tangents.
    """
    s, m, n = spheres, motion, acting.normal
    secant, by_velocity, by_position = slopes
    # a change dN of the normal force changes the whole wrench by dN times `pull`
    pull = _wrench(
        s, 1.0, -acting.slide * m.slip_t, -acting.slide * m.slip_b,
        (-4.0 / 3.0) * acting.spin * m.spin, -acting.roll * m.roll_t, -acting.roll * m.roll_b,
    )  # fmt: skip
    inward, turned, shifted = cross(s.arm, s.normal), cross(s.arm, s.tangent), cross(s.arm, s.binormal)
    across = _six(s.tangent, subtract(turned, scale(s.radius, s.binormal)))
    along = _six(s.binormal, add(shifted, scale(s.radius, s.tangent)))
    # the normal turns as the sphere moves around a cylinder
    bend = n * contact.sign / s.distance
    drop, swing = -acting.by_depth * m.rate, -bend * m.swing
    tt, tb, bb = _slopes(contact.sliding, secant, acting.slip_speed, contact.sliding_transition, m.slip_t, m.slip_b)
    damped = by_velocity * n
    tt, tb, bb = damped * tt, damped * tb, damped * bb
    x, y = _mix(tt, across, tb, along), _mix(tb, across, bb, along)
    curl = -by_position * bend
    x = _mix(1.0, x, curl, _six(s.tangent, turned))
    press = by_velocity * acting.by_rate + by_position * acting.by_depth
    z = _six(scale(press, s.normal), scale(press, inward))
    resistance = laws.rolling_moment(contact.rolling, 1.0, contact.lever)
    tt, tb, bb = _slopes(resistance, secant, acting.roll_speed, contact.rolling_transition, m.roll_t, m.roll_b)
    tt, tb, bb = damped * tt, damped * tb, damped * bb
    nn = by_velocity * _slope(
        laws.spinning_moment(contact.spinning, n), secant, abs(m.spin), contact.spinning_transition
    )
    twist_t = add(scale(tt, s.tangent), scale(tb, s.binormal))
    twist_b = add(scale(tb, s.tangent), scale(bb, s.binormal))
    twist_n = scale(nn, s.normal)
    still = (0.0, 0.0, 0.0)
    store(block, 0, load(block, 0) + _sums(across[0], along[0], pull[0], x, y, z, still))
    store(block, 1, load(block, 1) + _sums(across[1], along[1], pull[1], x, y, z, still))
    store(block, 2, load(block, 2) + _sums(across[2], along[2], pull[2], x, y, z, still))
    twists = (twist_t, twist_b, twist_n)
    store(block, 3, load(block, 3) + _sums(across[3], along[3], pull[3], x, y, z, _twist(s, 0, twists)))
    store(block, 4, load(block, 4) + _sums(across[4], along[4], pull[4], x, y, z, _twist(s, 1, twists)))
    store(block, 5, load(block, 5) + _sums(across[5], along[5], pull[5], x, y, z, _twist(s, 2, twists)))
    return _mix(drop, pull, swing, across)


@kernel
def add_contacts(tables, work, first, last, positions, velocities, slopes, matrix):
    """Add the forces of contacts, their energies and, unless both factors are zero, their derivatives.

    Parameters
    ----------
    tables, work
        The scene, and the memory of its run: `work.force` and `work.ledger` receive forces, energies and lost powers,
        `work.slip` the slips and `work.touching` whether any may differ from zero, `work.drift` K times the velocities.
    first, last
        The range of the table of contacts that is wanted.
    positions, velocities
        Shapes (body, 7) and (body, 6).
    slopes
        Which derivatives are wanted (`tables.Slopes`).
    matrix
        Receives by_velocity D + by_position K, shape (block, 6, 8).

    Notes
    -----
    The turning of the normal with the body of the surface and the change of levers are left out of K.
    """
    contacts, touching, slips = tables.contacts, work.touching, work.slip
    linear, block = slopes.by_velocity != 0.0 or slopes.by_position != 0.0, work.pair[0]
    nothing = row(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    powers = nothing
    for i in range(first, last):
        contact = contacts[i]
        place = _row(contact, positions)
        if _is_apart(contact, place):
            if touching[i, 0] != 0:
                touching[i, 0] = 0
                for group in range(contact.first, contact.first + contact.groups):
                    for d in range(3):
                        store(slips[group], d, nothing)
            continue
        touching[i, 0] = 1
        velocity, turn = _relative_motion(contact, place, positions, velocities)
        total, falling = nothing, nothing
        if linear:
            for r in range(6):
                store(block, r, nothing)
        for group in range(contact.groups):
            spheres = _spheres(contact, place, group)
            motion = _motion(spheres, velocity, turn)
            acting = _load(contact, spheres, motion)
            _store_slips(spheres, motion, slips[contact.first + group])
            total = total + row_of_sums(*_forces(spheres, motion, acting))
            powers = powers + _powers(contact, spheres, motion, acting)
            if linear:
                falling = falling + row_of_sums(*_add_derivatives(contact, spheres, motion, acting, slopes, block))
        _apply(work.force, positions, contact, place.centre, total)
        if linear:
            _apply(work.drift, positions, contact, place.centre, falling)
            arm_a = subtract(place.centre, load_vector(positions[contact.body_a], 0))
            arm_b = subtract(place.centre, load_vector(positions[contact.body_b], 0))
            add_pair(matrix, contact.pair, block, arm_a, arm_b)
    for entry in range(work.ledger.size):
        work.ledger[entry] += pick(powers, entry)


@inlined_kernel
def _relative_motion(contact, place, positions, velocities):
    """Velocity of the row's centre, and angular velocity, of its body against the surface's."""
    a, b = contact.body_a, contact.body_b
    turn_a, turn_b = load_vector(velocities[a], 3), load_vector(velocities[b], 3)
    arm_a = subtract(place.centre, load_vector(positions[a], 0))
    arm_b = subtract(place.centre, load_vector(positions[b], 0))
    velocity_a = add(load_vector(velocities[a], 0), cross(turn_a, arm_a))
    velocity_b = add(load_vector(velocities[b], 0), cross(turn_b, arm_b))
    return subtract(velocity_a, velocity_b), subtract(turn_a, turn_b)


@inlined_kernel
def _apply(force, positions, contact, place, wrench):
    """Add a force at a place, and a moment, to the body of the spheres, and its opposite to that of the surface."""
    pull = (pick(wrench, 0), pick(wrench, 1), pick(wrench, 2))
    moment = (pick(wrench, 3), pick(wrench, 4), pick(wrench, 5))
    for body, sign in ((contact.body_a, 1.0), (contact.body_b, -1.0)):
        turned = add(moment, cross(subtract(place, load_vector(positions[body], 0)), pull))
        for d in range(3):
            force[body, d] += sign * pull[d]
            force[body, 3 + d] += sign * turned[d]


@kernel
def largest_penetration(contacts, sizes, positions):
    """Deepest penetration of all spheres in some states, and the one that is the largest share of its contact's size.

    Parameters
    ----------
    sizes
        Length that a contact's penetrations are small against, shape (contact,).
    positions
        Shape (state, body, 7).

    Returns
    -------
    tuple
        The deepest penetration; the largest share, its penetration, the body that carries its sphere, and the state;
        zeros where nothing touches.
    """
    deepest, worst, depth_there, body, state = 0.0, 0.0, 0.0, 0, 0
    for n in range(positions.shape[0]):
        for i in range(contacts.size):
            contact = contacts[i]
            place = _row(contact, positions[n])
            for group in range(contact.groups):
                depths = _spheres(contact, place, group).depth
                for k in range(WIDTH):
                    depth = pick(depths, k)
                    deepest = max(deepest, depth)
                    if depth > worst * sizes[i]:
                        worst, depth_there, body, state = depth / sizes[i], depth, contact.body_a, n
    return deepest, worst, depth_there, body, state
