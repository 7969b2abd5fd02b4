"""A row of spheres at a plane or cylinder: penetrations, directions, relative motion, and forces taken to its centre.

For a sphere of radius r whose centre lies at the distance rho from a plane or from the axis of a cylinder of radius R,
the penetration is r - rho (plane), r + R - rho (convex) or r - R + rho (concave); n is the normal from the surface to
the sphere. The point of contact is on the undeformed sphere: taken in the middle of the overlap, a needle that is
loaded unevenly along its length would roll like a cone and yaw.

The spheres of a row are treated eight at a time (`simd_lanes`), in directions of their own: the normal n, the tangent t
around the surface, and b along it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from tripod_doe.mechanics.arithmetic.rotations import (
    add,
    cross,
    dot,
    load_attitude,
    load_vector,
    rotate,
    scale,
    subtract,
)
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, ramp, select
from tripod_doe.mechanics.compilation.kernels import inlined_kernel


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
    """Up to eight spheres of a row: penetration (0 without contact), radius, how the normal turns, and directions."""

    depth: Any
    radius: Any
    curvature: Any
    normal: Any
    tangent: Any
    binormal: Any
    arm: Any


class _Motion(NamedTuple):
    """Relative motion at the points of contact, in the spheres' own directions."""

    rate: Any
    slip_t: Any
    slip_b: Any
    spin: Any
    roll_t: Any
    roll_b: Any


@inlined_kernel
def place_row(contact, positions):
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
def is_apart(contact, place):
    """Whether no sphere of the row can touch, from the smallest possible distance of its ends from the surface."""
    reach = 0.5 * contact.length
    if contact.sign == 0.0:
        clearance = place.height - reach * abs(place.lean)
    else:
        clearance = contact.sign * (math.sqrt(dot(place.toward, place.toward)) - contact.surface_radius)
        clearance -= reach * math.sqrt(dot(place.drift, place.drift))
    return not clearance < contact.radius


@inlined_kernel
def relative_motion(contact, place, positions, velocities):
    """Velocity of the row's centre, and angular velocity, of its body against the surface's."""
    a, b = contact.body_a, contact.body_b
    turn_a, turn_b = load_vector(velocities[a], 3), load_vector(velocities[b], 3)
    arm_a = subtract(place.centre, load_vector(positions[a], 0))
    arm_b = subtract(place.centre, load_vector(positions[b], 0))
    velocity_a = add(load_vector(velocities[a], 0), cross(turn_a, arm_a))
    velocity_b = add(load_vector(velocities[b], 0), cross(turn_b, arm_b))
    return subtract(velocity_a, velocity_b), subtract(turn_a, turn_b)


@inlined_kernel
def place_spheres(contact, place, group):
    """Geometry of one group of eight spheres."""
    number = ramp(float(WIDTH * group))
    share = (number - 0.5 * (contact.count - 1)) * (1.0 / contact.count)
    radius = contact.radius - 4.0 * contact.crown * share * share
    station = contact.length * share
    outward = add(place.toward, scale(station, place.drift))
    distance = math.sqrt(dot(outward, outward) + 1e-300)
    closeness = 1.0 / distance
    if contact.sign == 0.0:
        height, facing = place.height + station * place.lean, 1.0
    else:
        height, facing = contact.sign * (distance - contact.surface_radius), contact.sign
    depth = select(number < contact.count, max(radius - height, 0.0), 0.0)
    normal = scale(facing * closeness, outward)
    tangent = cross(place.binormal, normal)
    return _Spheres(
        depth, radius, contact.sign * closeness, normal, tangent, place.binormal, scale(station, place.axis)
    )


@inlined_kernel
def motion_at_contacts(spheres, velocity, turn):
    """Relative motion of spheres, of the row's velocity and angular velocity against the surface."""
    moving = add(velocity, cross(turn, spheres.arm))
    roll_t, roll_b = dot(turn, spheres.tangent), dot(turn, spheres.binormal)
    return _Motion(
        -dot(moving, spheres.normal),
        dot(moving, spheres.tangent) - spheres.radius * roll_b,
        dot(moving, spheres.binormal) + spheres.radius * roll_t,
        dot(turn, spheres.normal),
        roll_t,
        roll_b,
    )


@inlined_kernel
def wrench_of(spheres, normal, t, b, twist, about_t, about_b):
    """Force, and moment about the row's centre, of forces and moments at the points of contact: six lanes."""
    force = add(scale(normal, spheres.normal), add(scale(t, spheres.tangent), scale(b, spheres.binormal)))
    turned = cross(spheres.arm, force)
    moment = add(
        scale(twist, spheres.normal),
        add(
            scale(spheres.radius * b + about_t, spheres.tangent), scale(about_b - spheres.radius * t, spheres.binormal)
        ),
    )
    return six(force, add(turned, moment))


@inlined_kernel
def six(a, b):
    """Six numbers of two vectors."""
    return (a[0], a[1], a[2], b[0], b[1], b[2])
