"""Contact stiffnesses of the joint, and the axis of its contact ellipse: the paper's Table 1.

Roller and groove (sphere in cylinder), Eq. 2 and 5: f_n = C delta^(3/2), C = 2.15e5 / sqrt((2K/(pi mu))^3 sum rho).
Needle and other parts, a sphere of N_s, Eq. 2 and 8:  f_n = C delta^(10/9), C = 8.15e4 l^(8/9) / N_s.
Both hold for steel (E = 207 GPa, nu = 0.3); C scales with E / (1 - nu^2), as in linear elasticity.
mu and 2K/(pi mu) are Hertz's coefficients of the curvatures (`mechanics.laws.hertz`), not friction.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.laws.hertz import groove_curvature, hertz_coefficients

_STEEL = 207e3 / (1 - 0.3**2)


def elastic_factor(youngs_modulus: FloatArray, poissons_ratio: FloatArray) -> FloatArray:
    """E / (1 - nu^2) over its value for the steel of Table 1; `youngs_modulus` in MPa, shapes broadcast."""
    return youngs_modulus / (1 - poissons_ratio**2) / _STEEL


def groove_contact_stiffness(
    two_k_over_pi_mu: FloatArray, curvature_sum: FloatArray, elastic: FloatArray
) -> FloatArray:
    """C of roller and groove in N / mm^1.5 (Table 1); `elastic` from `elastic_factor`."""
    return 2.15e5 * elastic / np.sqrt(two_k_over_pi_mu**3 * curvature_sum)


def needle_contact_stiffness(length: FloatArray, elastic: FloatArray) -> FloatArray:
    """C of a whole needle against one part in N / mm^(10/9) (Table 1); one sphere has C / N_s."""
    return 8.15e4 * length ** (8 / 9) * elastic


def semi_major_axis_factor(hertz_mu: FloatArray, curvature_sum: FloatArray, elastic: FloatArray) -> FloatArray:
    """Semi-major axis a of the groove's contact ellipse over f_n^(1/3), in mm / N^(1/3).

    The paper's 2a = 0.0472 mu (f_n / sum rho)^(1/3); the spinning moment of Eq. 6 is (3/8) mu_s f_n a.
    """
    return 0.0472 / 2 * hertz_mu / np.cbrt(curvature_sum * elastic)


def contact_constants(
    elastic: FloatArray, roller_radius: FloatArray, groove_radius_ratio: FloatArray, needle_length: FloatArray
) -> dict[str, FloatArray]:
    """Contact constants of every point.

    Args:
        elastic: From `elastic_factor`, times any factor on all stiffnesses, shape (point,).
        roller_radius, groove_radius_ratio, needle_length: Each of shape (point,); lengths in mm.

    Returns:
        ``groove_stiffness`` in N / mm^1.5, ``groove_axis_factor`` (semi-major axis over f_n^(1/3)) in mm / N^(1/3),
        ``needle_stiffness`` (a whole needle against one part) in N / mm^(10/9), each of shape (point,).
    """
    curvature_sum, cos_tau = groove_curvature(roller_radius, groove_radius_ratio)
    hertz_mu, _, two_k = hertz_coefficients(cos_tau)
    return {
        "groove_stiffness": groove_contact_stiffness(two_k, curvature_sum, elastic),
        "groove_axis_factor": semi_major_axis_factor(hertz_mu, curvature_sum, elastic),
        "needle_stiffness": needle_contact_stiffness(needle_length, elastic),
    }
