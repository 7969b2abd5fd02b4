"""Pressures of the joint's contacts by Hertz's theory: the ellipse of roller and groove, the line of a needle."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.values import JointValues, Number
from tripod_doe.mechanics.laws.hertz import groove_curvature, hertz_coefficients


def ellipse_axes(values: JointValues[Number], normal_force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Semi-axes of the ellipse between roller and groove in mm, the major one across the groove.

    Args:
        values: One point, or points whose shape broadcasts with the leading axes of `normal_force`.
        normal_force: In N.
    """
    _, cos_tau = groove_curvature(np.asarray(values.roller_radius), np.asarray(values.groove_radius_ratio))
    mu, nu, _ = hertz_coefficients(np.atleast_1d(cos_tau))
    slimness = (nu / mu).reshape(np.shape(cos_tau))
    major = values.groove_axis_factor * np.cbrt(np.maximum(normal_force, 0.0))
    return major, major * slimness


def groove_pressure(values: JointValues[Number], normal_force: FloatArray) -> FloatArray:
    """Largest pressure between roller and groove in MPa, 3 N / (2 pi a b); arguments as for `ellipse_axes`."""
    major, minor = ellipse_axes(values, normal_force)
    pressure: FloatArray = 1.5 * np.maximum(normal_force, 0.0) / (np.pi * np.maximum(major * minor, 1e-300))
    return pressure


def needle_pressure(values: JointValues[Number], line_load: FloatArray) -> FloatArray:
    """Largest pressure between a needle and its trunnion in MPa, a line contact of cylinders; `line_load` in N/mm."""
    modulus = values.youngs_modulus / (2 * (1 - values.poissons_ratio**2))
    curvature = 1 / values.needle_radius + 1 / np.maximum(values.trunnion_radius, 1e-9)
    pressure: FloatArray = np.sqrt(np.maximum(line_load, 0.0) * modulus / np.pi * curvature)
    return pressure
