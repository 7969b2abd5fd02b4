"""A comparison in words: sentences, table, JSON and page say what the comparison holds, and nothing else."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from measured import Recorder

import tripod_doe as td
from tripod_doe.analyses.comparison.charts import comparison_charts
from tripod_doe.analyses.comparison.comparison import compare
from tripod_doe.analyses.comparison.model_point import model_point
from tripod_doe.analyses.comparison.page import comparison_page, write_comparison
from tripod_doe.analyses.comparison.sentences import comparison_json, comparison_text, find_in_comparison, order_rows
from tripod_doe.measurements.measurement import Measurement, rotation_from_tachometer


@pytest.fixture(scope="module")
def point():
    result = td.simulate(joint_angle_deg=10, initial_skew_1_deg=2, initial_skew_2_deg=-2)
    return result.assign_coords(speed_rpm=((), 600.0, {"units": "rpm"})).assign_attrs(
        title="A <b>study</b>", study_hash="0123"
    )


@pytest.fixture(scope="module")
def comparison(point):
    """The model's own orders measured in a run-up with noise, the third 10 % larger."""
    amplitude, phase = point["thrust_amplitude"].values, point["thrust_phase_deg"].values
    orders = {k: (amplitude[k] * (1.1 if k == 3 else 1), phase[k]) for k in range(13)}
    table = Recorder(orders, revolutions=80.2, rpm=(300, 900), noise_n=0.5).record()
    table.loc[2000:2400, "thrust_n"] = np.nan
    columns = (table[name].to_numpy() for name in ("time_s", "tacho", "thrust_n"))
    return compare(rotation_from_tachometer(*columns, lost_samples=401), point, reference_angle_deg=0)


def test_sentences_say_what_differs_and_what_was_lost(comparison):
    told = find_in_comparison(comparison)
    assert told[0].startswith("Order 3 differs by more than the uncertainties of measurement and model together")
    assert "third order" in told[1]
    assert "N (+10 %), beyond both uncertainties together" in told[1]
    assert "second order" in told[2]
    assert "Error of the model kinetostatic: recorded for similar points" in told[3]
    assert "2 left out for a gap wider than 14.4 deg or too few samples" in told[5]
    assert "the first rising edge of tacho is at a rotation angle of 0 deg" in told[6]
    assert told[7].startswith("The record was taken at 3")
    assert told[8] == "Lost: 401 samples without a number."


def test_a_record_at_one_speed_is_no_run_up(comparison):
    """Regression: "From 80 to 80 rpm the measured third order goes from 356 to 356 N"."""
    at_speed = comparison.assign(model_amplitude_at_speed=comparison["thrust_amplitude"])
    steady = at_speed.assign(speed_rpm=0 * at_speed["speed_rpm"] + 80 + 1e-3 * at_speed["revolution"])
    assert any(s.startswith("From 3") for s in find_in_comparison(at_speed))
    assert not any(s.startswith("From") for s in find_in_comparison(steady))


def test_an_order_that_the_model_does_not_have_has_no_phase(comparison):
    for order, row in zip(comparison["order"].values, order_rows(comparison), strict=True):
        there = float(comparison["model_amplitude"].sel(order=order)) > 1e-9
        assert (row[9] != "-") == there
        assert row[10] == "-" or there
        assert "e-1" not in "".join(row[1:6])  # regression: an amplitude of 1.4e-15 N


def test_the_beat_is_told_in_words(comparison):
    (told,) = [sentence for sentence in find_in_comparison(comparison) if "envelope" in sentence]
    assert re.fullmatch(
        r"The envelope of the measured thrust force rises and falls by [\d.]+ % about its mean; the envelope of "
        r"the model rises and falls by [\d.]+ % about its mean\.",
        told,
    )
    still = comparison.assign(model_envelope=0 * comparison["model_envelope"] + 5)
    assert "the envelope of the model is constant." in " ".join(find_in_comparison(still))


