"""Hertz's theory of elliptical contacts: curvatures and coefficients of a sphere in a cylindrical groove."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from tripod_doe.array_types import FloatArray


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
