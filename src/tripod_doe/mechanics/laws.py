"""Laws of contact and friction, each written once, with the paper's equation number.

All are compiled functions of floats or of `lanes`, eight floats at a time, and free of branches on them. Units are mm,
N, s, t, rad; any consistent system works.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.compilation import inlined_kernel
from tripod_doe.mechanics.lanes import root_guess, select

_BITS_OF_ONE = (1023.0 - 0.045) * 2.0**52
"""The bits of 1.0 read as an integer, less what makes the error of `root`'s guess smallest."""


@inlined_kernel
def relative_tangent(x):
    """tanh(x) / x to 1e-14 relative for x >= 0, without a branch and with a single division.

    Lambert's continued fraction of tanh(x / 4), cut after eight levels, and the doubling formula twice, all kept as
    numerator over denominator.

    Parameters
    ----------
    x
        Slip over transition velocity; a float or lanes.

    Returns
    -------
    float or lanes
        Between 0 and 1; one where x is 0.
    """
    y = 0.25 * min(x, 20.0)
    z = y * y
    top = 2027025.0 + z * (270270.0 + z * (6930.0 + z * 36.0))
    bottom = 2027025.0 + z * (945945.0 + z * (51975.0 + z * (630.0 + z)))
    top, bottom = 2.0 * top * bottom, bottom * bottom + z * (top * top)
    top, bottom = 2.0 * top * bottom, bottom * bottom + z * (top * top)
    saturated = x > 20.0  # tanh(20) is 1 in double precision
    return select(saturated, 1.0, 0.25 * top) / select(saturated, x, bottom)


@inlined_kernel
def hyperbolic_tangent(x):
    """Regularised sign of the paper's Fig. 4 and Eq. 3: tanh(x) to 1e-14 relative, odd, in a form that vectorises.

    It is a third of the price of the C library's function in a loop that the compiler can vectorise.

    Parameters
    ----------
    x
        Slip over transition velocity; any finite number, or lanes.
    """
    return x * relative_tangent(abs(x))


@inlined_kernel
def root(x, order):
    """Third or ninth root of x >= 0, a float or lanes, to 1e-15 relative: three steps of Halley from a bit trick."""
    x = max(x, 1e-250)
    y = root_guess(x, 1.0 / order, (1.0 - 1.0 / order) * _BITS_OF_ONE)
    for _ in range(3):  # the guess is good to 4 %, a step leaves at most 7 times the cube of an error
        cube = y * y * y
        power = cube if order == 3 else cube * cube * cube
        y = y * (((order - 1.0) * power + (order + 1.0) * x) / ((order + 1.0) * power + (order - 1.0) * x))
    return y


@inlined_kernel
def contact_secant(stiffness, exponent, penetration):
    """Contact force of Eq. 2 over the penetration: C delta^(m - 1)."""
    if exponent == 1.5:
        return stiffness * math.sqrt(penetration)
    if exponent == 10.0 / 9.0:
        return stiffness * root(penetration, 9)
    return stiffness * penetration ** (exponent - 1.0)


@inlined_kernel
def contact_force(stiffness, exponent, penetration):
    """Elastic contact force, Eq. 2: f_n = C delta^m for delta > 0."""
    return contact_secant(stiffness, exponent, penetration) * penetration


@inlined_kernel
def contact_energy(elastic_force, exponent, penetration):
    """Energy stored in a contact: the integral of Eq. 2, f_n delta / (m + 1)."""
    return elastic_force * penetration * (1.0 / (exponent + 1.0))


@inlined_kernel
def damping_factor(damping, penetration_rate):
    """Hunt and Crossley's factor 1 + d delta' on the contact force, never below zero (a contact does not pull)."""
    return max(1.0 + damping * penetration_rate, 0.0)


@inlined_kernel
def secant_slope(magnitude, transition):
    """Slope tanh(v / v_st) / v of the regularised sign of Eq. 3 (Fig. 4) as a secant from the origin; finite at v = 0.

    A friction vector is -mu f_n times this slope times the slip, so its direction needs no division by zero.
    """
    steepest = 1.0 / transition
    return steepest * relative_tangent(steepest * magnitude)


@inlined_kernel
def tangent_slope(magnitude, transition):
    """Derivative of tanh(v / v_st) by v: almost zero in full slip."""
    steepest = 1.0 / transition
    value = hyperbolic_tangent(steepest * magnitude)
    return steepest * (1.0 - value * value)


@inlined_kernel
def spinning_lever(coefficient, normal_force):
    """Largest spinning moment over the normal force, Eq. 7: coefficient (3/8 mu_s a / f_n^(1/3)) times f_n^(1/3)."""
    return coefficient * root(normal_force, 3) if coefficient > 0.0 else 0.0 * normal_force


@inlined_kernel
def rolling_moment(coefficient, normal_force, lever):
    """Largest rolling resistance, Eq. 4: mu_r f_n D / 2 with the lever D / 2."""
    return coefficient * normal_force * lever
