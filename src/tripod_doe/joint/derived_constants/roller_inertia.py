"""Mass and moments of inertia of a roller from its dimensions."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray


def roller_inertia(
    radius: FloatArray, width: FloatArray, bore: FloatArray, density: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mass and moments of inertia of a roller (a spherical zone with a bore); shapes broadcast.

    If a wide bore meets the sphere within the width, the roller ends there.

    Args:
        radius, width, bore: Of the sphere, of the zone, and of the bore (its radius), in mm.
        density: In t / mm3.

    Returns:
        Mass in t, moment of inertia about the roller's axis and across it in t mm2.
    """
    half = np.minimum(width / 2, np.sqrt(np.maximum(radius**2 - bore**2, 0.0)))
    # a slice at x of the zone of a sphere, less the bore: powers of R^2 - x^2 integrated over the width
    second = 2 * (radius**2 * half - half**3 / 3)
    fourth = 2 * (radius**4 * half - 2 * radius**2 * half**3 / 3 + half**5 / 5)
    spread = 2 * (radius**2 * half**3 / 3 - half**5 / 5 - bore**2 * half**3 / 3)
    mass, polar = density * np.pi * (second - 2 * half * bore**2), density * np.pi * (fourth - 2 * half * bore**4) / 2
    return mass, polar, polar / 2 + density * np.pi * spread
