"""Speed and accuracy: methods of known errors and prices give known fronts, prices and ratios; failures stay failures."""

from __future__ import annotations

import numpy as np
import pytest
from method_rows import EXACT, FINE, FIRST, JOINT, SECOND, STEPS, by_accuracy, cube_of, fixed

from tripod_doe.analyses.speed_accuracy.speed_accuracy import Known, SpeedAccuracySettings, speed_accuracy
from tripod_doe.analyses.speed_accuracy.timed_runs import BY_ACCURACY
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome


def analyse(*rows, **cubes):
    return speed_accuracy(
        {"scene": cube_of([row for part in rows for row in part])} | cubes, SpeedAccuracySettings(target=0.005)
    )


def price(result, method, name="price", case="scene"):
    return float(result[name].sel({"case": case, "method": method, "quantity": "axial_force"}))


def test_prices_at_the_target_are_those_of_the_power_laws():
    """Exact: logarithmic interpolation is exact on power laws; the reference is off by 1e-10."""
    result = analyse(FIRST, SECOND, EXACT)
    assert price(result, "implicit-euler") == pytest.approx(1e-3 / 5e-4, rel=1e-4)
    assert price(result, "bdf2") == pytest.approx(2e-3 / np.sqrt(0.005 / 1e4), rel=1e-4)
    assert price(result, "implicit-euler", "price_ratio") == pytest.approx(1 / np.sqrt(2), rel=1e-4)
    one = result.sel(case="scene", quantity="axial_force")
    assert str(one["default_method"].values) == "bdf2"
    assert str(one["best_method"].values) == "implicit-euler"
    assert float(one["default_over_best"]) == pytest.approx(np.sqrt(2), rel=1e-4)


def test_a_reference_is_known_by_what_another_method_differs_by():
    """Exact: errors 1e-7, 1e-10 and 1e-9 at the finest; the last two agree best, to 9e-10, and bdf2 is the dearer."""
    result = analyse(FIRST, SECOND, EXACT)
    assert str(result["reference"].values[0]) == "bdf2, step 1e-7, with rosenbrock"
    assert float(result["reference_error"][0, 0]) == pytest.approx(1e-9 - 1e-10, rel=1e-5)
    below = result["below_reference"].values[:, 0].astype(bool)
    assert (result["numerical_error"].values[below, 0] < 1e-9).all()
    assert below.sum() == 2


def test_runs_by_accuracy_are_the_default_and_no_witness():
    """They agree exactly with the finest of implicit Euler."""
    rows = fixed("implicit-euler", STEPS, lambda h: 10 * h, lambda h: 1e-3 / h, "rollers")
    rows += fixed("bdf2", FINE, lambda h: 1e4 * h**2, lambda h: 2e-3 / h, "rollers")
    rows += by_accuracy(1e-7, 20.0, "rollers")
    result = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    assert result["reference"].item() == "implicit-euler, step 1e-8, with bdf2"
    assert result["default_method"].item() == BY_ACCURACY
    own = result.isel(run=np.flatnonzero(result["run_method"].values == BY_ACCURACY))
    assert (own["is_default"].item(), own["described"].item()) == (1, "accuracy 0.02")


def test_a_model_of_no_step_and_no_tolerance_is_left_out():
    """Regression: the step of a workflow ended with a broadcast error of numpy."""
    rows = fixed("implicit-euler", STEPS, lambda h: 10 * h, lambda h: 1e-3 / h, "rollers")
    rows += fixed("newton", [np.nan], lambda h: 0.1, lambda h: 1.0, "equilibrium")
    cube = cube_of(rows, JOINT, "thrust_amplitude")
    cube = cube.assign_coords(accuracy=("point", np.full(cube.sizes["point"], np.nan)))
    result = speed_accuracy({"joint": cube}, SpeedAccuracySettings())
    assert result["case_model"].values.tolist() == ["rollers"]


def test_one_method_alone_has_no_reference():
    result = analyse(FIRST)
    assert str(result["reference"].values[0]) == ""
    assert np.isnan(result["numerical_error"]).all()
    assert np.isnan(result["price"]).all()


def test_the_front_has_no_run_that_another_beats_in_both():
    result = analyse(FIRST, SECOND, EXACT)
    error = np.maximum(result["numerical_error"].values[:, 0], float(result["reference_error"][0, 0]))
    cost, front = result["cpu_per_second"].values, result["front"].values[:, 0].astype(bool)
    for at in range(error.size):
        beaten = (cost <= cost[at]) & (error <= error[at]) & ((cost < cost[at]) | (error < error[at]))
        assert front[at] == (not beaten.any())


def test_failures_keep_their_price_and_their_reason():
    limit = fixed("rk4", [1e-7], lambda h: 0, lambda h: 3e4, outcome=Outcome.EVALUATION_LIMIT)
    wrong = fixed("symplectic-euler", [1e-6, 1e-7], lambda h: 0, lambda h: 1e-4 / h, outcome=Outcome.INACCURATE)
    result = analyse(FIRST, SECOND, EXACT, limit, wrong)
    failed = result["outcome"].values != Outcome.FINISHED
    assert np.isnan(result["numerical_error"].values[failed]).all()
    assert np.isfinite(result["cpu_per_second"].values[failed]).all()
    assert set(result["outcome_detail"].values[failed]) == {"it chatters"}
    assert not result["front"].values[failed].any()
    known = {m: Known(int(price(result, m, "price_known"))) for m in ("rk4", "symplectic-euler", "rosenbrock", "bdf2")}
    assert known == {
        "rk4": Known.PRICE_ONLY,
        "symplectic-euler": Known.FAILED,
        "rosenbrock": Known.INTERPOLATED,
        "bdf2": Known.INTERPOLATED,
    }
    assert price(result, "rk4") == pytest.approx(3e4)
    assert np.isnan(price(result, "symplectic-euler"))


