"""Factors on a logarithmic scale: regressions, sentences and figures use it, and say so."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.findings import find
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.main_effects.main_effects import factor_effects
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.main_results import logarithmic_factors, spaced_by_ratios
from tripod_doe.study.cube.dataset import RESPONSE_ROLE

_LOG = 'x = { low = 1, high = 1000, distribution = "log-uniform" }\n'
_NOISE = 0.02


def _columns(ratio: float, seed: int, count: int = 70) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    place = (random.permutation(count) + random.random(count)) / count
    return {"x": ratio**place, "z": random.random(count)}


def _cube(columns: dict[str, np.ndarray], values: np.ndarray, factors: str = _LOG) -> xr.Dataset:
    coords = {name: ("point", column, {"source": "user function"}) for name, column in columns.items()}
    return xr.Dataset(
        {
            "own": ("point", values, {"role": RESPONSE_ROLE, "long_name": "own"}),
            "outcome": ("point", np.full(values.size, Outcome.FINISHED, np.int8)),
        },
        coords=coords,
        attrs={"study": f'[study]\nname = "t"\n[factors]\n{factors}z = {{ low = 0, high = 1 }}\n'},
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "course",
    [
        lambda u: u,
        lambda u: 10**u / 10,
        lambda u: 10 ** (u / 2) / 3,
        lambda u: 10**-u,
        lambda u: (2 * u - 1) ** 2 + u / 2,
        lambda u: np.maximum(0, u - 0.6),
    ],
    ids=["log", "linear", "power law", "inverse", "quadratic in log", "bend"],
)
def test_intervals_hold_the_rise_and_the_ends_above_the_middle(course, seed):
    """Exact truth. Regression: "the ends lie 0.43 +- 0.24 above the middle" where they lie 0.06 above it."""
    columns = _columns(10.0, seed)
    noise = _NOISE * np.random.default_rng(seed).normal(size=70)
    values = course(np.log10(columns["x"])) + 0.3 * columns["z"] + noise
    fit = next(each.fit for each in factor_effects(columns, values, logarithmic={"x"}) if each.factor == "x")
    low, high = np.log10([columns["x"].min(), columns["x"].max()])
    wide = 1.6  # 95 % intervals to 99.9 %
    assert abs(fit.trend.value - (course(high) - course(low))) <= wide * fit.trend.half
    assert abs(fit.bend.value - (course(low) + course(high)) / 2 + course((low + high) / 2)) <= wide * fit.bend.half


def test_a_logarithm_is_straight_over_a_logarithmic_scale_and_a_square_of_it_is_curved():
    """Regression: over numbers as they are, a logarithm was curved, by an amount that depends on the sample."""
    columns = _columns(1000.0, 1)
    place = np.log10(columns["x"]) / 3
    noise = _NOISE * np.random.default_rng(2).normal(size=place.size)
    straight = [each for each in find(_cube(columns, place + noise)) if "over x" in each or "with x" in each]
    assert any("increases with x, by 0.9" in each or "increases with x, by 1.0" in each for each in straight)
    assert not any("curved" in each for each in straight)
    (curved,) = [each for each in find(_cube(columns, (2 * place - 1) ** 2 + noise)) if "curved over x" in each]
    assert "above the middle of its logarithmic scale (" in curved


def test_figures_have_a_logarithmic_axis_and_say_so():
    columns = _columns(1000.0, 1)
    (group,) = effect_charts(_cube(columns, np.log(columns["x"])))
    over_x, over_z = group.charts
    assert "; logarithmic axis." in over_x.caption
    assert "logarithmic" not in over_z.caption
    assert [each.figure.axes[0].get_xscale() for each in group.charts] == ["log", "linear"]
    levels = over_x.data["x"].to_numpy()
    np.testing.assert_allclose(levels[1:] / levels[:-1], 1000**0.1, rtol=0.1)  # geometric means of ten equal classes


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (_LOG, True),
        ('x = { low = 1, high = 1000, scale = "log" }\n', True),
        ("x = { low = 1, high = 1000 }\n", False),
        ("x = { mean = 1, std = 0.1 }\n", False),
        ("", True),
    ],
    ids=["distribution", "scale", "uniform", "normal", "data alone"],
)
def test_the_study_decides_the_scale_and_the_spacing_where_it_names_none(table, expected):
    columns = _columns(1000.0, 1)
    assert ("x" in logarithmic_factors(_cube(columns, columns["z"], table))) is expected
    assert "z" not in logarithmic_factors(_cube(columns, columns["z"], table))


@pytest.mark.parametrize(
    ("levels", "expected"),
    [
        ([1, 10, 100], True),
        ([10, 20, 50, 100], True),
        ([5, 10, 15, 20, 25, 30, 35, 40], False),
        ([1, 2, 4], False),  # both scales look alike
        ([0, 1, 10, 100], False),
        ([-100, -10, -1], False),
        ([1, 100], False),
    ],
)
def test_levels_by_ratios(levels, expected):
    assert spaced_by_ratios(np.array(levels)) is expected
