"""Intervals of Morris' mean effects, from few trajectories, of calm and of extreme functions."""

from __future__ import annotations

import numpy as np
import pytest
from published import cube_of

from slow_cases import first_fast
from tripod_doe.analyses.sensitivity.morris import morris_effects
from tripod_doe.analyses.sensitivity.sentences import find_in_sensitivity


def product(u):
    return u[:, 0] * u[:, 1]


def heavy(u):
    return np.exp(3 * (u[:, 0] + u[:, 1]))


def corner(u):
    return (u[:, :2] > 0.8).all(axis=1).astype(float)


STEPS = np.array([0, 1, 2, 3]) / 3
LOW = STEPS[:2]
EXACT = {
    product: 0.5,
    heavy: np.mean((np.exp(3 * (LOW + 2 / 3)) - np.exp(3 * LOW)) * 1.5) * np.mean(np.exp(3 * STEPS)),
    corner: 1.5 / 8,
}
"""Mean effects of either factor over the grid of four levels and its steps of two thirds."""


@pytest.mark.slow
@pytest.mark.parametrize(("function", "least"), first_fast([(heavy, 0.85), (product, 0.9), (corner, 0.9)], 1))
def test_intervals_hold_as_often_as_they_say(function, least):
    """Statistic: of 60 designs of ten trajectories; normal intervals hold in 0.80 of the heavy ones."""
    hits = []
    for seed in range(60):
        found = morris_effects(cube_of(f'kind = "morris"\nsamples = 10\nseed = {seed}', function, width=2))
        half = found["mu_star_conf"].values
        hits += list((np.abs(found["mu_star"].values - EXACT[function]) <= half + 1e-12)[np.isfinite(half)])
    assert len(hits) >= 12
    assert np.mean(hits) >= least


def test_what_few_trajectories_show_has_no_interval_and_no_verdict():
    """Invariance: neither an effect that no trajectory varies nor one that a single trajectory shows is known."""

    def function(u):
        return 3 * u[:, 0] + corner(u[:, 1:3])

    stated = set()
    for seed in range(12):
        found = morris_effects(cube_of(f'kind = "morris"\nsamples = 10\nseed = {seed}', function))
        assert np.isnan(found["mu_star_conf"][0])
        assert np.isnan(found["samples_needed"])
        sentences = find_in_sensitivity(found, "morris")
        assert "No interval is known for the effect" in " ".join(sentences)
        assert not [each for each in sentences if "enough" in each]
        stated |= set(np.isfinite(found["mu_star_conf"].values[1:]).tolist())
    assert stated == {False, True}
