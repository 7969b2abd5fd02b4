"""Laws of rolling and spinning resistance (Eq. 4, 6 and 7), as compiled functions of floats or of `simd_lanes`."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.elementary_functions import root
from tripod_doe.mechanics.compilation.kernels import inlined_kernel


@inlined_kernel
def spinning_lever(coefficient, normal_force):
    """Largest spinning moment over the normal force, Eq. 7: coefficient (3/8 mu_s a / f_n^(1/3)) times f_n^(1/3)."""
    return coefficient * root(normal_force, 3) if coefficient > 0.0 else 0.0 * normal_force


@inlined_kernel
def rolling_moment(coefficient, normal_force, lever):
    """Largest rolling resistance, Eq. 4: mu_r f_n D / 2 with the lever D / 2."""
    return coefficient * normal_force * lever
