"""Contact constants of the joint: the paper's Table 1, Hertz's coefficients, and the load zone of the needle bearing.

Roller and groove (sphere in cylinder), Eq. 2 and 5: f_n = C delta^(3/2), C = 2.15e5 / sqrt((2K/(pi mu))^3 sum rho).
Needle and other parts, a sphere of N_s, Eq. 2 and 8:  f_n = C delta^(10/9), C = 8.15e4 l^(8/9) / N_s.
Both hold for steel (E = 207 GPa, nu = 0.3); C scales with E / (1 - nu^2): linear elasticity knows forces over E only.
mu and 2K/(pi mu) are Hertz's coefficients of the curvatures, not friction.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.compilation.kernels import inner_kernel, kernel

_STEEL = 207e3 / (1 - 0.3**2)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def elastic_factor(youngs_modulus: FloatArray, poissons_ratio: FloatArray) -> FloatArray:
    """E / (1 - nu^2) over its value for the steel of Table 1; `youngs_modulus` in MPa, shapes broadcast."""
    return youngs_modulus / (1 - poissons_ratio**2) / _STEEL


def groove_curvature(roller_radius: FloatArray, groove_radius_ratio: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sum of the curvatures (1/mm) and Hertz's auxiliary value cos tau of a sphere in a cylindrical groove."""
    groove = 1 / (groove_radius_ratio * roller_radius)
    curvature_sum = 2 / roller_radius - groove
    return curvature_sum, groove / curvature_sum


def hertz_coefficients(cos_tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hertz's coefficients of an elliptical contact, from complete elliptic integrals.

    With f = (b/a)^2 of the contact ellipse, K and E the complete elliptic integrals of parameter 1 - f:
    cos tau = ((1 + f) E - 2 f K) / ((1 - f) E), mu^3 = 2 E / (pi f), nu = mu sqrt f.

    Args:
        cos_tau: Auxiliary value of the curvatures, 0 < cos tau < 1, any shape.

    Returns:
        mu, nu and 2 K / (pi mu), each of the shape of `cos_tau`.

    Standard Hertz theory as tabulated in bearing handbooks; the paper cites it for its Eq. 5 and 6.
    """
    distinct, where = np.unique(cos_tau, return_inverse=True)  # most studies never vary the curvature
    coefficients = _of_one_curvature(float(distinct[0])) if distinct.size == 1 else _solved_coefficients(distinct)
    mu, nu, two_k = (values[where].reshape(np.shape(cos_tau)) for values in coefficients)
    return mu, nu, two_k


@lru_cache(maxsize=16)
def _of_one_curvature(cos_tau: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of the one curvature of a study, whose points come block by block; each of shape (1,)."""
    return _solved_coefficients(np.array([cos_tau]))


def _solved_coefficients(cos_tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`hertz_coefficients` of different curvatures."""
    low, high = np.full_like(cos_tau, math.log(1e-15)), np.full_like(cos_tau, math.log(1 - 1e-9))
    for _ in range(60):  # cos tau falls as the ellipse gets rounder: bisection of log f, to rounding
        middle = (low + high) / 2
        flatness = np.exp(middle)
        first, second = _elliptic_integrals(flatness)
        too_long = (1 + flatness - 2 * flatness * first / second) / (1 - flatness) > cos_tau
        low, high = np.where(too_long, middle, low), np.where(too_long, high, middle)
    flatness = np.exp((low + high) / 2)
    first, second = _elliptic_integrals(flatness)
    mu = np.cbrt(2 * second / (np.pi * flatness))
    return mu, mu * np.sqrt(flatness), 2 * first / (np.pi * mu)


def _elliptic_integrals(flatness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Complete elliptic integrals K and E of parameter 1 - `flatness`, by arithmetic-geometric means.

    Written out because importing SciPy's takes as long as everything else that `simulate` does.
    """
    arithmetic, geometric, weight = np.ones_like(flatness), np.sqrt(flatness), 0.5
    deficit = weight * (1 - flatness)
    for _ in range(8):  # quadratic: exact to rounding for 1e-15 <= flatness <= 1
        half_gap, weight = (arithmetic - geometric) / 2, 2 * weight
        arithmetic, geometric = (arithmetic + geometric) / 2, np.sqrt(arithmetic * geometric)
        deficit = deficit + weight * half_gap**2
    first = np.pi / (2 * arithmetic)
    return first, first * (1 - deficit)


def groove_contact_stiffness(
    two_k_over_pi_mu: FloatArray, curvature_sum: FloatArray, elastic: FloatArray
) -> FloatArray:
    """C of roller and groove in N / mm^1.5 (Table 1); `elastic` from `elastic_factor`."""
    return 2.15e5 * elastic / np.sqrt(two_k_over_pi_mu**3 * curvature_sum)


def needle_contact_stiffness(length: FloatArray, elastic: FloatArray) -> FloatArray:
    """C of a whole needle against one part in N / mm^(10/9) (Table 1); a sphere has 1 / N_s of it."""
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


@kernel
def bearing_load_zone(load, clearance, stiffness, needle_count):
    """Load zone of a needle bearing with radial clearance: how much more than the load the needles carry in sum.

    The roller moves by D across its trunnion; a needle at the angle g from the load is pressed by D cos g - c against
    trunnion and bore in series. D follows from the balance of forces along the load, with the needles smeared over
    the circumference.

    Args:
        load: Bearing load in N.
        clearance: Radial clearance c in mm; negative for preload.
        stiffness: Of one needle against one part, N / mm^(10/9).
        needle_count: Needles on the circumference.

    Returns:
        The sum of the needle loads over the bearing load, and the penetration in mm of the most loaded needle into each
        of its two partners. Without clearance the first tends to 1.26, with a wide one to 1.
    """
    load = max(load, 1e-9)
    floor = max(clearance, 0.0)
    shift = floor + 2.0 * (load / stiffness) ** 0.9 + 1e-12
    along, total, slope = needle_loads(shift, clearance, stiffness, needle_count)
    while along < load:
        shift = floor + 2.0 * (shift - floor)
        along, total, slope = needle_loads(shift, clearance, stiffness, needle_count)
    for _ in range(60):  # the load is convex in the shift: Newton's method descends from above
        change = (along - load) / slope
        shift = max(shift - change, floor + 0.01 * (shift - floor))
        along, total, slope = needle_loads(shift, clearance, stiffness, needle_count)
        if abs(change) <= 1e-12 * shift:
            break
    return total / along, 0.5 * (shift - clearance)


@inner_kernel
def needle_loads(shift, clearance, stiffness, needle_count):
    """Sum along the load, plain sum, and derivative of the first for the shift D, by Gauss's rule on the load zone."""
    if shift <= clearance:
        return 0.0, 0.0, 0.0
    half_zone = np.arccos(min(max(clearance / shift, -1.0), 1.0))
    along, total, slope = 0.0, 0.0, 0.0
    for node in range(_NODES.size):
        cosine = np.cos(0.5 * half_zone * (1.0 + _NODES[node]))
        pressed = max(shift * cosine - clearance, 1e-300)
        needle_load = stiffness * (0.5 * pressed) ** (10.0 / 9.0) * _WEIGHTS[node]
        along += needle_load * cosine
        total += needle_load
        slope += 10.0 / 9.0 * needle_load * cosine * cosine / pressed
    scale = 0.5 * needle_count / np.pi * half_zone
    return along * scale, total * scale, slope * scale
