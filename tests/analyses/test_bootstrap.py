"""Resampling for intervals."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from tripod_doe.analyses.bootstrap import random_halves
from tripod_doe.analyses.factorial_effects.factorial_effects import EffectsSettings
from tripod_doe.analyses.sensitivity.morris import MorrisSettings
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings


def test_halves_are_drawn_when_they_are_used():
    """Exact; regression: a list of all of them took the memory of the machine."""
    halves = random_halves(10, 10**12, 0)
    for half in (next(halves), next(halves)):
        assert half.size == np.unique(half).size == 5
        assert (np.diff(half) > 0).all()


def test_resamples_are_bounded():
    """Regression: a run of 400 cheap points went on without end in its analysis."""
    assert SensitivitySettings(resamples=10_000).resamples == 10_000
    with pytest.raises(ValidationError, match="10000"):
        SensitivitySettings(resamples=10_001)
    with pytest.raises(ValidationError, match="1000"):  # fewer were accepted, and 1000 taken
        MorrisSettings(resamples=999)


@pytest.mark.parametrize(
    ("settings", "key"),
    [(ToleranceSettings, "precision"), (EffectsSettings, "precision"), (EffectsSettings, "resamples")],
)
def test_keys_without_effect_are_refused(settings, key):
    """Regression: they were accepted, and changed nothing."""
    with pytest.raises(ValidationError, match="Extra inputs"):
        settings(**{key: 20})
