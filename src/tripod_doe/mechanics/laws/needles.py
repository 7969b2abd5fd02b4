"""Friction of needles that roll between a trunnion and a bore, skewed by psi: they slip along their axes only.

Half the difference of speeds carries the needles round (planetary rolling), so the lever of the roller's spin is
r_e = r_b r_t / r_p by virtual power. A needle slips on trunnion and bore alike, by half of the sum.
"""

from __future__ import annotations

from tripod_doe.mechanics.compilation.kernels import inlined_kernel
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent


@inlined_kernel
def needle_slip(plunge, spin, lever, skew):
    """Slip of needles along their axes on trunnion and bore together: w cos psi - s r_e sin psi.

    Args:
        plunge, spin: Velocity w of the bore along the trunnion and spin s about it; floats or lanes.
        lever: r_e.
        skew: Its cosine and sine.
    """
    return plunge * skew[0] - spin * lever * skew[1]


@inlined_kernel
def needle_grip(slip, transition):
    """Share of the needles' largest friction at their slip on both partners: tanh(v / (2 v_st))."""
    return hyperbolic_tangent(slip * (0.5 / transition))