def test_bounds_are_called_bounds():
    good = fixed("bdf2", [1e-5, 1e-6], lambda h: h, lambda h: 1 / h)
    bad = fixed("implicit-euler", [1e-1, 1e-2], lambda h: 10 * h, lambda h: 1 / h)
    result = analyse(good, bad, EXACT)
    assert Known(int(price(result, "bdf2", "price_known"))) is Known.AT_MOST
    assert price(result, "bdf2") == pytest.approx(1e5)
    assert Known(int(price(result, "implicit-euler", "price_known"))) is Known.NOT_REACHED


def test_a_price_that_stability_sets_is_called_so():
    good = fixed("bdf2", [1e-5, 1e-6], lambda h: h, lambda h: 1 / h)
    failed = fixed("bdf2", [1e-4], lambda h: 0, lambda h: 1 / h, outcome=Outcome.DIVERGED)
    result = analyse(good, failed, EXACT)
    assert Known(int(price(result, "bdf2", "price_known"))) is Known.LIMITED
    assert price(result, "bdf2") == pytest.approx(1e5)


def test_repetitions_are_one_run_with_a_spread():
    slow = [(*row[:5], 3 * row[5], row[6]) for row in FIRST]
    result = analyse(FIRST, slow, FIRST, SECOND, EXACT)
    assert result.sizes["run"] == len(FIRST) + len(SECOND) + len(EXACT)
    first = result.isel(run=0)
    assert int(first["repetitions"]) == 3
    assert float(first["cpu_per_second"]) == pytest.approx(0.1)
    assert float(first["cpu_per_second_high"]) == pytest.approx(0.3)


def test_a_model_and_a_method_that_all_runs_share_keep_their_names():
    """Regression: words that were no factors were cut to their first letter, which is no model."""
    joint = cube_of(by_accuracy(0.0, 1.0, "rollers"), JOINT, "thrust_amplitude").drop_vars("model")
    joint.attrs["fixed_parameters"] = '{"model": "rollers"}'
    roller = cube_of(FIRST).drop_vars("method").assign_attrs(fixed_parameters='{"method": "implicit-euler"}')
    result = speed_accuracy({"joint": joint, "roller": roller}, SpeedAccuracySettings())
    assert list(result["case"].values) == ["joint rollers", "roller"]
    assert {*result["run_method"].values} == {BY_ACCURACY, "implicit-euler"}


def test_runs_at_other_points_are_no_repetitions():
    """Regression: runs at 5 and at 10 deg counted as repetitions of one run, with the error of the first."""
    cube = cube_of(FIRST).assign_coords(tilt_deg=("point", np.arange(len(FIRST), dtype=float)))
    with pytest.raises(InputError, match="scene: runs at one point are compared, but tilt_deg varies; make a step"):
        speed_accuracy({"scene": cube}, SpeedAccuracySettings())


def test_model_error_is_the_difference_to_the_finest_model():
    """Exact: rollers are 4 % off by themselves, whatever their numerical error, which counts from their own truth."""
    rows = []
    for model, off in (("rollers", 0.04), ("needles", 0.0)):
        rows += fixed("implicit-euler", STEPS, lambda h, off=off: off + 10 * h, lambda h: 1e-3 / h, model)
        rows += fixed("bdf2", FINE, lambda h, off=off: off + 1e4 * h**2, lambda h: 2e-3 / h, model)
    result = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    third = result.sel(quantity="third_order")
    fine = (third["run_method"] == "bdf2") & (third["setting"] == 1e-7)
    assert third["model_error"].values[fine & (third["model"] == "rollers")] == pytest.approx(0.04, rel=1e-5)
    assert third["model_error"].values[fine & (third["model"] == "needles")] < 1e-6
    assert (third["numerical_error"].values[fine] < 1e-6).all()
    assert list(result["case"].values) == ["joint rollers", "joint needles"]


def test_a_numerical_error_that_cancels_the_models_is_no_merit():
    """Exact: a run of the cheap model, 4 % off by itself, that is right by chance, is not on the front."""
    rows = []
    for model, off in (("rollers", 0.04), ("needles", 0.0)):
        rows += fixed("implicit-euler", STEPS, lambda h, off=off: off + 10 * h, lambda h: 1e-3 / h, model)
        rows += fixed("bdf2", FINE, lambda h, off=off: off + 1e4 * h**2, lambda h: 2e-3 / h, model)
    rows += fixed("rk4", [1e-3], lambda h: 0.001, lambda h: 5.0, "rollers")
    result = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    chance = result.sel(quantity="third_order").isel(run=np.flatnonzero(result["run_method"] == "rk4"))
    assert float(chance["model_error"][0]) == pytest.approx(0.001, rel=1e-3)
    assert int(chance["model_front"][0]) == 0


def test_a_cube_without_costs_is_refused():
    with pytest.raises(InputError, match="scene: this cube has no costs"):
        speed_accuracy({"scene": cube_of(FIRST).drop_vars("simulated_seconds")}, SpeedAccuracySettings())


def test_a_cube_without_quantities_is_refused():
    with pytest.raises(InputError, match="none of thrust_amplitude"):
        speed_accuracy({"scene": cube_of(FIRST).drop_vars("axial_force_n")}, SpeedAccuracySettings())
