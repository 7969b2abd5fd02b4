"""A sample that is repeated at the settings of a grid gives no more independent points than it has."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tripod_doe.analyses.main_effects.main_effects import factor_effects
from tripod_doe.analyses.main_effects.repeated_sample import own_sample


def sample_of(columns, factor, response):
    codes = {name: np.unique(column, return_inverse=True)[1] for name, column in columns.items()}
    return own_sample(columns, codes, factor, response)


def crossed(seed):
    """Forty sample points of a, b and d, each at eight values of s; the response depends on a, b and s."""
    sample = np.random.default_rng(seed).random((40, 3))
    a, b, d = np.repeat(sample, 8, axis=0).T
    s = np.tile(np.arange(1.0, 9.0), 40)
    columns = {"a": a, "b": b, "d": np.round(d), "s": s}
    return columns, np.cos(14.6 * a) * np.sin(10.5 * b) + 0.01 * s * a + s


def test_a_factor_without_effect_has_none():
    """Regression: 10 of 10 reports stated an effect of a factor that the function does not read."""
    for seed in range(20):
        effects = {effect.factor: effect for effect in factor_effects(*crossed(seed))}
        fit = effects["d"].fit
        assert fit is not None
        assert not any([fit.trend.sure, fit.bend.sure, fit.level.size])
        assert (effects["d"].settings, effects["d"].of_settings) == (40, 320)


@pytest.mark.parametrize("lost", [0, 50])
def test_each_sample_point_counts_once(lost):
    """Exact: the response without the part of the grid; points that are lost change little."""
    columns, _ = crossed(1)
    kept = np.sort(np.random.default_rng(2).permutation(320)[lost:])
    additive = 3 * columns["a"] + columns["d"] + 100 * columns["s"] ** 2
    own, mean = sample_of({name: column[kept] for name, column in columns.items()}, "d", additive[kept])
    assert set(own) == {"a", "b", "d"}
    assert mean.size == 40
    line = 3 * own["a"] + own["d"]
    assert np.ptp(mean - line) == pytest.approx(0, abs=1e-9 if not lost else 1.0)


def test_other_designs_stay_as_they_are():
    sample = np.random.default_rng(0).random((60, 4))
    sample[:, 3] = np.round(sample[:, 3])
    half = np.array([row for row in itertools.product([0.0, 1.0], repeat=4) if sum(row) % 2 == 0])
    for points in (sample, half):
        columns = {f"x{at}": column for at, column in enumerate(points.T)}
        for name in columns:
            own, response = sample_of(columns, name, points[:, 0])
            assert own.keys() == columns.keys()
            assert response.tolist() == points[:, 0].tolist()
