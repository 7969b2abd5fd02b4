"""Errors of the models at any operating point: true of what was measured, flagged where large, silent where unknown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from operating_points import points

import tripod_doe as td
from tripod_doe.joint.derived_constants.contact_stiffness import needle_contact_stiffness
from tripod_doe.joint.derived_constants.load_zone import bearing_load_zone
from tripod_doe.joint.known_errors import error_estimate
from tripod_doe.joint.known_errors.error_estimate import COMPARED, RECORDED, known_errors, similar_errors
from tripod_doe.joint.known_errors.operating_ratios import operating_ratios
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.simulator import simulator
from tripod_doe.model_interface import Accuracy, Quantity, model_notes
from tripod_doe.study.definition.study_file import load_study

STUDIES = [
    f"studies/{name}.toml"
    for name in (
        "rungs_needles",
        "joint_angle",
        "speed_torque",
        "needles_field",
        "needles_reference",
        "needles_wide_field",
        "needles_fast_field",
        "needles_other_joints",
        "needles_large_angles",
        "needles_fast_small_angles",
    )
] + ["studies/rungs.toml"]
SECOND = Quantity("thrust_amplitude_2", "thrust_amplitude", 2, 0.1)
THIRD = Quantity("thrust_amplitude_3", "thrust_amplitude", 3, 0.015)


def test_the_record_is_made_from_the_studies_as_they_stand(pytestconfig):
    """Regression: a study that was changed after its run has another hash than the record names."""
    head = RECORDED.read_text().splitlines()[0]
    for study in STUDIES:
        assert load_study(pytestconfig.rootpath / study).hash in head


def left_out(measured, model):
    """Each measured point left out in turn: its error, and the typical error and limit stated for it; shape (point,)."""
    errors = measured.errors[model]
    finite = np.flatnonzero(np.isfinite(errors))
    stated = []
    for at in finite:
        others = np.arange(errors.size) != at
        alone = replace(
            measured, places=measured.places[others], errors={model: errors[others]}, inexact=measured.inexact[others]
        )
        typical, limit = error_estimate._median_and_limit(*alone.near(model, measured.places[[at]]))
        stated.append((typical[0], limit[0]))
    return finite, errors[finite], *np.array(stated).T


@pytest.mark.parametrize("model", COMPARED)
def test_typical_errors_and_limits_hold_in_drive_and_in_coast(model):
    """Exact by its meaning; shares are known to 5 % from some 100 points. Errors against `needles` count alone: to those
    against `rollers` a typical error was added, so that most of them are larger than typical ones.

    Regression: without the direction as a coordinate, coast had the errors of drive, a third of the points within their
    typical error and 79 % within their limit.
    """
    measured = error_estimate._measured()
    at, error, typical, limit = left_out(measured, model)
    known = np.isfinite(limit) & ~np.isinf(measured.errors["rollers"][at])
    for direction in (1, -1):
        rows = known & (np.sign(measured.given["torque_n_m"][at]) == direction)
        assert rows.sum() > 25
        assert 0.8 < np.mean(error[rows] <= limit[rows]) < 0.99
        assert 0.4 < np.mean(error[rows] <= typical[rows]) < 0.62


@pytest.mark.parametrize(("angle", "torque"), [(2, 100), (1, -300)])
def test_the_equilibrium_is_flagged_at_small_angles(angle, torque):
    """Published number (issue): at 2 deg, 100 N m it is 56 % off `needles`, `kinetostatic` less than 1 %."""
    block = points(joint_angle_deg=angle, torque_n_m=torque, model=np.array(["equilibrium", "kinetostatic"], object))
    found = simulator.model_errors(block)
    assert found.expected[0] > 0.1
    assert not found.expected[1] >= found.expected[0] / 2
    verdict, told, *_ = model_notes(simulator, {name: column[:1] for name, column in block.items()}, {})
    assert verdict.startswith("Verdict on the third order: doubtful, since ")
    assert "above 5 %: use a finer model" in told


def test_nothing_is_known_outside_of_what_was_measured():
    expected, limit, unknown = known_errors("kinetostatic", points(joint_angle_deg=[10.0, 40.0, 0.0]))
    assert np.isfinite([expected[0], limit[0]]).all()
    assert np.isnan(expected[1])
    assert "is outside of the compared" in unknown[1]
    assert (expected[2], limit[2]) == (0, 0)  # a straight joint has no thrust in any model
    assert [unknown[0], unknown[2]] == ["", ""]


def test_models_that_nothing_is_measured_against_say_so():
    assert "finest model" in known_errors("needles", points(joint_angle_deg=10.0))[2][0]
    assert "not compared" in known_errors("closed-form", points(joint_angle_deg=10.0))[2][0]


def test_every_range_is_of_a_parameter_or_a_ratio_and_only_points_outside_leave_it():
    block = points(joint_angle_deg=[1.0, 15.0], model=np.array(["equilibrium"] * 2, object))
    left = {departure.left.quantity: departure.outside for departure in simulator.model_errors(block).departures}
    assert left["swing_ratio"].tolist() == [True, False]
    assert not left["bearing_radial_clearance_mm"].any()
    for name, model in MODELS.items():
        departures = simulator.model_errors(points(joint_angle_deg=10.0, model=name)).departures
        assert [departure.left for departure in departures] == list(model.valid), name
        assert simulator.describe_model(name)["ignores"] == sorted(model.ignores)


@pytest.mark.parametrize("model", ["equilibrium", "kinetostatic"])
def test_inside_its_range_a_model_is_within_five_per_cent_at_nine_in_ten_measured_points(model):
    """Measured; the ranges are the widest round ones of which this is true."""
    table = np.genfromtxt(RECORDED, delimiter=",", names=True, skip_header=1)
    names = [name for name in table.dtype.names if name in simulator.parameters]
    block = points(model=np.array([model] * table.size, object), **{name: table[name] for name in names})
    inside = ~np.any([departure.outside for departure in simulator.model_errors(block).departures], axis=0)
    errors = np.abs(table[model][inside & np.isfinite(table[model])])
    assert errors.size >= 15
    assert np.quantile(errors, 0.9) < 0.05


def test_an_answer_names_its_model_and_error():
    result = td.simulate(joint_angle_deg=8, samples_per_revolution=60)
    verdict, errors = result.attrs["model_notes"]
    assert (
        verdict
        == "Verdict on the third order: sure, since nine in ten similar points were within 5 % of model needles."
    )
    assert errors.startswith("Model kinetostatic: typical error of the third order")


def test_where_no_model_can_run_the_point_no_error_is_stated():
    """Regression: "typical error 56 %; above 5 %: use a finer model" beside a point that is out of range for all."""
    result = td.simulate(joint_angle_deg=0.7, speed_rpm=15)
    assert int(result["outcome"]) == td.Outcome.OUT_OF_RANGE
    assert list(result.attrs["model_notes"]) == []


def test_more_crown_than_was_compared_has_no_error():
    """Regression: the crown was never varied; `kinetostatic`, which ignored it, was 27 % off at 7.6 um and stated 4 %."""
    expected, limit, unknown = known_errors("kinetostatic", points(needle_crown_um=[0.0, 7.6, 90.0]))
    assert np.isfinite([expected[:2], limit[:2]]).all()
    assert limit[1] > limit[0]
    assert np.isnan([expected[2], limit[2]]).all()
    assert "crown_ratio" in unknown[2]


def test_the_crown_is_measured_by_the_penetration():
    """Exact: 4.08 F/Z is the largest needle load without clearance; it presses straight needles by what it says."""
    values = points(torque_n_m=[50.0], needle_crown_um=[2.0])
    load, stiffness = 50e3 / 63, float(needle_contact_stiffness(np.array(10.0), np.array(1.0)))
    penetration = bearing_load_zone(load, 0.0, stiffness, 27.0)[1]
    assert operating_ratios(values)["crown_ratio"] == pytest.approx(1 + 2e-3 / penetration, rel=1e-3)


def test_similar_errors_are_those_of_the_nearest_measured_points():
    """Exact: a measured point is its own nearest one; over the allowed error, of the size that the floor leaves."""
    table = np.genfromtxt(RECORDED, delimiter=",", names=True, skip_header=1)
    row = table[
        np.flatnonzero((table["needles"] == 1) & (table["needle_crown_um"] > 0) & (table["needles_2"] > 0.02))[0]
    ]
    block = points(**{name: [row[name]] for name in table.dtype.names if name in simulator.parameters})
    errors = similar_errors("kinetostatic", block, Accuracy((SECOND, THIRD), 0.01))
    missed = abs(row["kinetostatic_2"] - row["needles_2"]) / row["needles_2"]
    assert errors.shape == (1, 10, 2)
    np.testing.assert_allclose(errors[0, 0], [missed / 0.1, abs(row["kinetostatic"]) / 0.015], rtol=1e-5)
    coarse = similar_errors("kinetostatic", block, Accuracy((SECOND,), 2 * row["needles_2"]))
    assert coarse[0, 0, 0] == pytest.approx(missed / 0.2, rel=1e-5)


@pytest.mark.parametrize(
    "varied",
    [
        {"needle_count": 60},
        {"youngs_modulus_gpa": 100.0},
        {"needle_crown_um": 40.0},
        {"density_kg_m3": 9000.0},
        {"groove_sliding": 0},
        {"joint_angle_deg": 0.0},
        {"needle_pitch_diameter_mm": 70.0},
        {"groove_sliding_friction": 0.3},
        {"joint_angle_deg": 19.9, "speed_rpm": 3000.0, "needle_sliding_friction": 0.0},
    ],
)
def test_no_errors_are_similar_where_nothing_like_it_was_measured(varied):
    """Other numbers of needles, more crown or friction, an aligned joint; the last is far from all, in every range."""
    errors = similar_errors(
        "kinetostatic", points(**{name: [value] for name, value in varied.items()}), Accuracy((THIRD,), 0.01)
    )
    assert np.isnan(errors).all()
    usual = similar_errors("kinetostatic", points(joint_angle_deg=[10.0]), Accuracy((THIRD,), 0.01))
    assert np.isfinite(usual).all()


def test_only_second_and_third_order_of_compared_models_are_on_record():
    block = points(joint_angle_deg=[10.0])
    assert similar_errors("kinetostatic", block, Accuracy((replace(THIRD, label=1),), 0.01)) is None
    assert similar_errors("kinetostatic", block, Accuracy((THIRD, replace(THIRD, output="thrust_rms")), 0.01)) is None
    assert np.isnan(similar_errors("closed-form", block, Accuracy((THIRD,), 0.01))).all()


@pytest.mark.parametrize("quantity", [SECOND, THIRD])
def test_where_nine_in_ten_similar_points_are_within_the_accuracy_a_point_mostly_is(quantity):
    """Measured, each point left out in turn: 45 of 51 in the second order to 10 %, 123 of 130 in the third to 1.5 %."""
    measured = error_estimate._measured()
    errors = measured.over_allowed("kinetostatic", quantity, 0.01)
    asked = ~np.isinf(errors)
    places, within = measured.places[asked], errors[asked] <= 1
    apart = np.square(places[:, None] - places).sum(axis=2)
    np.fill_diagonal(apart, np.inf)
    sure = within[np.argsort(apart, axis=1, kind="stable")[:, :10]].mean(axis=1) >= 0.9
    assert sure.sum() >= 40
    assert within[sure].mean() >= 0.85


def test_heavy_rollers_are_judged_by_heavy_ones():
    """Regression: `kinetostatic` is 33, 10 and 6 % off needles at these joints, and stated 0.1 % (90th percentile 1 %)."""
    block = points(
        pitch_radius_mm=[30.8, 30.0, 32.5],
        roller_radius_mm=[19.3, 19.0, 19.9],
        joint_angle_deg=[15.1, 18.0, 15.8],
        torque_n_m=[61.0, -60.0, -64.0],
        speed_rpm=[2800.0, 3000.0, 2563.0],
    )
    assert (operating_ratios(block)["inertia_ratio"] > 0.1).all()
    _, limit, unknown = known_errors("kinetostatic", block)
    assert (limit > 0.05).all()  # nothing is called sure
    assert limit[0] > 0.33
    assert not unknown.any()


@pytest.mark.parametrize(
    ("name", "models"), [("fast_joints", COMPARED[1:]), ("other_joints", COMPARED)], ids=["fast joints", "other joints"]
)
def test_limits_hold_at_joints_that_the_record_has_not(name, models):
    """Statistic: of joints by chance, which `needles` ran: 27 fast ones (1,200 to 3,000 rpm, 6 to 19.5 deg, 30 to 150
    N m); 75 of other sizes, needles, crowns, conformities, materials, frictions, skews and of little load.

    Regression: of the latter, 26 % were beyond the limit of `kinetostatic`.
    """
    with (Path(__file__).parent / f"{name}_held_out.csv").open(encoding="utf-8") as file:
        table = np.genfromtxt(file, delimiter=",", names=True)
    given = {name: table[name] for name in table.dtype.names if name in simulator.parameters}
    for model in models:
        _, limit, _ = known_errors(model, points(**given))
        errors, known = np.abs(table[model] / table["needles"] - 1), np.isfinite(limit)
        assert known.mean() >= 0.9
        assert np.mean(errors[known] <= limit[known]) >= 0.85


@pytest.mark.parametrize("model", ["kinetostatic", "rollers", "needles"])
def test_spheres_that_follow_a_crown_coarsely_are_doubtful(model):
    """Regression: seven spheres at crowns of 20 to 30 um were called sure, and 10 to 24 % off."""
    given = {
        "model": model,
        "joint_angle_deg": [4.31, 3.5, 4.6],
        "torque_n_m": [-72.0, -58.0, 116.0],
        "groove_sliding_friction": [0.038, 0.046, 0.042],
        "needle_sliding_friction": [0.066, 0.064, 0.010],
        "needle_crown_um": [20.0, 16.0, 30.0],
    }
    few, more = (points(**given, spheres_per_needle=[count] * 3) for count in (7.0, 15.0))
    [coarse] = [each for each in simulator.model_errors(few).departures if each.left.quantity == "touching_spheres"]
    assert coarse.outside.all()
    verdict, *_ = model_notes(simulator, {name: column[2:] for name, column in few.items()}, {})
    assert verdict.endswith(f"model {model} is valid only for touching_spheres from 1.5; raise spheres_per_needle.")
    fine = simulator.model_errors(more).departures
    assert not any(each.outside.any() for each in fine if each.left.quantity == "touching_spheres")
    straight = simulator.model_errors(
        points(**{**given, "needle_crown_um": [0.0] * 3, "spheres_per_needle": [1.0] * 3})
    )
    assert not any(each.outside.any() for each in straight.departures if each.left.quantity == "touching_spheres")


def test_rolling_friction_makes_points_unlike():
    """Regression: with 0.018 in grooves and needles, `kinetostatic` is 4.3 % off, and stated 0.18 % at most."""
    _, limit, _ = known_errors(
        "kinetostatic", points(groove_rolling_friction=[0.002, 0.018], needle_rolling_friction=[0.002, 0.018])
    )
    assert np.isnan(limit[1]) or limit[1] > 0.02
    _, limit, unknown = known_errors("kinetostatic", points(groove_rolling_friction=[0.1]))
    assert np.isnan(limit[0])
    assert "rolling_friction" in unknown[0]


def test_a_limit_is_not_below_the_numerical_errors_of_the_references():
    """Regression: 0.13 % were stated beside runs that do not know themselves to 0.3 %."""
    _, limit, _ = known_errors("kinetostatic", points(joint_angle_deg=[8.0, 10.0, 12.0]))
    assert (limit >= error_estimate._measured().inexact.min()).all()
    assert (limit > 0.003).all()
