"""The joint as a scene of rigid bodies: the paper's 2.3 and 2.4, described in axes that turn with the housing.

The housing turns at constant speed and is held in all else, so in these axes it is the ground, and bodies feel Coriolis
and centrifugal forces. A body "space" turns back at the same rate and carries what stands still: the output shaft in
its bearing and the pivot of the outboard joint. Degrees of freedom are the paper's: 6 a roller and needle, 2 the
intermediate shaft, 1 the output shaft.

    shaft    spider, trunnions and intermediate shaft: one rod. Pivots on the outboard universal joint.
    output   turns about its axis, inertia J, load torque against the rotation.
    roller k sphere of radius R_s in groove k, a cylinder of radius R_g.
    needle   N_s spheres against trunnion, bore and next needle, and its ends against flange and retainer (2.3.2).

Needles start at rest against their trunnion but for rolling, in the middle of the gap, skewed; the trunnions start
behind the grooves by clearances and penetrations under the mean load |T| / (3 R_p), so that nothing is thrown.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.joint.derived_constants.roller_inertia import roller_inertia
from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES, Pose
from tripod_doe.joint.multibody.needle_bearing import lumped_bearing, needle_body, needle_contacts
from tripod_doe.joint.multibody.scene_constants import DerivedConstants, derive_constants, moving_body, vector
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.scene import (
    GROUND,
    Body,
    Constraint,
    Cylinder,
    NeedleBearing,
    PointInPlane,
    Revolute,
    Scene,
    SphereRow,
    Universal,
)

_GROOVE_EXPONENT = 1.5
_Z = np.array([0.0, 0.0, 1.0])


def _shafts(derived: DerivedConstants) -> tuple[list[Body], list[Constraint]]:
    """Intermediate shaft, output shaft, and what stands still in space; with their constraints."""
    values, initial = derived.values, derived.initial
    mass, length, inertia = values.shaft_mass, values.shaft_length, values.output_inertia
    radius_squared = mass / (values.density * math.pi * length)
    across = mass * (length**2 / 12 + radius_squared / 4)
    arm = initial.shaft.attitude.apply(-derived.spider_in_shaft)
    middle = Pose(
        initial.shaft.position + arm,
        initial.shaft.attitude,
        initial.shaft.velocity + np.cross(initial.shaft.rotation, arm),
        initial.shaft.rotation,
    )
    end = initial.output.position
    axis = initial.output.attitude.apply(_Z)
    speed = values.speed
    bodies = [
        moving_body("shaft", mass, (across, across, mass * radius_squared / 2), middle),
        moving_body("output", mass, (inertia, inertia, inertia), initial.output, own_moment=(0.0, 0.0, -values.torque)),
        Body("space", mass, (inertia, inertia, inertia), angular_velocity=(0.0, 0.0, -speed), locked=(True,) * 6),
    ]
    half = vector(-derived.spider_in_shaft)
    constraints: list[Constraint] = [
        Revolute("space", "output", vector(end), axis_a=vector(axis)),
        Universal("output", "shaft", point_b=half, axis_a=(0.0, 1.0, 0.0), axis_b=(1.0, 0.0, 0.0)),
    ]
    return bodies, constraints


def _roller(derived: DerivedConstants, k: int) -> tuple[Body, SphereRow]:
    """Roller k, rolling along its groove, and its contact with the groove."""
    values, pose = derived.values, derived.initial.rollers[k]
    radius = values.roller_radius
    mass, polar, across = (
        float(x) for x in roller_inertia(*np.array([radius, values.roller_width, values.bore_radius, values.density]))
    )
    trunnion = pose.attitude.apply(_Z)
    flank = derived.side * np.array([-math.sin(GROOVE_ANGLES[k]), math.cos(GROOVE_ANGLES[k]), 0.0])
    along = np.array(
        [flank[1], -flank[0]]
    )  # times a turn's first two components: motion along the groove, at the flank
    # its spin on the trunnion takes the slip along the groove to zero
    spin = (pose.velocity[2] / radius - pose.rotation[:2] @ along) / (trunnion[:2] @ along)
    ahead = (values.bearing_radial_clearance + 2 * derived.needle_load) * flank  # of its trunnion
    rolling = Pose(pose.position + ahead, pose.attitude, pose.velocity, pose.rotation + spin * trunnion)
    body = moving_body(f"roller {k + 1}", mass, (across, across, polar), rolling)
    pitch = values.pitch_radius
    groove = Cylinder(
        GROUND,
        values.groove_radius,
        axis=(0.0, 0.0, 1.0),
        concave=True,
        point=(pitch * math.cos(GROOVE_ANGLES[k]), pitch * math.sin(GROOVE_ANGLES[k]), 0.0),
    )
    contact = SphereRow(
        body.name,
        groove,
        radius,
        values.groove_stiffness,
        _GROOVE_EXPONENT,
        damping=values.contact_damping,
        damping_time=values.contact_damping_time,
        friction=derived.groove,
    )
    return body, contact


def build_joint(values: JointValues[float], needles: bool) -> Scene:
    """Scene of the joint at one operating point.

    Args:
        needles: Whether every needle is a body (model ``needles``), or each bearing one element (model ``rollers``).

    Returns:
        Contacts of the rollers with grooves 1, 2, 3 are the last three.
    """
    derived = derive_constants(values)
    bodies, constraints = _shafts(derived)
    rollers = [_roller(derived, k) for k in range(3)]
    rings = [_ring(derived, k, rollers[k][0]) for k in range(3)] if needles else []
    return _turning_scene(
        values,
        bodies,
        rollers,
        rings,
        constraints,
        () if needles else tuple(lumped_bearing(derived, k) for k in range(3)),
    )


def build_trunnion(values: JointValues[float]) -> Scene:
    """Scene of trunnion 1, its needles, its roller and its groove, at one operating point of the joint.

    Trunnions 2 and 3 are guided without friction: a body of a roller's mass slides along the line in which the roller
    would roll, and stays on its trunnion. So the spider moves as in the joint, and trunnion 1 carries its third of the
    torque, |T| / (3 R_p).

    Returns:
        The contact of the roller with its groove is the last one.
    """
    derived = derive_constants(values)
    bodies, constraints = _shafts(derived)
    roller = _roller(derived, 0)
    for k in (1, 2):
        guide, planes = _guide(derived, k, roller[0])
        bodies.append(guide)
        constraints.extend(planes)
    return _turning_scene(values, bodies, [roller], [_ring(derived, 0, roller[0])], constraints)


def _guide(derived: DerivedConstants, k: int, roller: Body) -> tuple[Body, list[Constraint]]:
    """A slider along groove k and the planes of the shaft that keep it on trunnion k."""
    pose, axis = derived.initial.rollers[k], derived.trunnion_axis(k)
    body = Body(
        f"guide {k + 1}",
        roller.mass,
        roller.inertia,
        vector(pose.position),
        velocity=vector(pose.velocity),
        locked=(True, True, False, True, True, True),
    )
    spider = vector(derived.spider_in_shaft)
    normals = (_Z, np.cross(_Z, axis))
    return body, [PointInPlane("shaft", body.name, spider, normal_a=vector(normal)) for normal in normals]


def _ring(derived: DerivedConstants, k: int, roller: Body) -> tuple[list[Body], list[SphereRow]]:
    """All needles of trunnion k, and their contacts."""
    numbers = range(int(derived.values.needle_count))
    contacts = [contact for j in numbers for contact in needle_contacts(derived, k, j)]
    return [needle_body(derived, k, j, roller) for j in numbers], contacts


def _turning_scene(
    values: JointValues[float],
    bodies: list[Body],
    rollers: list[tuple[Body, SphereRow]],
    rings: list[tuple[list[Body], list[SphereRow]]],
    constraints: list[Constraint],
    bearings: tuple[NeedleBearing, ...] = (),
) -> Scene:
    """All parts as one scene in axes that turn with the housing; the contacts with the grooves come last."""
    speed = values.speed
    return Scene(
        (*bodies, *(body for body, _ in rollers), *(body for ring, _ in rings for body in ring)),
        (*(contact for _, contacts in rings for contact in contacts), *(contact for _, contact in rollers)),
        bearings=bearings,
        constraints=tuple(constraints),
        frame=(0.0, 0.0, speed),
        core=tuple(body.name for body, _ in rollers),
        length_scale=0.1,
        speed_scale=values.pitch_radius * speed * math.tan(values.joint_angle) + 1.0,
        rotation_scale=speed,
        time_scale=1 / speed,
    )