def test_table_and_json_hold_the_numbers(comparison):
    text = comparison_text(comparison)
    assert len(text.splitlines()[-13:]) == 13
    answer = json.loads(comparison_json(comparison))
    assert answer["measured_amplitude"] == comparison["measured_amplitude"].values.tolist()
    assert answer["order"] == list(range(13))
    assert answer["measured_phase_deg"][0] in (None, 0.0, 180.0)
    assert len(answer["speed_rpm"]) == comparison.sizes["revolution"]
    assert "measured_thrust" not in answer


@pytest.mark.parametrize(("apart", "told"), [(-3.2, "3.2 N lower, with"), (3.2, "3.2 N higher, with")])
def test_a_force_below_the_model_is_not_a_negative_height(comparison, apart, told):
    """Regression: "its own is -3.2 N higher"."""
    assert told in comparison_charts(comparison.assign_attrs(preload_n=apart))[0].caption


def test_figures_hold_the_numbers(comparison, read_table):
    charts = {chart.name: read_table(chart.csv()) for chart in comparison_charts(comparison)}
    assert list(charts) == ["waveform", "orders", "beat", "run-up"]
    assert (charts["orders"]["measured_amplitude"] == comparison["measured_amplitude"].values).all()
    assert (charts["beat"]["model_envelope"] == comparison["model_envelope"].values).all()
    assert charts["run-up"]["revolutions"].sum() == comparison.sizes["revolution"]
    third = charts["run-up"]["amplitude_n_order_3"]
    assert np.abs(third / float(comparison["measured_amplitude"].sel(order=3)) - 1).max() < 0.02
    without_time = comparison.drop_vars("speed_rpm")
    assert [chart.name for chart in comparison_charts(without_time)] == ["waveform", "orders", "beat"]


@pytest.mark.slow
def test_the_page_needs_nothing_else_and_escapes(comparison, tmp_path):
    """And it is the same whenever it is made."""
    page = comparison_page(comparison)
    assert "&lt;b&gt;study&lt;/b&gt;" in page
    assert "src=" not in page
    assert write_comparison(comparison, tmp_path / "one.html").read_text() == page


@pytest.mark.usefixtures("charts_not_drawn")
def test_the_page_is_written_where_it_is_asked_for(comparison, tmp_path):
    assert write_comparison(comparison, tmp_path / "dir") == tmp_path / "dir" / "index.html"
    assert (tmp_path / "dir" / "index.html").read_text() == comparison_page(comparison)
    assert "measured_thrust" in td.open_cube(tmp_path / "dir" / "comparison.nc")
    (tmp_path / "file").write_text("")
    with pytest.raises(td.StorageError, match="cannot write this file"):
        write_comparison(comparison, tmp_path / "file" / "below")


def test_the_error_of_the_model_is_stated_with_its_origin(grid_cube):
    """From a cube, and without a word on errors from a model that has no records."""
    point = model_point(grid_cube, ["joint_angle_deg=8", "torque_n_m=50"])
    record = Measurement(np.arange(0.0, 3600.0), np.tile(point["thrust"].values, 5), None, "first sample")
    known = compare(record, point, 0.0)
    (told,) = [line for line in find_in_comparison(known) if line.startswith("Uncertainties are 95 % intervals")]
    third = known.sel(order=3)
    percent = 100 * float(third["model_amplitude_uncertainty"] / third["model_amplitude"])
    assert f"it amounts to +- {percent:.2g} % of the third order" in told
    assert "other orders and phases from runs of needles at 145 random joints in drive and 26 in coast" in told
    assert float(third["amplitude_difference_uncertainty"]) >= float(third["model_amplitude_uncertainty"]) > 0
    strange = compare(record, point.drop_attrs(deep=False), 0.0)
    assert "is not known here and not included" in " ".join(find_in_comparison(strange))


def test_the_page_names_its_point_with_units(grid_cube):
    point = model_point(grid_cube, ["joint_angle_deg=8", "torque_n_m=50"])
    record = Measurement(np.arange(0.0, 3600.0), np.tile(point["thrust"].values, 5), None, "first sample")
    page = comparison_page(compare(record, point, 0.0))
    assert "<dt>Model: joint angle</dt><dd>8 deg</dd>" in page
    assert "<dt>Model: torque</dt><dd>50 N m</dd>" in page
    assert "±\u00a0N" in page
