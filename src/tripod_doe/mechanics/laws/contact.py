"""Laws of contact: elastic force, its energy and damping (Eq. 2). The joint's constants are in `contact_stiffness`.

Damping. A dry contact loses energy with its elastic force F (Hunt and Crossley), a greased one with its stiffness:

    f = F + D F delta' + g,  g = y / sqrt(1 + (y / F)^2),  y = tau dF/d delta delta'

so that |g| < F: a contact does not pull, and a new contact, whose stiffness grows at once, starts without a jump.
Without this limit needle impacts cost twice the iterations. D delta' is limited so that f never pulls.

Compiled functions of floats or of `simd_lanes`, without branches on them.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.arithmetic.elementary_functions import root
from tripod_doe.mechanics.compilation.kernels import inlined_kernel


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
def damped_force(elastic_force, dry, greased):
    """Contact force with damping, f of the module's formula; never below zero."""
    return max(elastic_force + dry + elastic_force * greased / _size(elastic_force, greased), 0.0)


@inlined_kernel
def damping_slope(elastic_force, greased):
    """Derivative dg/dy of the limited damping force of a greased contact."""
    share = elastic_force / _size(elastic_force, greased)
    return share * share * share


@inlined_kernel
def damped_stiffness(secant, exponent, factor, greased, elastic_force, penetration_rate):
    """Slope of the damped force by the penetration, where it is not zero; `secant` is the elastic one (Eq. 2)."""
    part = 1.0 / _size(elastic_force, greased)
    elastic = exponent * (1.0 + factor * penetration_rate + greased * part)
    limited = elastic_force * part
    return secant * (elastic - greased * part * limited * limited)


@inlined_kernel
def _size(elastic_force, greased):
    return math.sqrt(elastic_force * elastic_force + greased * greased + _NOTHING)


_NOTHING = 1e-200
"""Square of a negligible force, so that a contact without force has no damping."""
