"""Ratios of an operating point on which it depends how much each model of the joint leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.geometry.roller_inertia import roller_inertia

RATIOS = {
    "joint_angle_deg": "joint angle",
    "groove_friction": "sliding friction coefficient of the grooves, 0 with their sliding off",
    "swing_ratio": "swing of a roller in its groove by friction, over its slip along the groove",
    "needle_friction": "sliding friction coefficient of the needles, 0 with it off",
    "needle_ratio": "needle sliding friction, 0 with it off, over joint angle in rad",
    "inertia_ratio": "force that keeps a roller on its orbit, over its mean normal force",
    "crown_ratio": "1 + crown of the needles over the penetration of the most loaded one without crown and clearance",
}
"""What each ratio is."""


def operating_ratios(points: Mapping[str, NDArray[Any]]) -> dict[str, FloatArray]:
    """Ratios of a block of points, each of shape (point,): those of `RATIOS`; infinite or NaN without angle or torque.

    Parameters
    ----------
    points
        Every parameter by name, in the unit of its name, each of shape (point,).

    Notes
    -----
    swing ratio = 2 mu_s (R_g - R_s) / (R_p tan(theta) sin(theta) / 2), its denominator the amplitude of the slip;
    inertia ratio = m_r R_p omega^2 / (|T| / (3 R_p)), with the mass m_r of a roller; penetration of the crown ratio
    = (4.08 |T| / (3 R_p Z C))^0.9, with Z needles of the stiffness C (`contact_stiffness.bearing_load_zone`).
    """
    theta, pitch, roller = np.radians(points["joint_angle_deg"]), points["pitch_radius_mm"], points["roller_radius_mm"]
    friction = points["groove_sliding_friction"] * points["groove_sliding"]
    rubbing = points["needle_sliding_friction"] * points["needle_sliding"]
    play = (points["groove_radius_ratio"] - 1) * roller
    slip = pitch * np.tan(theta) * np.sin(theta) / 2
    bore = (points["needle_pitch_diameter_mm"] + points["needle_diameter_mm"]) / 2 + points[
        "bearing_radial_clearance_mm"
    ]
    mass = roller_inertia(roller, points["roller_width_mm"], bore, 1e-9 * points["density_kg_m3"])[0]  # kg
    orbit = mass * 1e-3 * pitch * (np.pi / 30 * points["speed_rpm"]) ** 2
    from tripod_doe.joint.geometry.contact_stiffness import (  # compiles, and needs scipy
        elastic_factor,
        needle_contact_stiffness,
    )

    elastic = elastic_factor(1e3 * points["youngs_modulus_gpa"], points["poissons_ratio"])
    stiffness = needle_contact_stiffness(points["needle_length_mm"], elastic * points["contact_stiffness_factor"])
    carried = 4.08 * np.abs(points["torque_n_m"]) * 1e3 / (3 * pitch) / points["needle_count"]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return {
            "joint_angle_deg": np.asarray(points["joint_angle_deg"], float),
            "groove_friction": friction,
            "swing_ratio": 2 * friction * play / slip,
            "needle_friction": rubbing,
            "needle_ratio": rubbing / theta,
            "inertia_ratio": orbit * 3e-3 * pitch / np.abs(points["torque_n_m"]),
            "crown_ratio": 1 + 1e-3 * points["needle_crown_um"] / (carried / stiffness) ** 0.9,
        }
