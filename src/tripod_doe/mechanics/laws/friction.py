"""Laws of friction: the regularised sign of a slip, tanh(v / v_st), and its slopes (Eq. 3, Fig. 4).

Compiled functions of floats or of `simd_lanes`, eight floats at a time, without branches on them. Units are mm, N, s, t
and rad; any consistent system works.
"""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.simd_lanes import select
from tripod_doe.mechanics.compilation.kernels import inlined_kernel


@inlined_kernel
def _relative_tangent(x):
    """Numerator and denominator of tanh(x) / x for x >= 0.

    Lambert's continued fraction of tanh(x / 4), cut after eight levels, and the doubling formula twice.
    """
    y = 0.25 * min(x, 20.0)
    z = y * y
    top = 2027025.0 + z * (270270.0 + z * (6930.0 + z * 36.0))
    bottom = 2027025.0 + z * (945945.0 + z * (51975.0 + z * (630.0 + z)))
    top, bottom = 2.0 * top * bottom, bottom * bottom + z * (top * top)
    top, bottom = 2.0 * top * bottom, bottom * bottom + z * (top * top)
    saturated = x > 20.0  # tanh(20) is 1 in double precision
    return select(saturated, 1.0, 0.25 * top), select(saturated, x, bottom)


@inlined_kernel
def relative_tangent(x):
    """tanh(x) / x to 1e-14 relative for x >= 0, without a branch and with a single division.

    Args:
        x: Slip over transition velocity; a float or lanes.

    Returns:
        Between 0 and 1; one where x is 0.
    """
    top, bottom = _relative_tangent(x)
    return top / bottom


@inlined_kernel
def relative_tangents(x, y):
    """`relative_tangent` of two numbers, with one division for both."""
    (top_x, bottom_x), (top_y, bottom_y) = _relative_tangent(x), _relative_tangent(y)
    over = 1.0 / (bottom_x * bottom_y)
    return top_x * (bottom_y * over), top_y * (bottom_x * over)


@inlined_kernel
def hyperbolic_tangent(x):
    """Regularised sign of the paper's Fig. 4 and Eq. 3: tanh(x) to 1e-14 relative, odd, in a form that vectorises.

    In a vectorised loop it costs a third of the C library's function.

    Args:
        x: Slip over transition velocity; any finite number, or lanes.
    """
    return x * relative_tangent(abs(x))


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
