"""Contact and friction between a row of spheres and a plane or cylinder: forces, and their derivatives.

With the penetration and the normal n of `sphere_contact_geometry`, at the sphere's surface act, on the sphere, with
slip v = v_rel - (v_rel n) n and relative angular velocity w = w_n n + w_t,

    f = N n - mu_s N (tanh(|v| / v_st) / |v|) v                                        (Eq. 2, 3)
    M = -mu_r N (D/2) (tanh(|w_t| / w_rt) / |w_t|) w_t - k N^(4/3) tanh(w_n / w_st) n  (Eq. 4, 6, 7)

and their opposites on the surface. One pass over the rows gives forces, energies and derivatives.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from tripod_doe.mechanics.arithmetic.rotations import add, cross, load_vector, scale, subtract
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, everywhere, pick, row, row_of_sums, select, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.forces.body_pairs import add_pair
from tripod_doe.mechanics.forces.sphere_contact_derivatives import add_derivatives
from tripod_doe.mechanics.forces.sphere_contact_geometry import (
    is_apart,
    motion_at_contacts,
    place_row,
    place_spheres,
    relative_motion,
    wrench_of,
)
from tripod_doe.mechanics.laws.contact import (
    contact_energy,
    contact_secant,
    damped_force,
    damped_stiffness,
    damping_slope,
)
from tripod_doe.mechanics.laws.friction import secant_slope
from tripod_doe.mechanics.laws.rolling import rolling_moment, spinning_lever


class _Load(NamedTuple):
    """Results of the laws: elastic force; normal force with slopes; secant slopes of friction over normal force."""

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
def _load(contact, spheres, motion):
    """Apply the laws."""
    factor, time = contact.damping, contact.damping_time
    secant = contact_secant(contact.stiffness, contact.exponent, spheres.depth)
    elastic, stiffness = secant * spheres.depth, contact.exponent * secant
    greased = time * stiffness * motion.rate
    normal = damped_force(elastic, factor * elastic * motion.rate, greased)
    by_depth = damped_stiffness(secant, contact.exponent, factor, greased, elastic, motion.rate)
    by_rate = factor * elastic + time * stiffness * damping_slope(elastic, greased)
    slip_speed = math.sqrt(motion.slip_t * motion.slip_t + motion.slip_b * motion.slip_b)
    roll, spin, roll_speed = _resistances(contact, normal, motion)
    return _Load(
        elastic,
        normal,
        select(normal > 0.0, by_depth, 0.0),
        select(normal > 0.0, by_rate, 0.0),
        contact.sliding * secant_slope(slip_speed, contact.sliding_transition),
        roll,
        spin,
        slip_speed,
        roll_speed,
    )


@inlined_kernel
def _resistances(contact, normal, motion):
    """Secant slopes of rolling and spinning friction per unit of normal force; zero in most rows."""
    roll = spin = speed = 0.0 * normal
    if contact.rolling > 0.0:
        speed = math.sqrt(motion.roll_t * motion.roll_t + motion.roll_b * motion.roll_b)
        resistance = rolling_moment(contact.rolling, 1.0, contact.lever)
        roll = resistance * secant_slope(speed, contact.rolling_transition)
    if contact.spinning > 0.0:
        lever = spinning_lever(contact.spinning, normal)
        spin = lever * secant_slope(abs(motion.spin), contact.spinning_transition)
    return roll, spin, speed


@inlined_kernel
def _forces(spheres, motion, acting):
    """Forces and moments of the spheres on their body."""
    n = acting.normal
    return wrench_of(
        spheres,
        n,
        -n * acting.slide * motion.slip_t,
        -n * acting.slide * motion.slip_b,
        -n * acting.spin * motion.spin,
        -n * acting.roll * motion.roll_t,
        -n * acting.roll * motion.roll_b,
    )


@inlined_kernel
def _add_powers(contact, spheres, motion, acting, powers):
    """Add the spheres' entries of the ledger to six lanes."""
    n, m = acting.normal, motion
    return (
        powers[0] + contact_energy(acting.elastic, contact.exponent, spheres.depth),
        powers[1],
        powers[2] + n * acting.slide * (m.slip_t * m.slip_t + m.slip_b * m.slip_b),
        powers[3] + n * acting.spin * m.spin * m.spin,
        powers[4] + n * acting.roll * (m.roll_t * m.roll_t + m.roll_b * m.roll_b),
        powers[5] + (n - acting.elastic) * m.rate,
    )


