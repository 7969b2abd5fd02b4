"""Quantiles of sampled factors, held against values to many digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tripod_doe.errors import InputError
from tripod_doe.study.definition.distributions import quantile, scaled_table, scatter_density, shifted_table
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_file_schema import FactorTable

UNIT = np.array([0.0, 1e-9, 0.01, 0.3, 0.5, 0.9, 1 - 1e-9, 1.0])


def factor(mean, std, low=0.0, high=20.0):
    text = (
        '[study]\nname = "q"\n[factors.joint_angle_deg]\ndistribution = "truncated-normal"\n'
        f"mean = {mean!r}\nstd = {std!r}\nlow = {low!r}\nhigh = {high!r}\n[design]\nkind = 'sobol'\nsamples = 4\n"
    )
    return parse_study(text).factors["joint_angle_deg"]


# mean, std, low, high, and quantiles at 0.01, 0.5, 0.9 to twelve digits, by mpmath with 60 digits
EXACT = [
    (6.0, 1000.0, 0.0, 20.0, 0.19999854808166517, 9.99980000499997, 17.999879997220823),
    (6.0, 100000.0, 0.0, 20.0, 0.1999999998548, 9.99999998, 17.999999988),
    (15.0, 2.0, 0.0, 20.0, 10.342631786462695, 14.984434520183703, 17.5006689071807),
]


@pytest.mark.parametrize(("mean", "std", "low", "high", "expected"), [(*row[:4], row[4:]) for row in EXACT])
def test_quantiles_to_many_digits(mean, std, low, high, expected):
    result = quantile(factor(mean, std, low, high), np.array([0.01, 0.5, 0.9]))
    assert result == pytest.approx(expected, abs=1e-8 * (high - low), rel=0)


@pytest.mark.parametrize(("mean", "std"), [(5.0, 3.0), (5.0, 1e6), (1e7, 1e5), (-1.9e3, 2.0)])
def test_densities_are_those_of_the_quantiles(mean, std):
    result = factor(mean, std)
    scatter = scatter_density(result.table)
    values = quantile(result, np.linspace(0.001, 0.999, 20_001))
    between = (values[1:] + values[:-1]) / 2
    assert scatter.density(between) * np.diff(values) == pytest.approx(0.998 / 20_000, rel=0.01)
    assert scatter.density(np.array([-1.0, 21.0])).tolist() == [0, 0]


@pytest.mark.parametrize(
    ("mean", "std", "reason"),
    [
        (1e4, 1e-6, "mean = 10000: lies more than 1000 standard deviations outside"),
        (-2e4, 10.0, "mean = -20000: lies more than 1000"),
        (6.0, 3e6, "std = 3e\\+06: .* this distribution is uniform"),
        (6.0, 1.7e308, "this distribution is uniform"),
    ],
)
def test_a_range_out_of_reach_of_its_distribution_is_refused(mean, std, reason):
    with pytest.raises(InputError, match=reason):
        factor(mean, std)
    assert math.isclose(quantile(factor(10.0, 5e-324), np.array([0.3]))[0], 10.0)


@pytest.mark.parametrize(
    "table",
    [
        FactorTable(distribution="normal", mean=2.0, std=0.3),
        FactorTable(distribution="truncated-normal", mean=2.0, std=0.3, low=1.7, high=3.0),
        FactorTable(low=1.5, high=2.5),
        FactorTable(low=1.0, high=4.0, scale="log"),
        FactorTable(distribution="triangular", low=1.0, high=4.0, mode=1.5),
    ],
    ids=lambda table: table.sampled_as,
)
def test_a_table_scaled_or_moved_has_that_density(table):
    """Exact: f(c + (x - c) / s) / s, and f(x - d)."""
    before = scatter_density(table)
    at = np.linspace(0.2, 5, 500)
    x, width = (np.log(at), np.log(1.1)) if before.logarithmic else (at, 0.1)
    scaled, moved = scatter_density(scaled_table(table, 0.5)), before.density(x - width)
    expected = before.density(before.centre + (x - before.centre) / 0.5) / 0.5
    np.testing.assert_allclose(scaled.density(x), expected, rtol=1e-9, atol=1e-12)
    shift = np.exp(before.centre) * 0.1 if before.logarithmic else 0.1
    np.testing.assert_allclose(scatter_density(shifted_table(table, shift)).density(x), moved, rtol=1e-9, atol=1e-12)


def test_the_level_zero_of_a_trajectory_is_zero():
    """Regression: a level of -2.2e-16 in the tables of a morris design over -0.8 .. 1."""
    text = '[study]\nname = "q"\n[factors.initial_skew_1_deg]\nlow = -0.8\nhigh = 1.0\n[design]\nkind = "sobol"\nsamples = 4\n'
    levels = quantile(
        parse_study(text).factors["initial_skew_1_deg"], np.array([0.0, 0.8 / 1.8, 0.8 / 1.8 - 1e-16, 1.0])
    )
    assert levels.tolist() == [-0.8, 0, 0, 1]
    above = text.replace("-0.8", "1e-18")
    assert quantile(parse_study(above).factors["initial_skew_1_deg"], np.zeros(1)).tolist() == [1e-18]
