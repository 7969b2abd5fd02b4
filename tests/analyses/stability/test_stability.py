"""Stability maps: borders that are known, references that must agree, and one small real study."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.analyses.stability.stability import (
    Agreement,
    Limit,
    RunKind,
    StabilitySettings,
    predicted_border,
    stability_borders,
)
from tripod_doe.errors import InputError
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Outcome

SETTINGS = StabilitySettings(output="drift_mm", limit=0.01)
STEPS = np.array([1e-8, 2e-8, 4e-8, 8e-8, 16e-8])
FRICTION = 2e8  # so that symplectic Euler's border is 1e-8 times the factor below
METHOD_NAMES = ["symplectic-euler", "linearly-implicit-euler", "bdf2"]


def cube(borders, silent=(), factor=(1.0, 4.0), friction=None, values=None):
    """A grid of three methods, STEPS and a mass: right up to the border of each (method, mass), else refused."""
    shape = (len(METHOD_NAMES), STEPS.size, len(factor))
    right = np.array(
        [[[step <= borders[name][k] for k in range(len(factor))] for step in STEPS] for name in METHOD_NAMES]
    )
    passed = np.array([name in silent for name in METHOD_NAMES])[:, None, None] | right
    value = np.where(right, 2.0, 3.0) if values is None else np.broadcast_to(values, shape)
    dims = ("method", "step_s", "needle_mass_factor")
    rates = {
        "friction_rate_per_s": friction or FRICTION / np.array(factor),
        "contact_rate_per_s": 1e6,
        "secant_lag_rate_per_s": 1e5,
    }
    return xr.Dataset(
        {
            "drift_mm": (dims, np.where(passed, value, np.nan), {"units": "mm"}),
            "outcome": (dims, np.where(passed, Outcome.FINISHED, Outcome.INACCURATE).astype(np.int8)),
            "outcome_detail": (dims, np.where(passed, "", "half the step changes the motion").astype(object)),
        }
        | {name: (dims, np.where(passed, np.broadcast_to(rate, shape), np.nan)) for name, rate in rates.items()},
        coords={"method": METHOD_NAMES, "step_s": STEPS, "needle_mass_factor": list(factor)},
    )


KNOWN = {"symplectic-euler": (1e-8, 4e-8), "linearly-implicit-euler": (1.0, 1.0), "bdf2": (1.0, 1.0)}


def cell(result, name, method, case):
    return result[name].sel({"method": method}).values[case]


def test_known_borders_come_back():
    result = stability_borders(cube(KNOWN), SETTINGS)
    for case, (low, high) in enumerate([(1e-8, 2e-8), (4e-8, 8e-8)]):
        assert cell(result, "border_low", "symplectic-euler", case) == pytest.approx(low)
        assert cell(result, "border_high", "symplectic-euler", case) == pytest.approx(high)
        assert cell(result, "border_predicted", "symplectic-euler", case) == pytest.approx(low)
        assert cell(result, "ratio", "symplectic-euler", case) == pytest.approx(math.sqrt(2))
        assert cell(result, "limited_by", "symplectic-euler", case) == Limit.FRICTION
        assert cell(result, "agrees", "symplectic-euler", case) == Agreement.YES
        assert cell(result, "first_failure", "symplectic-euler", case) == Outcome.INACCURATE
        assert cell(result, "first_detail", "symplectic-euler", case) == "half the step changes the motion"
        assert cell(result, "border_high", "bdf2", case) == math.inf
        assert cell(result, "agrees", "bdf2", case) == Agreement.YES  # no border, and none found
        assert cell(result, "first_failure", "bdf2", case) == Outcome.NOT_RUN
        assert cell(result, "border_predicted", "linearly-implicit-euler", case) == pytest.approx(1e-7)
    # the lag's border lies within the steps but every run is right: beyond a factor of 1.5 that is a disagreement
    assert cell(result, "agrees", "linearly-implicit-euler", 0) == Agreement.YES
    strict = stability_borders(cube(KNOWN), SETTINGS.model_copy(update={"factor": 1.5}))
    assert cell(strict, "agrees", "linearly-implicit-euler", 0) == Agreement.NO
    assert result["varied"].values.tolist() == ["base", "needle_mass_factor"]


def test_a_border_elsewhere_disagrees():
    result = stability_borders(cube(KNOWN | {"symplectic-euler": (8e-8, 4e-8), "bdf2": (4e-8, 1.0)}), SETTINGS)
    assert cell(result, "agrees", "symplectic-euler", 0) == Agreement.NO
    assert cell(result, "agrees", "symplectic-euler", 1) == Agreement.YES
    assert cell(result, "agrees", "bdf2", 0) == Agreement.NO  # theory has none


def test_a_wrong_number_that_passed_is_counted():
    result = stability_borders(cube(KNOWN, silent=("symplectic-euler",)), SETTINGS)
    assert cell(result, "first_failure", "symplectic-euler", 0) == Outcome.FINISHED
    assert cell(result, "wrong_runs", "symplectic-euler", 0) == 4
    kinds = result["run_kind"].sel({"method": "symplectic-euler"}).values[0]
    assert kinds.tolist() == [RunKind.GOOD] + [RunKind.WRONG] * 4
    assert result["error"].sel({"method": "symplectic-euler"}).values[0, -1] == pytest.approx(0.5)


def test_zero_is_a_reference():
    """Regression: 0 over 0 is no number, and runs that gave the same zero as the reference counted as wrong."""
    result = stability_borders(cube(KNOWN, values=0.0), SETTINGS)
    assert (result["wrong_runs"] == 0).all()
    assert set(np.unique(result["run_kind"])) == {RunKind.GOOD, RunKind.REFUSED}
    assert cell(result, "border_low", "symplectic-euler", 0) == pytest.approx(STEPS[0])


def test_without_two_methods_that_agree_nothing_is_decided():
    apart = np.array([2.0, 2.1, 2.3])[:, None, None]
    result = stability_borders(cube(KNOWN, values=apart), SETTINGS)
    assert (result["run_kind"].values[:, :, 0] == RunKind.UNKNOWN).all()
    assert (result["agrees"].values == Agreement.NOT_DECIDED).all()
    assert np.isnan(result["ratio"].values).all()


def test_methods_that_agree_by_chance_are_no_reference():
    """Regression: three methods of first order at 20 % from the truth, two of them within 0.01 %, decided all runs."""
    growth = (STEPS / STEPS[0])[None, :, None]
    off = np.array([0.2, 0.2001, -0.25])[:, None, None]
    result = stability_borders(cube(dict.fromkeys(KNOWN, (1.0, 1.0)), values=2 * (1 + off * growth)), SETTINGS)
    assert (result["agrees"].values == Agreement.NOT_DECIDED).all()


def test_not_even_the_smallest_step():
    result = stability_borders(cube(KNOWN | {"symplectic-euler": (0.0, 0.0)}), SETTINGS)
    assert np.isnan(cell(result, "border_low", "symplectic-euler", 0))
    assert cell(result, "border_high", "symplectic-euler", 0) == pytest.approx(1e-8)
    assert cell(result, "agrees", "symplectic-euler", 0) == Agreement.YES  # theory: 1e-8
    assert cell(result, "agrees", "symplectic-euler", 1) == Agreement.NO  # 4e-8 by theory, but below 1e-8
    assert np.isnan(cell(result, "ratio", "symplectic-euler", 0))


def test_a_factor_that_differs_makes_its_own_map():
    """Points as of a product: a base, and one case each of two factors."""
    rows = [(1.0, 0.25), (4.0, 0.25), (1.0, 0.5)]
    points = [(m, s, *row) for m in METHOD_NAMES[1:] for s in STEPS for row in rows]
    columns = dict(
        zip(("method", "step_s", "needle_mass_factor", "transition_ratio"), zip(*points, strict=True), strict=True)
    )
    study = xr.Dataset(
        {"drift_mm": ("point", np.full(len(points), 2.0)), "outcome": ("point", np.zeros(len(points), np.int8))},
        coords={name: ("point", np.array(column)) for name, column in columns.items()},
    )
    result = stability_borders(study, SETTINGS)
    assert result["varied"].values.tolist() == ["base", "needle_mass_factor", "transition_ratio"]
    assert (cell(result, "limited_by", "linearly-implicit-euler", 0)) == Limit.UNKNOWN  # no rates were kept


@pytest.mark.parametrize(
    ("method", "border", "limit"),
    [
        ("symplectic-euler", 2 / 100.0, Limit.FRICTION),
        ("rk4", 2.785 / 100, Limit.FRICTION),
        ("linearly-implicit-euler", 0.01 / 5, Limit.LAG),
        ("implicit-euler", math.inf, Limit.NONE),
        ("bdf2", math.inf, Limit.NONE),
        ("generalized-alpha", math.inf, Limit.NONE),
        ("rosenbrock", 0.01, Limit.TOLERANCE),
        ("adaptive-euler", 0.01, Limit.TOLERANCE),
    ],
)
def test_what_theory_says_of_each_method(method, border, limit):
    assert predicted_border(METHODS[method], np.array([100.0, 60.0, 5.0]), 0.01) == (pytest.approx(border), limit)


def test_the_stiffer_of_friction_and_contact_decides():
    assert predicted_border(METHODS["rk4"], np.array([10.0, 600.0, 5.0]), 0.01) == (2.828 / 600, Limit.CONTACT)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.rename(step_s="speed_rpm"), "factors method and either step_s"),
        (lambda c: c.rename(drift_mm="drift_um"), "drift_um"),
        (lambda c: c.expand_dims(order=[1, 3]).assign(outcome=c["outcome"]), "one value per order"),
        (lambda c: c.assign_coords(needle_mass_factor=["a", "b"]), "needs numeric factors"),
    ],
)
def test_what_is_missing_is_named(change, told):
    with pytest.raises(InputError, match=told):
        stability_borders(change(cube(KNOWN)), SETTINGS)


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_a_real_border_is_that_of_the_linearised_roller(tmp_path):
    """The contact of a roller in its groove, beyond whose border a run is refused (regression: ratio 0.76, 0.95)."""
    (tmp_path / "study.toml").write_text("""
[study]
name = "roller"
scene = "roller-in-groove"
[base]
duration_s = 0.005
[factors.method]
values = ["symplectic-euler", "rk4", "bdf2"]
[factors.step_s]
values = [1e-5, 1.78e-5, 3.16e-5, 5.62e-5, 1e-4]
[keep]
outputs = ["axial_force_n", "contact_rate_per_s", "friction_rate_per_s", "secant_lag_rate_per_s"]
[run]
expected_outcomes = ["inaccurate", "diverged"]
[analysis.stability]
output = "axial_force_n"
""")
    td.run(tmp_path / "study.toml", out=tmp_path / "out", workers=0)
    result = xr.open_dataset(tmp_path / "out" / "analysis" / "stability.nc")
    for method, ratio in (("symplectic-euler", 0.76), ("rk4", 0.95)):
        assert cell(result, "limited_by", method, 0) == Limit.CONTACT
        assert cell(result, "agrees", method, 0) == Agreement.YES
        assert cell(result, "ratio", method, 0) == pytest.approx(ratio, abs=0.01)
        assert cell(result, "wrong_runs", method, 0) == 0
    assert cell(result, "border_high", "bdf2", 0) == math.inf