@inlined_kernel
def _store_slips(spheres, motion, slips):
    """Slip vectors, zero without contact."""
    touches = spheres.depth > 0.0
    slip_t, slip_b = select(touches, motion.slip_t, 0.0), select(touches, motion.slip_b, 0.0)
    x, y, z = add(scale(slip_t, spheres.tangent), scale(slip_b, spheres.binormal))
    store(slips, 0, x)
    store(slips, 1, y)
    store(slips, 2, z)


@kernel
def add_contacts(tables, work, first, last, positions, velocities, slopes, matrix):
    """Add the forces of contacts, their energies and, unless both factors are zero, their derivatives.

    Args:
        tables, work: The scene, and the memory of its run: `work.force` and `work.ledger` receive forces, energies and
            lost powers, `work.slip` the slips and `work.touching` whether any may differ from zero.
        first, last: The requested range of the table of contacts.
        positions, velocities: Shapes (body, 7) and (body, 6).
        slopes: Which derivatives are wanted (`tables.Slopes`).
        matrix: Receives by_velocity D + by_position K, shape (block, 6, 8).

    K does not include rotation of the normal with the surface's body and of friction with the normal.
    """
    contacts, touching, slips = tables.contacts, work.touching, work.slip
    linear, block = slopes.by_velocity != 0.0 or slopes.by_position != 0.0, work.pair[0]
    nothing = row(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    powers = nothing, nothing, nothing, nothing, nothing, nothing
    for i in range(first, last):
        contact = contacts[i]
        place = place_row(contact, positions)
        if touching[i, 0] != 0:
            touching[i, 0] = 0
            for group in range(contact.first, contact.first + contact.groups):
                for d in range(3):
                    store(slips[group], d, nothing)
        if is_apart(contact, place):
            continue
        total = nothing
        for group in range(contact.groups):
            spheres = place_spheres(contact, place, group)
            if everywhere(spheres.depth <= 0.0):
                continue
            velocity, turn = relative_motion(contact, place, positions, velocities)
            if linear and touching[i, 0] == 0:
                for r in range(6):
                    store(block, r, nothing)
            touching[i, 0] = 1
            motion = motion_at_contacts(spheres, velocity, turn)
            acting = _load(contact, spheres, motion)
            _store_slips(spheres, motion, slips[contact.first + group])
            total = total + row_of_sums(*_forces(spheres, motion, acting))
            powers = _add_powers(contact, spheres, motion, acting, powers)
            if linear:
                add_derivatives(contact, spheres, motion, acting, slopes, block)
        if touching[i, 0] == 0:
            continue
        _apply(work.force, positions, contact, place.centre, total)
        if linear:
            arm_a = subtract(place.centre, load_vector(positions[contact.body_a], 0))
            arm_b = subtract(place.centre, load_vector(positions[contact.body_b], 0))
            add_pair(matrix, contact.pair, block, arm_a, arm_b)
    sums = row_of_sums(*powers)
    for entry in range(work.ledger.size):
        work.ledger[entry] += pick(sums, entry)


@inlined_kernel
def _apply(force, positions, contact, place, wrench):
    """Add a force at a place, and a moment, to the body of the spheres, and the opposite to the body of the surface."""
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

    Args:
        sizes: Reference length of each contact's penetration, shape (contact,).
        positions: Shape (state, body, 7).

    Returns:
        The deepest penetration; the largest share, its penetration, the body that carries its sphere, and the state;
        zeros where nothing touches.
    """
    deepest, worst, depth_there, body, state = 0.0, 0.0, 0.0, 0, 0
    for n in range(positions.shape[0]):
        for i in range(contacts.size):
            contact = contacts[i]
            place = place_row(contact, positions[n])
            for group in range(contact.groups):
                depths = place_spheres(contact, place, group).depth
                for k in range(WIDTH):
                    depth = pick(depths, k)
                    deepest = max(deepest, depth)
                    if depth > worst * sizes[i]:
                        worst, depth_there, body, state = depth / sizes[i], depth, contact.body_a, n
    return deepest, worst, depth_there, body, state
