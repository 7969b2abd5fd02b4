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
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tripod_doe.joint.contact import bearing_load_zone, contact_constants
from tripod_doe.joint.posture import GROOVE_ANGLES, Pose, Posture, joint_posture
from tripod_doe.joint.transition import transition_velocities
from tripod_doe.mechanics.scene import (
    GROUND,
    Body,
    Cylinder,
    Friction,
    Plane,
    PrescribedRotation,
    Revolute,
    Scene,
    SphereRow,
    Spherical,
    Universal,
    Vector,
)  # fmt: skip

__all__ = ["JointBuild", "build_joint"]

FloatArray = NDArray[np.float64]

_GROOVE_EXPONENT, _NEEDLE_EXPONENT = 1.5, 10 / 9
_Z = np.array([0.0, 0.0, 1.0])


def _vector(values: FloatArray) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])


def _quaternion(attitude: Rotation) -> tuple[float, float, float, float]:
    w, x, y, z = attitude.as_quat(scalar_first=True)
    return float(w), float(x), float(y), float(z)


@dataclass(frozen=True)
class JointBuild:
    """What a scene of the joint is made from, at one operating point; lengths in mm, N, s, t, rad.

    Attributes
    ----------
    values
        Joint parameters in internal units.
    posture
        Where shaft, output shaft and rollers start.
    side
        Sign of the torque: which flank of the grooves is loaded.
    groove_stiffness, needle_stiffness
        C of roller and groove, and of one sphere of a needle.
    needle_load
        Penetration of the most loaded needle into each partner at the start.
    groove, needle, needle_end
        Coefficients and transition velocities at the groove, at trunnion and bore, and between needles and stops.
    """

    values: Mapping[str, float]
    posture: Posture
    side: float
    groove_stiffness: float
    needle_stiffness: float
    needle_load: float
    groove: Friction
    needle: tuple[Friction, Friction]
    needle_end: Friction

    @property
    def needle_radius(self) -> float:
        """Radius of a needle."""
        return self.values["needle_diameter_mm"] / 2

    @property
    def trunnion_radius(self) -> float:
        """Radius of a trunnion: pitch diameter less needle diameter."""
        return self.values["needle_pitch_diameter_mm"] / 2 - self.needle_radius

    @property
    def bore_radius(self) -> float:
        """Radius of a roller's bore, with the clearance."""
        return self.trunnion_radius + 2 * self.needle_radius + self.values["bearing_radial_clearance_mm"]

    @property
    def ring_distance(self) -> float:
        """Distance of the middle of the needles from the spider's centre: that of the roller on average."""
        pitch = self.values["pitch_radius_mm"]
        return pitch + pitch * (1 / math.cos(self.values["joint_angle_deg"]) - 1) / 2

    def trunnion_axis(self, k: int) -> FloatArray:
        """Direction of trunnion k = 0, 1, 2 in the shaft's axes."""
        return np.array([math.cos(GROOVE_ANGLES[k]), math.sin(GROOVE_ANGLES[k]), 0.0])

    @property
    def spider_in_shaft(self) -> FloatArray:
        """The spider's centre from the shaft's centre of mass, in the shaft's axes."""
        return -0.5 * self.values["shaft_length_mm"] * _Z


def _prepared(values: Mapping[str, float]) -> JointBuild:
    """Constants and posture of one operating point."""
    columns = {name: np.array([value]) for name, value in values.items()}
    constants = {name: float(column[0]) for name, column in contact_constants(columns).items()}
    transition = transition_velocities(columns)
    side = -1.0 if values["torque_n_m"] < 0 else 1.0
    load = abs(values["torque_n_m"]) / (3 * values["pitch_radius_mm"])
    clearance = values["bearing_radial_clearance_mm"]
    needle_load = bearing_load_zone(load, clearance, constants["needle_stiffness"], values["needle_count"])[1]
    in_groove = (load / constants["groove_stiffness"]) ** (1 / _GROOVE_EXPONENT)
    play = (values["groove_radius_ratio"] - 1) * values["roller_radius_mm"]
    posture = joint_posture(
        values["joint_angle_deg"], values["outboard_joint_angle_deg"], values["shaft_length_mm"],
        values["pitch_radius_mm"], values["speed_rpm"], side * (play + in_groove + clearance + 2 * needle_load),
    )  # fmt: skip
    groove = Friction(
        values["groove_sliding_friction"], float(transition.groove_sliding[0]),
        values["groove_rolling_friction"], values["groove_rolling_lever_mm"], float(transition.groove_rolling[0]),
        3 / 8 * values["groove_spin_friction"] * constants["groove_axis_factor"], float(transition.spinning[0]),
    )  # fmt: skip
    radius, slip = values["needle_diameter_mm"] / 2, float(transition.needle_sliding[0])
    trunnion = values["needle_pitch_diameter_mm"] / 2 - radius
    bore = trunnion + 2 * radius + clearance
    spin = float(transition.roller_spin[0])
    # a needle that rolls between trunnion and bore turns on them at r_b and r_t over its diameter times the spin
    rolling = [
        Friction(values["needle_sliding_friction"], slip, values["needle_rolling_friction"], radius,
                 spin * partner / (2 * radius))
        for partner in (bore, trunnion)
    ]  # fmt: skip
    return JointBuild(
        values, posture, side, constants["groove_stiffness"],
        constants["needle_stiffness"] / values["spheres_per_needle"], needle_load,
        groove, (rolling[0], rolling[1]), Friction(values["needle_sliding_friction"], slip),
    )  # fmt: skip


