from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.page_parts.main_outputs import left_points, main_outputs, quantile_text


@pytest.mark.parametrize(
    ("output", "units", "words", "unit"),
    [
        ("thrust_amplitude", "N", "the third order", "N"),
        ("thrust_phase_deg", "degree", "the thrust phase of the third order", "deg"),
    ],
)
def test_an_output_has_its_own_name_and_unit(output, units, words, unit):
    """Regression: any output along order was told as the third order, and whatever began with thrust in N."""
    result = xr.Dataset(
        {"mean": ("order", [0.0, 0.0, np.nan, 3.0])},
        {"order": [0, 1, 2, 3]},
        {"outputs": output, "output_units": f'{{"{output}": "{units}"}}'},
    )
    [part] = main_outputs(result, "mean")
    assert (part.output, part.what, part.unit, float(part.answers["mean"])) == (output, words, unit, 3.0)


def test_an_answer_at_one_label_of_many_names_it():
    """Regression: "the friction power of the third order" was the power of sliding in the grooves; w was w at t = 0."""
    outputs = ["friction_power_w", "groove_thrust_amplitude", "s"]
    power, thrust = np.array([2.0, 5.0]), np.array([[1.0], [8.0]]) + np.arange(4.0)
    tables = [power[:, None, None] + np.zeros((2, 2, 4)), thrust + np.zeros((2, 2, 4)), np.full((2, 2, 4), 7.0)]
    result = xr.Dataset(
        {"mean": (("output", "mechanism", "groove", "order"), tables), "wave_mean": ("order", np.arange(4.0))},
        {"output": outputs, "mechanism": ["sliding", "rolling"], "groove": [1, 2], "order": [0, 1, 2, 3]},
        {"outputs": ", ".join(outputs)},
    )
    assert {part.what: float(part.answers["mean"]) for part in main_outputs(result, "mean")} == {
        "friction_power_w (mechanism sliding)": 2.0,
        "the groove thrust amplitude of the third order (groove 1)": 4.0,
        "the groove thrust amplitude of the second order (groove 1)": 3.0,
        "s": 7.0,
    }
    course = xr.Dataset({"mean": ("t", [1.0, 9.0])}, {"t": ("t", [0.0, 5.0], {"units": "s"})}, {"outputs": "w"})
    assert [part.what for part in main_outputs(course, "mean")] == ["w (t 0 s)"]


def test_orders_that_a_result_does_not_have_are_not_asked_for():
    result = xr.Dataset({"mean": ("order", [1.0, 9.0])}, {"order": [1, 2]}, {"outputs": "w"})
    assert [part.what for part in main_outputs(result, "mean")] == ["the w of the second order"]
    assert [part.what for part in main_outputs(result, "mean", orders=(3,))] == ["w (order 1)"]


def test_a_quantile_without_an_interval_has_as_many_digits_as_the_others():
    """Regression: "95 % below 18.916 N (18.913 to 18.918), 99 % below 18.9 N (at least 18.9)"."""
    values = {"quantile_low": [18.9132, 18.9171], "quantile": [18.9158, 18.9217], "quantile_high": [18.9176, np.nan]}
    result = xr.Dataset(
        {name: (("order", "probability"), [[0.0] * 2] * 3 + [column]) for name, column in values.items()},
        {"probability": [0.95, 0.99], "order": np.arange(4)},
        {"outputs": "thrust_amplitude", "output_units": '{"thrust_amplitude": "N"}'},
    )
    part = next(part for part in main_outputs(result, "quantile", over=["probability"]) if "third" in part.what)
    assert "99 % below 18.92" in (said := quantile_text(part))
    assert said.endswith("(at least 18.917)")


def test_missing_points_are_counted():
    assert left_points(xr.Dataset(attrs={"points_dropped": 1, "points_used": 1200})) == [
        "1 point is missing, 1,200 are used."
    ]
    assert left_points(xr.Dataset(attrs={"points_dropped": 0, "points_used": 1200})) == []


def test_quantiles_beside_a_large_value_are_told_apart():
    """Regression: "5 % below 1,000,000 (1,000,000 to 1,000,000)"."""
    values = {
        "quantile_low": [1000000.21, 1000000.61],
        "quantile": [1000000.25, 1000000.7],
        "quantile_high": [1000000.3, 1000000.8],
    }
    result = xr.Dataset(
        {name: ("probability", column) for name, column in values.items()},
        {"probability": [0.05, 0.95]},
        {"outputs": "w"},
    )
    (part,) = main_outputs(result, "quantile", over=["probability"])
    assert (
        quantile_text(part)
        == "5 % below 1,000,000.2 (1,000,000.2 to 1,000,000.3), 95 % below 1,000,000.7 (1,000,000.6 to 1,000,000.8)"
    )
