"""Tolerances: quantiles, probabilities and gains of functions whose distribution is known."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm

from tripod_doe.analyses.sample import Sample
from tripod_doe.analyses.tolerance.sentences import find_in_tolerance
from tripod_doe.analyses.tolerance.shifting import shift_to_keep
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study import parse_study
from tripod_doe.study.definition.study_file import DesignTable, FactorTable
from tripod_doe.study.designs import make_points

TEXT = """
[study]
name = "t"
[factors]
joint_angle_deg = {distribution = "normal", mean = 10, std = 0.3}
torque_n_m = {distribution = "normal", mean = 50, std = 0.4}
speed_rpm = {low = 500, high = 700}
[design]
kind = "sobol"
samples = 4096
seed = 1
"""


def cube_of(function, text=TEXT):
    columns = make_points(parse_study(text)).columns
    values = function(*columns.values())
    return xr.Dataset(
        {"y": ("point", values), "outcome": ("point", np.full(values.size, Outcome.FINISHED, np.int8))},
        coords={"point": np.arange(values.size)} | {name: ("point", column) for name, column in columns.items()},
        attrs={"study": text},
    )


def test_a_sum_of_normal_factors_has_its_distribution():
    """Exact: N(60, 0.5); half of 0.4 leaves sqrt(0.3^2 + 0.2^2), half of 0.3 sqrt(0.15^2 + 0.4^2) of 0.5."""
    cube = cube_of(lambda angle, torque, speed: angle + torque + 0 * speed)
    found = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": 61}))
    exact = norm(60, 0.5)
    for probability in (0.05, 0.5, 0.95, 0.99):
        at = found.sel(probability=probability)
        assert float(at["quantile_low"]) <= exact.ppf(probability) <= float(at["quantile_high"])
    assert float(found["exceedance_low"]) <= exact.sf(61) <= float(found["exceedance_high"])
    gain, half = found["gain_of_halving"], found["gain_of_halving_conf"]
    for factor, left in (("torque_n_m", np.hypot(0.3, 0.2)), ("joint_angle_deg", np.hypot(0.15, 0.4))):
        assert float(gain.sel(factor=factor)) == pytest.approx(1 - left / 0.5, abs=float(half.sel(factor=factor)))
        halved = float(found["exceedance_if_halved"].sel(factor=factor))
        assert halved == pytest.approx(norm(60, left).sf(61), abs=0.006)
    assert abs(float(gain.sel(factor="speed_rpm"))) <= float(half.sel(factor="speed_rpm"))


def test_the_distribution_is_that_of_the_points():
    """Exact: as many of the points are below a value as its share says, from the first half per cent to the last."""
    cube = cube_of(lambda angle, torque, speed: angle + torque + 0 * speed)
    curve = tolerance(cube, ToleranceSettings(outputs=["y"]))["distribution"]
    below = (cube["y"].values[:, None] < curve.values).mean(axis=0)
    np.testing.assert_allclose(below, curve["share"], atol=1 / 4096)
    assert curve["share"].values[[0, -1]].tolist() == [0.005, 0.995]


@pytest.mark.parametrize(
    ("scatter", "left"),
    [
        ("{low = 5, high = 15}", 0.5),
        ('{distribution = "triangular", low = 5, high = 15, mode = 10}', 0.5),
        ('{distribution = "truncated-normal", low = 5, high = 15, mean = 10, std = 3}', 0.5),
        ('{distribution = "discrete", values = [5, 10, 15]}', np.nan),
    ],
)
def test_half_the_scatter_is_half_the_standard_deviation(scatter, left):
    """Exact: of a proportional output, for every symmetric distribution; listed values have no half."""
    text = TEXT.replace('{distribution = "normal", mean = 10, std = 0.3}', scatter)
    cube = cube_of(lambda angle, torque, speed: 2 * angle + 0 * torque + 0 * speed, text)
    found = tolerance(cube, ToleranceSettings(outputs=["y"]))
    gain = float(found["gain_of_halving"].sel(factor="joint_angle_deg"))
    assert gain == pytest.approx(1 - left, abs=0.01, nan_ok=True)
    assert np.isnan(found["exceedance"])


def test_a_quantile_beyond_the_sample_has_no_bound():
    cube = cube_of(lambda angle, torque, speed: angle + 0 * (torque + speed), TEXT.replace("4096", "16"))
    found = tolerance(cube, ToleranceSettings(outputs=["y"], probabilities=[0.5, 0.99]))
    assert np.isfinite(found["quantile_high"].values).tolist() == [True, False]


def test_a_limit_of_nothing_is_refused():
    cube = cube_of(lambda angle, torque, speed: angle + torque + speed)
    with pytest.raises(InputError, match=r"limits: 'z' is no output"):
        tolerance(cube, ToleranceSettings(outputs=["y"], limits={"z": 1}))


@pytest.mark.parametrize("middle", [-137.0, 179.0, -180.0, 0.0, 95.5])
@pytest.mark.parametrize("off", [-8.0, 7.0])
def test_a_phase_is_where_the_points_are(middle, off):
    """Exact: a distribution of phases is that of the same numbers without a wrap, turned to where the phases are."""

    def numbers(angle, torque, speed):
        return 20 * (angle - 10) + 0 * (torque + speed)

    limit = float(180 - (180 - middle - off) % 360)
    plain = tolerance(cube_of(numbers), ToleranceSettings(outputs=["y"], limits={"y": off}))
    cube = cube_of(lambda *columns: 180 - (180 - middle - numbers(*columns)) % 360)
    cube["y"].attrs["wraps_at"] = "+-180 degree"
    phases = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": limit}))
    assert float(phases["limit"]) == limit
    for key in ("exceedance", "exceedance_low", "exceedance_high", "exceedance_if_halved", "std", "gain_of_halving"):
        np.testing.assert_allclose(phases[key], plain[key], atol=1e-6)
    for key in ("mean", "quantile", "quantile_low", "quantile_high", "distribution"):
        gap = (phases[key] - plain[key] - middle + 180) % 360 - 180
        np.testing.assert_allclose(gap, 0, atol=0.02)  # the circular mean of the points is not their mean
        assert (phases[key] > -180).all()
        assert (phases[key] <= 180).all()


def test_how_far_a_scatter_must_shrink_to_keep_a_limit():
    """Exact: N(60, 0.5) exceeds 61 with 2.3 %; 1 % is left at a deviation of 0.43, so at 0.77 of 0.4 beside 0.3."""
    cube = cube_of(lambda angle, torque, speed: angle + torque + 0 * speed)
    result = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": 61}))
    scale = result["scale_to_keep"]
    allowed = 1 / norm.isf(0.01)
    torque = np.sqrt(allowed**2 - 0.3**2) / 0.4
    assert float(scale.sel(factor="torque_n_m", factor_2="torque_n_m")) == pytest.approx(torque, abs=0.06)
    both = float(scale.sel(factor="torque_n_m", factor_2="joint_angle_deg"))
    assert both == pytest.approx(allowed / 0.5, abs=0.06)
    assert np.isnan(scale.sel(factor="speed_rpm", factor_2="speed_rpm"))
    said = " ".join(find_in_tolerance(result, "t"))
    assert "To keep y within 61 with 99 %, it is enough that torque scatters" in said


def test_two_scatters_where_one_is_not_enough():
    """Exact: with one scatter gone 2.8 % or more exceed 60.8; torque and speed at 0.3 leave a deviation of 0.334, 0.8 %."""
    cube = cube_of(lambda angle, torque, speed: angle + torque + 0.5 * (speed - 600) / 100)
    result = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": 60.8}))
    scale = result["scale_to_keep"]
    assert all(np.isnan(scale.values[k, k]) for k in range(3))
    assert 0.25 < float(scale.sel(factor="torque_n_m", factor_2="speed_rpm")) < 0.45
    said = " ".join(find_in_tolerance(result, "t"))
    assert "no single scatter suffices" in said


def test_how_far_a_nominal_value_must_move_to_keep_a_limit():
    """Exact: N(60, 0.5) exceeds 61 with 1 % where its mean is 59.837, 0.163 lower."""
    cube = cube_of(lambda angle, torque, speed: angle + torque + 0 * speed)
    result = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": 61}))
    shift = result["shift_to_keep"]
    for factor in ("joint_angle_deg", "torque_n_m"):
        assert float(shift.sel(factor=factor)) == pytest.approx(-0.163, abs=0.04)
    assert np.isnan(shift.sel(factor="speed_rpm"))
    assert "move the nominal value of joint angle by -0.1" in " ".join(find_in_tolerance(result, "t"))


def test_the_cheapest_scatters_keep_a_limit():
    """Exact: of a scatter of 0.3 beside one of 0.4, 0.158 must be left where the other stays; it costs a tenth of the other."""
    cube = cube_of(lambda angle, torque, speed: angle + torque + 0 * speed)
    costs = {"joint_angle_deg": 1, "torque_n_m": 10}
    result = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": 61}, costs=costs))
    scale = result["cheapest_scale"]
    assert float(scale.sel(factor="torque_n_m")) == float(scale.sel(factor="speed_rpm")) == 1
    assert float(scale.sel(factor="joint_angle_deg")) == pytest.approx(0.158 / 0.3, abs=0.06)
    assert float(result["cheapest_cost"]) == pytest.approx(1 / float(scale.sel(factor="joint_angle_deg")) - 1)
    dear = tolerance(
        cube, ToleranceSettings(outputs=["y"], limits={"y": 61}, costs={"joint_angle_deg": 10, "torque_n_m": 10})
    )
    assert float(dear["cheapest_scale"].sel(factor="torque_n_m")) < 0.95
    with pytest.raises(InputError, match="costs: 'torque' is no factor"):
        tolerance(cube, ToleranceSettings(outputs=["y"], costs={"torque": 1}))


def test_a_uniform_scatter_is_not_moved_beyond_what_is_known():
    """Exact: of uniform angles, shifting by a tenth of the range leaves a tenth unknown, which counts as beyond the limit."""
    unit = np.random.default_rng(3).random(4000)
    table = FactorTable(low=0.0, high=1.0)
    sample = Sample(DesignTable(kind="latin-hypercube", samples=4000), {"x": table}, {"x": unit}, np.arange(4000), 1, 0)
    moved = shift_to_keep(sample, unit[:, None], np.array([0.95]), 0.99)
    assert np.isnan(moved).all()
