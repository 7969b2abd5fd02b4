"""Sensitivity analyses: which factor makes an output vary, by how much, and how well that is known."""

from tripod_doe.analysis.sensitivity import distributions, elementary, fourier, shapley, variance_based
from tripod_doe.analysis.sensitivity.distributions import (
    SAMPLED_DESIGNS,
    DeltaSettings,
    PawnSettings,
    borgonovo_delta,
    pawn_indices,
)
from tripod_doe.analysis.sensitivity.effects import EFFECT_DESIGNS, EffectsSettings, factorial_effects
from tripod_doe.analysis.sensitivity.elementary import (
    DgsmSettings,
    MorrisSettings,
    derivative_measures,
    morris_effects,
)
from tripod_doe.analysis.sensitivity.fourier import FastSettings, RbdFastSettings, fast_indices, rbd_fast_indices
from tripod_doe.analysis.sensitivity.shapley import ShapleySettings, shapley_effects
from tripod_doe.analysis.sensitivity.variance_based import SobolSettings, sobol_indices

__all__ = [
    "EFFECT_DESIGNS",
    "RANKED",
    "SAMPLED_DESIGNS",
    "DeltaSettings",
    "DgsmSettings",
    "EffectsSettings",
    "FastSettings",
    "MorrisSettings",
    "PawnSettings",
    "RbdFastSettings",
    "ShapleySettings",
    "SobolSettings",
    "borgonovo_delta",
    "derivative_measures",
    "factorial_effects",
    "fast_indices",
    "morris_effects",
    "pawn_indices",
    "rbd_fast_indices",
    "shapley_effects",
    "sobol_indices",
]

RANKED = {
    "sobol": variance_based.METHOD.ranked,
    "morris": elementary.MORRIS.ranked,
    "dgsm": elementary.DGSM.ranked,
    "fast": fourier.FAST.ranked,
    "rbd-fast": fourier.RBD_FAST.ranked,
    "pawn": distributions.PAWN.ranked,
    "delta": distributions.DELTA.ranked,
    "shapley": shapley.METHOD.ranked,
    "multifidelity": variance_based.METHOD.ranked,
}
"""The index by which each kind of analysis ranks the factors, if it has indices."""