def _moving(name: str, mass: float, inertia: Vector, pose: Pose, **more: object) -> Body:
    return Body(
        name, mass, inertia, _vector(pose.position), _quaternion(pose.attitude), _vector(pose.velocity),
        _vector(pose.rotation), **more,
    )  # type: ignore[arg-type]  # fmt: skip


def _shafts(build: JointBuild) -> tuple[list[Body], list[Spherical | Revolute | Universal]]:
    """Intermediate shaft, output shaft, and what stands still in space; with their constraints."""
    values, posture = build.values, build.posture
    mass, length, inertia = values["shaft_mass_kg"], values["shaft_length_mm"], values["output_inertia_kg_m2"]
    radius_squared = mass / (values["density_kg_m3"] * math.pi * length)
    across = mass * (length**2 / 12 + radius_squared / 4)
    arm = posture.shaft.attitude.apply(-build.spider_in_shaft)
    middle = Pose(
        posture.shaft.position + arm, posture.shaft.attitude,
        posture.shaft.velocity + np.cross(posture.shaft.rotation, arm), posture.shaft.rotation,
    )  # fmt: skip
    end = posture.output.position
    axis = posture.output.attitude.apply(_Z)
    speed = values["speed_rpm"]
    bodies = [
        _moving("shaft", mass, (across, across, mass * radius_squared / 2), middle),
        _moving("output", mass, (inertia, inertia, inertia), posture.output,
                own_moment=(0.0, 0.0, -values["torque_n_m"])),
        Body("space", mass, (inertia, inertia, inertia), angular_velocity=(0.0, 0.0, -speed), locked=(True,) * 6),
    ]  # fmt: skip
    half = _vector(-build.spider_in_shaft)
    constraints = [
        Revolute("space", "output", _vector(end), axis_a=_vector(axis)),
        Universal("output", "shaft", point_b=half, axis_a=(0.0, 1.0, 0.0), axis_b=(1.0, 0.0, 0.0)),
    ]
    return bodies, constraints


def _roller(build: JointBuild, k: int) -> tuple[Body, SphereRow]:
    """Roller k, rolling along its groove, and its contact with the groove."""
    values, pose = build.values, build.posture.rollers[k]
    radius, half, bore = values["roller_radius_mm"], values["roller_width_mm"] / 2, build.bore_radius
    # a slice at x of the zone of a sphere, less the bore: powers of R^2 - x^2 integrated over the width
    second = 2 * (radius**2 * half - half**3 / 3)
    fourth = 2 * (radius**4 * half - 2 * radius**2 * half**3 / 3 + half**5 / 5)
    spread = 2 * (radius**2 * half**3 / 3 - half**5 / 5 - bore**2 * half**3 / 3)
    density = values["density_kg_m3"] * math.pi
    mass, polar = density * (second - 2 * half * bore**2), density * (fourth - 2 * half * bore**4) / 2
    across = polar / 2 + density * spread
    trunnion = pose.attitude.apply(_Z)
    flank = build.side * np.array([-math.sin(GROOVE_ANGLES[k]), math.cos(GROOVE_ANGLES[k]), 0.0])
    # its spin on the trunnion takes the slip along the groove to zero
    slip = pose.velocity[2] - radius * np.cross(pose.rotation, flank)[2]
    spin = slip / (radius * np.cross(trunnion, flank)[2])
    ahead = (values["bearing_radial_clearance_mm"] + 2 * build.needle_load) * flank  # of its trunnion
    rolling = Pose(pose.position + ahead, pose.attitude, pose.velocity, pose.rotation + spin * trunnion)
    body = _moving(f"roller {k + 1}", mass, (across, across, polar), rolling)
    pitch = values["pitch_radius_mm"]
    groove = Cylinder(
        GROUND, values["groove_radius_ratio"] * radius, axis=(0.0, 0.0, 1.0), concave=True,
        point=(pitch * math.cos(GROOVE_ANGLES[k]), pitch * math.sin(GROOVE_ANGLES[k]), 0.0),
    )  # fmt: skip
    contact = SphereRow(
        body.name, groove, radius, build.groove_stiffness, _GROOVE_EXPONENT,
        damping=values["contact_damping_s_per_mm"], friction=build.groove,
    )  # fmt: skip
    return body, contact


