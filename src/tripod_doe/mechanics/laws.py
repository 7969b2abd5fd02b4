"""Laws of contact and friction, each written once, with the paper's equation number.

All are compiled scalar functions; `hyperbolic_tangent` is free of branches, so that loops over it are vectorised.
Units are mm, N, s, t, rad; any consistent system works.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.mechanics.compilation import inlined_kernel

__all__ = [
    "contact_energy", "contact_force", "damping_factor", "hyperbolic_tangent", "rolling_moment", "secant_slope",
    "spinning_moment", "tangent_slope",
]  # fmt: skip


@inlined_kernel
def hyperbolic_tangent(x):
    """Regularised sign of the paper's Fig. 4 and Eq. 3: tanh(x) to 1e-14 relative, in a form that vectorises.

    Lambert's continued fraction of tanh(x / 4), cut after eight levels, and the doubling formula twice. It is a third
    of the price of the C library's function in a loop that the compiler can vectorise.

    Parameters
    ----------
    x
        Slip over transition velocity; any finite number.

    Returns
    -------
    float
        tanh(x), odd and monotone.
    """
    y = 0.25 * min(max(x, -20.0), 20.0)  # tanh(20) is 1 in double precision
    z = y * y
    t = y * (2027025.0 + z * (270270.0 + z * (6930.0 + z * 36.0)))
    t /= 2027025.0 + z * (945945.0 + z * (51975.0 + z * (630.0 + z)))
    t = 2.0 * t / (1.0 + t * t)
    return 2.0 * t / (1.0 + t * t)


@inlined_kernel
def contact_force(stiffness, exponent, penetration):
    """Elastic contact force, Eq. 2: f_n = C delta^m for delta > 0."""
    if exponent == 1.5:
        return stiffness * penetration * np.sqrt(penetration)
    return stiffness * penetration**exponent


@inlined_kernel
def contact_energy(elastic_force, exponent, penetration):
    """Energy stored in a contact: the integral of Eq. 2, f_n delta / (m + 1)."""
    return elastic_force * penetration / (exponent + 1.0)


@inlined_kernel
def damping_factor(damping, penetration_rate):
    """Hunt and Crossley's factor 1 + d delta' on the contact force, never below zero (a contact does not pull)."""
    return max(1.0 + damping * penetration_rate, 0.0)


@inlined_kernel
def secant_slope(magnitude, transition):
    """Slope tanh(v / v_st) / v of the regularised sign of Eq. 3 (Fig. 4) as a secant from the origin; finite at v = 0.

    A friction vector is -mu f_n times this slope times the slip, so its direction needs no division by zero.
    """
    ratio = magnitude / transition
    if ratio < 1e-4:
        return (1.0 - ratio * ratio / 3.0) / transition
    return hyperbolic_tangent(ratio) / magnitude


@inlined_kernel
def tangent_slope(magnitude, transition):
    """Derivative of tanh(v / v_st) by v: almost zero in full slip."""
    value = hyperbolic_tangent(magnitude / transition)
    return (1.0 - value * value) / transition


@inlined_kernel
def spinning_moment(coefficient, normal_force):
    """Largest spinning moment, Eq. 7: coefficient (3/8 mu_s a / f_n^(1/3)) times f_n^(4/3)."""
    return coefficient * normal_force * np.cbrt(normal_force) if coefficient > 0.0 else 0.0


@inlined_kernel
def rolling_moment(coefficient, normal_force, lever):
    """Largest rolling resistance, Eq. 4: mu_r f_n D / 2 with the lever D / 2."""
    return coefficient * normal_force * lever
