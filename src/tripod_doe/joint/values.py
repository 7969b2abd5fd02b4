"""Values inside the joint: its parameters in mm, N, s, t and rad, and the sizes that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

import numpy as np

from tripod_doe.array_types import FloatArray

Number = TypeVar("Number", float, FloatArray)


@dataclass(frozen=True, eq=False)
class JointValues(Generic[Number]):
    """Values of one operating point (floats) or of a block of points (arrays of shape (point,)), in mm, N, s, t, rad.

    Every field is named as its parameter (`parameters.JOINT_PARAMETERS`), without the unit; coefficients of mechanisms
    that are switched off are zero (`parameters.internal_values`). NaN stands for a step, a tolerance or a transition
    velocity that is not given.
    """

    joint_angle: Number
    torque: Number
    speed: Number
    initial_skew_1: Number
    initial_skew_2: Number
    initial_skew_3: Number
    groove_sliding_friction: Number
    groove_spin_friction: Number
    needle_sliding_friction: Number
    groove_rolling_friction: Number
    needle_rolling_friction: Number
    transition_ratio: Number
    groove_transition_velocity: Number
    needle_transition_velocity: Number
    pitch_radius: Number
    roller_radius: Number
    roller_width: Number
    groove_radius_ratio: Number
    groove_rolling_lever: Number
    needle_count: Number
    spheres_per_needle: Number
    needle_diameter: Number
    needle_length: Number
    needle_pitch_diameter: Number
    bearing_radial_clearance: Number
    needle_axial_clearance: Number
    needle_crown: Number
    shaft_length: Number
    outboard_joint_angle: Number
    shaft_mass: Number
    output_inertia: Number
    density: Number
    youngs_modulus: Number
    poissons_ratio: Number
    contact_damping_time: Number
    contact_damping: Number
    needle_mass_factor: Number
    relative_tolerance: Number
    step: Number
    accuracy: Number
    cycles: Number
    settled_needles: Number
    evaluation_budget: Number
    pressure_limit: Number
    penetration_limit: Number
    groove_stiffness: Number  # C of roller and groove, N / mm^1.5
    groove_axis_factor: Number  # semi-major axis of the groove's contact over f_n^(1/3), mm / N^(1/3)
    needle_stiffness: Number  # C of a whole needle against one part, N / mm^(10/9)

    @property
    def initial_skews(self) -> tuple[Number, Number, Number]:
        """Of all needles of trunnions 1, 2, 3."""
        return self.initial_skew_1, self.initial_skew_2, self.initial_skew_3

    @property
    def groove_load(self) -> Number:
        """Mean normal force at a groove, |T| / (3 R_p)."""
        return abs(self.torque) / (3 * self.pitch_radius)

    @property
    def groove_radius(self) -> Number:
        """R_g."""
        return self.groove_radius_ratio * self.roller_radius

    @property
    def groove_play(self) -> Number:
        """R_g - R_s."""
        return (self.groove_radius_ratio - 1) * self.roller_radius

    @property
    def eccentricity(self) -> Number:
        """Radius e on which the spider's centre orbits."""
        eccentricity: Number = self.pitch_radius * (1 / np.cos(self.joint_angle) - 1) / 2
        return eccentricity

    @property
    def ring_distance(self) -> Number:
        """Distance of the middle of the needles from the spider's centre: the roller's mean distance."""
        return self.pitch_radius + self.eccentricity

    @property
    def needle_radius(self) -> Number:
        """Radius of a needle."""
        return self.needle_diameter / 2

    @property
    def needle_mass(self) -> Number:
        """Mass of a needle."""
        return self.density * np.pi * self.needle_radius**2 * self.needle_length * self.needle_mass_factor

    @property
    def bearing_radius(self) -> Number:
        """Radius of the needles' pitch circle."""
        return self.needle_pitch_diameter / 2

    @property
    def trunnion_radius(self) -> Number:
        """Radius of a trunnion: pitch diameter less needle diameter."""
        return self.bearing_radius - self.needle_radius

    @property
    def bore_radius(self) -> Number:
        """Radius of a roller's bore, with the clearance."""
        return self.trunnion_radius + self.needle_diameter + self.bearing_radial_clearance

    def take(self: JointValues[FloatArray], rows: Any) -> JointValues[FloatArray]:
        """Some points of a block: an index array or a slice."""
        return JointValues(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def point(self: JointValues[FloatArray], row: int) -> JointValues[float]:
        """One point of a block."""
        return JointValues(**{field.name: float(getattr(self, field.name)[row]) for field in fields(self)})
