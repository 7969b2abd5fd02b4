"""Sensitivity: known functions give their known indices, and what failed never counts."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.sensitivity.morris import MorrisSettings, morris_effects
from tripod_doe.analyses.sensitivity.sentences import find_in_sensitivity
from tripod_doe.analyses.sensitivity.sobol import sobol_indices
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

TEXT = """
[study]
name = "t"
[factors]
joint_angle_deg = {low = 0, high = 1}
torque_n_m = {low = 0, high = 1}
speed_rpm = {low = 0, high = 1}
[design]
seed = 3
"""


def cube(kind, samples, **functions):
    text = TEXT + f'kind = "{kind}"\nsamples = {samples}\n'
    columns = make_points(parse_study(text)).columns
    x = np.stack(list(columns.values()), axis=1)
    outputs = {name: (("point", *dims), f(x)) for name, (dims, f) in functions.items()}
    outcome = ("point", np.full(len(x), Outcome.FINISHED, np.int8))
    return xr.Dataset(outputs | {"outcome": outcome}, coords={"point": np.arange(len(x))}, attrs={"study": text})


def additive(x):
    return x[:, 0] + 2 * x[:, 1]


def test_additive_function_has_its_exact_indices():
    """Exact: variances 1/12 and 4/12; 0.02 is the sampling error at N = 1024."""
    result = sobol_indices(cube("saltelli", 1024, y=((), additive)))
    assert result["S1"].sel(factor="joint_angle_deg") == pytest.approx(0.2, abs=0.02)
    assert result["ST"].sel(factor="torque_n_m") == pytest.approx(0.8, abs=0.02)
    assert result["ST"].sel(factor="speed_rpm") == pytest.approx(0, abs=1e-12)
    assert result["S2"].sel(factor="joint_angle_deg", factor_2="torque_n_m") == pytest.approx(0, abs=0.03)
    assert (result["ST_conf"].sel(factor=["joint_angle_deg", "torque_n_m"]) > 0).all()


def test_intervals_are_the_same_whenever_they_are_made():
    """Exact: resampling is seeded, by default too; and another seed gives other intervals."""
    data = cube("saltelli", 64, y=((), additive))
    xr.testing.assert_identical(sobol_indices(data), sobol_indices(data))
    other = sobol_indices(data, SensitivitySettings(seed=1))
    assert (other["ST_conf"] != sobol_indices(data)["ST_conf"]).any()


def test_few_samples_are_why_a_smooth_function_has_no_intervals():
    """Regression: a few of the 16 samples, which count alike, were said to cause most of the variance."""
    told = find_in_sensitivity(sobol_indices(cube("saltelli", 16, y=((), additive))), "own")
    assert "No intervals are known for y: too few samples make up its variance." in told


def test_every_component_and_output_gets_its_indices():
    def orders(x):
        return np.stack([x[:, 0], np.zeros(len(x)) + 5.0, x[:, 1]], axis=1)

    data = cube("saltelli", 256, a=(("order",), orders), b=((), additive)).assign_coords(order=[1, 2, 3])
    result = sobol_indices(data)
    assert result["ST"].dims == ("output", "factor", "order") or set(result["ST"].dims) == {"output", "factor", "order"}
    first = result["ST"].sel(output="a")
    assert first.sel(order=1, factor="joint_angle_deg") == pytest.approx(1, abs=0.05)
    assert first.sel(order=2).isnull().all()
    single = sobol_indices(data, SensitivitySettings(outputs=["a"]))
    assert set(single["S1"].dims) == {"factor", "order"}


def test_an_output_with_further_dimensions_stands_alone():
    """Exact: no answer is repeated along a dimension of another output, so each number stands there once."""

    def over(*shape):
        return lambda x: additive(x).reshape(-1, *(1,) * len(shape)) * np.ones(shape)

    data = cube(
        "saltelli",
        16,
        g=(("groove", "order"), over(3, 4)),
        a=(("order",), over(4)),
        b=(("order",), over(4)),
        plain=((), additive),
        power=(("mechanism",), over(5)),
        course=(("rotation_deg",), over(9)),
    )
    result = sobol_indices(data)
    assert result["ST"].sizes == {"output": 3, "factor": 3, "order": 4}
    assert result["output"].values.tolist() == ["a", "b", "plain"]
    assert result["g_ST"].sizes == {"factor": 3, "groove": 3, "order": 4}
    assert result["power_S2"].sizes == {"factor": 3, "factor_2": 3, "mechanism": 5}
    assert result["course_ST"].sizes == {"factor": 3, "rotation_deg": 9}
    np.testing.assert_allclose(result["g_ST"].sel(groove=2), result["ST"].sel(output="a"))
    assert result["g_ST"].attrs == result["ST"].attrs
    assert result.attrs["outputs"].startswith("a, b, plain, ")


def test_failed_points_take_their_whole_block_out():
    data = cube("saltelli", 512, y=((), additive))
    rng = np.random.default_rng(0)
    broken = rng.choice(data.sizes["point"], 40, replace=False)
    data["y"][broken] = np.nan
    data["outcome"][broken] = Outcome.DIVERGED
    result = sobol_indices(data)
    assert result.attrs["groups_dropped"] == len(set(broken // 8))
    assert result["ST"].sel(factor="torque_n_m") == pytest.approx(0.8, abs=0.05)
    assert np.isfinite(result["ST"]).all()
    data["outcome"][:] = Outcome.DIVERGED
    with pytest.raises(InputError, match="nothing to analyse"):
        sobol_indices(data)


def test_a_finished_point_without_a_number_takes_its_block_out():
    """Regression: a function that returns NaN made all indices NaN, and no block was said to be dropped."""
    data = cube("saltelli", 256, y=((), additive), never=((), lambda x: np.full(len(x), np.nan)))
    data["y"][5] = np.nan
    result = sobol_indices(data)
    assert result.attrs["groups_dropped"] == 1
    assert result["ST"].sel(output="y", factor="torque_n_m") == pytest.approx(0.8, abs=0.05)


def test_phases_do_not_wrap():
    def phase(x):
        return (175 + 10 * x[:, 0] + 180) % 360 - 180

    data = cube("saltelli", 128, p=((), phase))
    data["p"].attrs["wraps_at"] = "+-180 degree"
    assert sobol_indices(data)["ST"].sel(factor="joint_angle_deg") == pytest.approx(1, abs=0.05)


def test_morris_finds_slopes_and_curvature():
    """Exact: a linear function has mu = slope and sigma = 0; mu_star sees what mu cancels."""
    data = cube("morris", 40, y=((), lambda x: 3 * x[:, 0] - x[:, 1] + (x[:, 2] - 0.5) ** 2))
    result = morris_effects(data, MorrisSettings())
    assert result["mu"].values[:2] == pytest.approx([3, -1])
    assert result["sigma"].values[:2] == pytest.approx([0, 0], abs=1e-9)
    assert result["mu_star"].values[2] > 0.3
    assert abs(result["mu"].values[2]) < result["mu_star"].values[2]


def test_a_cube_of_another_design_is_refused():
    with pytest.raises(InputError, match="needs a morris design"):
        morris_effects(cube("saltelli", 8, y=((), additive)))
