"""Pages of studies whose models a pilot chose: what was not asked for is not shown, and which model answers where is."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.findings import find
from tripod_doe.analyses.model_choice.charts import model_choice_chart
from tripod_doe.page_parts.chosen_models import asked_orders, estimated_errors
from tripod_doe.page_parts.main_results import responses
from tripod_doe.reports.study_report import make_page

CHOSEN = """
[study]
name = "Chosen"
[base]
initial_skew_1_deg = 0.4
[factors.joint_angle_deg]
values = [4, 8, 12]
[factors.torque_n_m]
values = [25, 50]
"""


@pytest.fixture(scope="module")
def chosen(make_cube):
    """A cube as after a pilot that asked for the third order to 4 %: small angles by `kinetostatic`."""
    cube = make_cube(CHOSEN)
    dims, shape = cube["outcome"].dims, cube["outcome"].shape
    flags = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "equilibrium kinetostatic"}
    used = np.broadcast_to(np.array([[1], [0], [0]], np.int8), shape)
    estimate = np.broadcast_to(np.array([[0.02], [0.03], [0.05]]), shape)
    return cube.assign(
        accuracy_met=(dims, (estimate <= 0.04).astype(np.int8)),
        model_used=(dims, used, flags),
        thrust_amplitude_3_error_estimate=(dims, estimate, {"long_name": "estimated relative error"}),
    ).assign_attrs(study=CHOSEN + "[accuracy]\nthrust_amplitude_3 = 0.04\n")


def test_only_orders_that_were_asked_for_are_stated(chosen, grid_cube):
    assert asked_orders(chosen) == [3]
    assert asked_orders(grid_cube) is None
    assert [response.label for response in responses(chosen)] == ["third order"]
    assert len(responses(grid_cube)) > 1
    told = " ".join(find(chosen))
    assert "second order" not in told
    assert "ninth order" not in told
    assert "Accuracy was asked for the third order only: other orders and the waveform are not shown" in told
    assert "may use them" not in told


@pytest.mark.parametrize(
    ("formula", "shown"),
    [("thrust_amplitude[2] / 2", False), ("third * 2", False), ("2e3 * sqrt(thrust_amplitude[3]) / torque_n_m", True)],
)
def test_formulas_of_what_has_no_accuracy_are_not_stated(chosen, formula, shown):
    """Regression: trends of a formula were stated over points whose models have different errors."""
    own = chosen["thrust_amplitude"].sel(order=2, drop=True)
    cube = chosen.assign(own=own.assign_attrs(role="result of its own", units="N", formula=formula))
    told = find(cube)
    assert any(sentence.startswith("own ") for sentence in told) == shown
    assert ("are not shown, nor own which may use them" in " ".join(told)) == (not shown)
    assert ("own" in [response.label for response in responses(cube)]) == shown


def test_without_a_pilot_all_orders_are_shown_and_no_choice_is_drawn(chosen):
    """Regression: an empty panel of errors, and orders left out as those of "models of different error"."""
    few = chosen.assign(accuracy_met=xr.full_like(chosen["accuracy_met"], -1))
    few["thrust_amplitude_3_error_estimate"] = few["thrust_amplitude_3_error_estimate"] * np.nan
    assert asked_orders(few) is None
    assert model_choice_chart(few) is None
    told = find(few)
    assert (
        "The study has too few points for a pilot that could choose its models: all 6 points run with the full "
        "model." in told
    )
    assert any("ninth order" in sentence for sentence in told)


@pytest.mark.slow
def test_the_page_shows_the_others_as_not_asked_and_one_picture_of_the_models(chosen):
    page = make_page(chosen, {})
    assert page.count("no accuracy was requested for them") == 1
    assert "waveform-1" not in page
    assert page.count('id="models"') == 1
    assert "model-choice.csv" in page


def test_the_picture_has_every_point_with_its_model_and_its_share_of_the_allowed_error(chosen):
    """Exact: 2, 3 and 5 % of 4 %."""
    data = model_choice_chart(chosen).data
    assert data["model"].tolist() == ["kinetostatic"] * 2 + ["equilibrium"] * 4
    assert data["estimated_error_percent_of_allowed"].to_numpy() == pytest.approx([50, 50, 75, 75, 125, 125])
    assert (estimated_errors(chosen) > 1).sum() == int((chosen["accuracy_met"] == 0).sum())


def test_one_factor_makes_one_panel_and_a_named_model_none(chosen, grid_cube):
    assert len(model_choice_chart(chosen.isel(torque_n_m=[0])).figure.axes) == 1
    assert model_choice_chart(grid_cube) is None
