"""Laws of contact: elastic force, its energy and damping (Eq. 2). The joint's constants are in `contact_stiffness`.

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
def damping_factor(damping, penetration_rate):
    """Hunt and Crossley's factor 1 + d delta' on the contact force, never below zero (a contact does not pull)."""
    return max(1.0 + damping * penetration_rate, 0.0)
