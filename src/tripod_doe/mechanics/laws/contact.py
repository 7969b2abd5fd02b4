"""Laws of contact: elastic force, its energy and damping (Eq. 2). The joint's constants are in `contact_stiffness`.

Damping. A dry contact loses energy with its elastic force F (Hunt and Crossley), a greased one with its stiffness:

    f = F + c delta'    c = D F + tau dF/d delta    f >= 0: a contact does not pull

Compiled functions of floats or of `lanes`, without branches on them.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.arithmetic.lanes import root
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
def damping_coefficient(factor, time, elastic_force, stiffness):
    """Damping force over the penetration rate: D F + tau dF/d delta, from the elastic force and its slope."""
    return factor * elastic_force + time * stiffness


@inlined_kernel
def damped_force(elastic_force, coefficient, penetration_rate):
    """Contact force with damping, never below zero."""
    return max(elastic_force + coefficient * penetration_rate, 0.0)


@inlined_kernel
def damped_stiffness(factor, time, exponent, penetration, stiffness, penetration_rate):
    """Slope of a damped contact force by the penetration, from that of the elastic force; where it is not zero."""
    growing = time * (exponent - 1.0) / max(penetration, _SHALLOW)
    return stiffness * (1.0 + (factor + growing) * penetration_rate)


_SHALLOW = 1e-12
"""Penetration below which the damping's slope no longer grows: without contact there is none."""