def _needle(build: JointBuild, k: int, j: int, roller: Body) -> Body:
    """Needle j of trunnion k, counted from the middle of the load zone about the outward trunnion axis."""
    values, shaft = build.values, build.posture.shaft
    pose = build.posture.rollers[k]
    axis = pose.attitude.apply(_Z)
    load = build.side * np.cross(np.cross(axis, [math.cos(GROOVE_ANGLES[k]), math.sin(GROOVE_ANGLES[k]), 0.0]), axis)
    flank = -build.side * np.array([-math.sin(GROOVE_ANGLES[k]), math.cos(GROOVE_ANGLES[k]), 0.0])
    load = flank - axis * (flank @ axis)
    angle = 2 * math.pi * j / values["needle_count"]
    normal = Rotation.from_rotvec(angle * axis).apply(load / np.linalg.norm(load))
    # in the middle of the gap between trunnion and bore, which the load has shifted
    shift = values["bearing_radial_clearance_mm"] + 2 * build.needle_load
    middle = (build.trunnion_radius + build.bore_radius - shift * math.cos(angle)) / 2
    arm = build.ring_distance * axis + middle * normal
    skew = values[f"initial_skew_{k + 1}_deg"]
    own = Rotation.from_rotvec(skew * normal).apply(axis)
    spin = (np.array(roller.angular_velocity) - shaft.rotation) @ axis
    pitch, radius = values["needle_pitch_diameter_mm"] / 2, build.needle_radius
    orbit = spin * build.bore_radius / (2 * pitch)
    rotation = shaft.rotation + orbit * axis + orbit * (pitch / radius - 1) * own
    velocity = shaft.velocity + np.cross(shaft.rotation + orbit * axis, arm)
    mass = values["density_kg_m3"] * math.pi * radius**2 * values["needle_length_mm"] * values["needle_mass_factor"]
    across = mass * (radius**2 / 4 + values["needle_length_mm"] ** 2 / 12)
    attitude = Rotation.from_matrix(np.column_stack([normal, np.cross(own, normal), own]))
    place = Pose(shaft.position + arm, attitude, velocity, rotation)
    return _moving(f"needle {k + 1}.{j + 1}", mass, (across, across, mass * radius**2 / 2), place)


def _needle_contacts(build: JointBuild, k: int, j: int) -> list[SphereRow]:
    """Contacts of needle j with trunnion, bore and next needle, and of its ends with flange and retainer."""
    values = build.values
    count = int(values["needle_count"])
    name, roller, radius = f"needle {k + 1}.{j + 1}", f"roller {k + 1}", build.needle_radius
    axis, length = build.trunnion_axis(k), values["needle_length_mm"]
    along = {"axis": (0.0, 0.0, 1.0), "length": length, "count": int(values["spheres_per_needle"]),
             "crown": values["needle_crown_um"]}  # fmt: skip
    law = {"stiffness": build.needle_stiffness, "exponent": _NEEDLE_EXPONENT,
           "damping": values["contact_damping_s_per_mm"]}  # fmt: skip
    trunnion = Cylinder("shaft", build.trunnion_radius, _vector(build.spider_in_shaft), _vector(axis))
    bore = Cylinder(roller, build.bore_radius, axis=(0.0, 0.0, 1.0), concave=True)
    rows = [
        SphereRow(name, trunnion, radius, friction=build.needle[0], **along, **law),
        SphereRow(name, bore, radius, friction=build.needle[1], **along, **law),
    ]
    if count > 1:
        after = Cylinder(f"needle {k + 1}.{(j + 1) % count + 1}", radius, axis=(0.0, 0.0, 1.0))
        rows.append(SphereRow(name, after, radius, friction=build.needle_end, **along, **law))
    reach = (length + values["needle_axial_clearance_mm"]) / 2
    for side in (-1.0, 1.0):
        stop = build.spider_in_shaft + (build.ring_distance + side * reach) * axis
        plane = Plane("shaft", _vector(stop), _vector(-side * axis))
        rows.append(SphereRow(
            name, plane, 0.0, centre=(0.0, 0.0, side * length / 2), friction=build.needle_end, **law
        ))  # fmt: skip
    return rows


def build_joint(values: Mapping[str, float], needles: bool) -> Scene:
    """Scene of the joint at one operating point.

    Parameters
    ----------
    values
        Joint parameters in internal units (mm, N, s, t, rad).
    needles
        Whether every needle is a body (model ``needles``).

    Returns
    -------
    Scene
        Contacts of the rollers with grooves 1, 2, 3 are the last three.
    """
    build = _prepared(values)
    bodies, constraints = _shafts(build)
    rollers = [_roller(build, k) for k in range(3)]
    contacts: list[SphereRow] = []
    ring: list[Body] = []
    if needles:
        for k in range(3):
            for j in range(int(values["needle_count"])):
                ring.append(_needle(build, k, j, rollers[k][0]))
                contacts.extend(_needle_contacts(build, k, j))
    speed = values["speed_rpm"]
    return Scene(
        (*bodies, *(body for body, _ in rollers), *ring),
        (*contacts, *(contact for _, contact in rollers)),
        constraints=tuple(constraints),
        frame=(0.0, 0.0, speed),
        core=tuple(body.name for body, _ in rollers),
        length_scale=0.1,
        speed_scale=values["pitch_radius_mm"] * speed * math.tan(values["joint_angle_deg"]) + 1.0,
        rotation_scale=speed,
        time_scale=1 / speed,
    )
