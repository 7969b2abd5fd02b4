"""Constants of the multibody models that follow from the values of an operating point, and its initial state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.derived_constants.load_zone import bearing_load_zone
from tripod_doe.joint.geometry.transition_velocities import transition_velocities
from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES, InitialState, Pose, initial_state
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.scene import Body, Friction, Vector

_GROOVE_EXPONENT = 1.5
_Z = np.array([0.0, 0.0, 1.0])


def vector(values: FloatArray) -> Vector:
    """Three numbers as the scene's vectors."""
    return float(values[0]), float(values[1]), float(values[2])


def _quaternion(attitude: Rotation) -> tuple[float, float, float, float]:
    x, y, z, w = attitude.as_quat()  # in one call: to put w first costs five times as much
    return float(w), float(x), float(y), float(z)


@dataclass(frozen=True)
class DerivedConstants:
    """Constants of a scene of the joint at one operating point; in mm, N, s, t, rad."""

    values: JointValues[float]  # the operating point
    initial: InitialState  # where shaft, output shaft and rollers start
    side: float  # sign of the torque: which flank of the grooves is loaded
    sphere_stiffness: float  # C of one sphere of a needle
    needle_load: float  # penetration of the most loaded needle into each partner at the start
    # groove, needle, needle_end: coefficients and transition velocities at the groove, at trunnion and bore, and
    # between needles and stops
    groove: Friction
    needle: tuple[Friction, Friction]
    needle_end: Friction
    # turning of a roller on its trunnion at which its needles reach their transition of rolling
    roller_spin_transition: float

    @property
    def ring_distance(self) -> float:
        """Distance of the middle of the needles from the spider's centre: the roller's mean distance."""
        return float(self.values.ring_distance)

    def trunnion_axis(self, k: int) -> FloatArray:
        """Direction of trunnion k = 0, 1, 2 in the shaft's axes."""
        return np.array([math.cos(GROOVE_ANGLES[k]), math.sin(GROOVE_ANGLES[k]), 0.0])

    @property
    def spider_in_shaft(self) -> FloatArray:
        """The spider's centre from the shaft's centre of mass, in the shaft's axes."""
        return -0.5 * self.values.shaft_length * _Z


def derive_constants(values: JointValues[float]) -> DerivedConstants:
    """Derive the constants of one operating point."""
    transition = transition_velocities(values)
    side = -1.0 if values.torque < 0 else 1.0
    load, clearance = values.groove_load, values.bearing_radial_clearance
    needle_load = bearing_load_zone(load, clearance, values.needle_stiffness, values.needle_count)[1]
    in_groove = (load / values.groove_stiffness) ** (1 / _GROOVE_EXPONENT)
    initial = initial_state(
        values.joint_angle,
        values.outboard_joint_angle,
        values.shaft_length,
        values.pitch_radius,
        values.speed,
        side * (values.groove_play + in_groove + clearance + 2 * needle_load),
    )
    groove = Friction(
        values.groove_sliding_friction,
        float(transition.groove_slip),
        values.groove_rolling_friction,
        values.groove_rolling_lever,
        float(transition.groove_roll),
        3 / 8 * values.groove_spin_friction * values.groove_axis_factor,
        float(transition.groove_spin),
    )
    slip, spin = float(transition.needle_slip), float(transition.roller_spin)
    # a needle that rolls between trunnion and bore turns on them at r_b and r_t over its diameter times the spin
    rolling = [
        Friction(
            values.needle_sliding_friction,
            slip,
            values.needle_rolling_friction,
            values.needle_radius,
            spin * partner / (2 * values.needle_radius),
        )
        for partner in (values.bore_radius, values.trunnion_radius)
    ]
    return DerivedConstants(
        values,
        initial,
        side,
        values.needle_stiffness / values.spheres_per_needle,
        needle_load,
        groove,
        (rolling[0], rolling[1]),
        Friction(values.needle_sliding_friction, slip),
        spin,
    )


def moving_body(name: str, mass: float, inertia: Vector, pose: Pose, own_moment: Vector = (0.0, 0.0, 0.0)) -> Body:
    """A body that starts in a pose."""
    return Body(
        name,
        mass,
        inertia,
        vector(pose.position),
        _quaternion(pose.attitude),
        vector(pose.velocity),
        vector(pose.rotation),
        own_moment=own_moment,
    )
