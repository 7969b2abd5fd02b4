"""Sensitivity analyses: which factor makes an output vary, by how much, and how well that is known."""

from tripod_doe.analyses.sensitivity import distributions, fast, morris, shapley, sobol
from tripod_doe.analyses.sensitivity.distributions import (
    SAMPLED_DESIGNS,
    DeltaSettings,
    PawnSettings,
    borgonovo_delta,
    pawn_indices,
)
from tripod_doe.analyses.sensitivity.fast import FastSettings, RbdFastSettings, fast_indices, rbd_fast_indices
from tripod_doe.analyses.sensitivity.morris import (
    DgsmSettings,
    MorrisSettings,
    derivative_measures,
    morris_effects,
)
from tripod_doe.analyses.sensitivity.shapley import ShapleySettings, shapley_effects
from tripod_doe.analyses.sensitivity.sobol import SobolSettings, sobol_indices

__all__ = [
    "RANKED",
    "SAMPLED_DESIGNS",
    "DeltaSettings",
    "DgsmSettings",
    "FastSettings",
    "MorrisSettings",
    "PawnSettings",
    "RbdFastSettings",
    "ShapleySettings",
    "SobolSettings",
    "borgonovo_delta",
    "derivative_measures",
    "fast_indices",
    "morris_effects",
    "pawn_indices",
    "rbd_fast_indices",
    "shapley_effects",
    "sobol_indices",
]

RANKED = {
    "sobol": sobol.METHOD.ranked,
    "morris": morris.MORRIS.ranked,
    "dgsm": morris.DGSM.ranked,
    "fast": fast.FAST.ranked,
    "rbd-fast": fast.RBD_FAST.ranked,
    "pawn": distributions.PAWN.ranked,
    "delta": distributions.DELTA.ranked,
    "shapley": shapley.METHOD.ranked,
    "multifidelity": sobol.METHOD.ranked,
}
"""The index by which each kind of analysis ranks the factors, if it has indices."""
