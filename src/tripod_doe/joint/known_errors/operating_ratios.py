"""Ratios of an operating point that determine the error of each model of the joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.derived_constants.roller_inertia import roller_inertia
from tripod_doe.joint.unit_conversion import internal_values

LINEAR = ("rolling_friction", "skew_deg", "direction")
"""Ratios that are compared as they are, not by their logarithms."""

UNFELT = 0.01
"""Inertia ratio far below friction coefficients: smaller ones are alike."""

WEIGHTS = {"inertia_ratio": 2.0}
"""Factors of distances, over the spread of a ratio; 1 for others. Heavy rollers are to be judged by heavy ones."""

RATIOS = {
    "joint_angle_deg": "joint angle",
    "groove_friction": "sliding friction coefficient of the grooves, 0 if switched off",
    "swing_ratio": "swing of a roller in its groove by friction, divided by the path of its slip",
    "needle_friction": "sliding friction coefficient of the needles, 0 if switched off",
    "needle_ratio": "needle sliding friction, 0 if switched off, divided by joint angle in rad",
    "rolling_friction": "sum of the rolling friction coefficients of grooves and needles, 0 if switched off",
    "inertia_ratio": "inertial force of a roller on its orbit, divided by its mean normal force",
    "crown_ratio": "1 + crown of the needles over the penetration of the most loaded one without crown and clearance",
    "skew_deg": "initial skew of the needles, root mean square of the three bearings",
    "direction": "1 in drive, -1 in coast, where an error is a larger share of a smaller thrust force",
}
"""Meaning of each ratio."""


def operating_ratios(points: Mapping[str, NDArray[Any]]) -> dict[str, FloatArray]:
    """The `RATIOS` of a block of points, each of shape (point,).

    Without angle or torque some are infinite or NaN.

    Args:
        points: Every parameter by name, in the unit of its name, each of shape (point,).

    swing ratio = 2 mu_s (R_g - R_s) / (R_p tan(theta) sin(theta) / 2), its denominator the path of the slip;
    inertia ratio = m_r R_p omega^2 / (|T| / (3 R_p)), with the mass m_r of a roller; penetration of the crown ratio
    = (4.08 |T| / (3 R_p Z C))^0.9, with Z needles of the stiffness C (`load_zone.bearing_load_zone`).
    """
    values = internal_values(points)
    friction, rubbing = values.groove_sliding_friction, values.needle_sliding_friction
    slip = values.pitch_radius * np.tan(values.joint_angle) * np.sin(values.joint_angle) / 2
    mass = roller_inertia(values.roller_radius, values.roller_width, values.bore_radius, values.density)[0]
    orbit, carried = mass * values.pitch_radius * values.speed**2, 4.08 * values.groove_load / values.needle_count
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return {
            "joint_angle_deg": np.asarray(points["joint_angle_deg"], float),
            "groove_friction": friction,
            "swing_ratio": 2 * friction * values.groove_play / slip,
            "needle_friction": rubbing,
            "needle_ratio": rubbing / values.joint_angle,
            "rolling_friction": values.groove_rolling_friction + values.needle_rolling_friction,
            "inertia_ratio": orbit / values.groove_load,
            "crown_ratio": 1 + values.needle_crown / (carried / values.needle_stiffness) ** 0.9,
            "skew_deg": np.degrees(np.sqrt(np.mean(np.square(values.initial_skews), axis=0))),
            "direction": np.sign(np.asarray(points["torque_n_m"], float)),
        }


TOUCHING = "touching_spheres"
TOUCHING_MEANING = "spheres of a needle over the length on which the most loaded one touches; unlimited without crown"


def touching_spheres(points: Mapping[str, NDArray[Any]], ratios: Mapping[str, FloatArray]) -> FloatArray:
    """Spheres over the length on which the most loaded needle touches, by its crown, shape (point,).

    A needle of crown h pressed by d touches over sqrt(d / h) of its length, over which so large a share of its
    spheres lies; `crown_ratio` is 1 + h / d. Above the number of spheres, all touch; infinite without crown.

    Args:
        points: As for `operating_ratios`, which gives `ratios`.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(points["spheres_per_needle"] / np.sqrt(ratios["crown_ratio"] - 1), float)


def has_no_thrust(ratios: Mapping[str, FloatArray]) -> NDArray[np.bool_]:
    """Whether a point has no thrust force in any model: without angle or sliding friction of the grooves.

    Without torque, inertia presses the rollers into their grooves.
    """
    return np.asarray((ratios["joint_angle_deg"] == 0) | (ratios["groove_friction"] == 0))


def coordinates(ratios: Mapping[str, FloatArray]) -> FloatArray:
    """Coordinates by which points are similar, shape (point, ratio).

    Logarithms of all ratios but `LINEAR`, of the inertia ratio after `UNFELT` has been added.
    """
    felt = {**ratios, "inertia_ratio": UNFELT + ratios["inertia_ratio"]}
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([each if name in LINEAR else np.log(each) for name, each in felt.items()], axis=1)
