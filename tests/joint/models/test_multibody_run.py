"""Runs of `rollers` and `needles`: limits that tie them to `equilibrium`, honest errors, and the outcome of bad runs."""

from __future__ import annotations

import numpy as np
import pytest
from few import CALM, FEW

import tripod_doe as td
from tripod_doe.errors import InputError
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.multibody import thrust_parts
from tripod_doe.joint.simulator import simulator
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Outcome

REFERENCE_POINTS = [
    {},
    {"joint_angle_deg": 5, "torque_n_m": 100},
    {"initial_skew_1_deg": 0.4, "speed_rpm": 1200},
    {"model": "needles", "initial_skew_1_deg": 0.4, "torque_n_m": 150, "cycles": 3, **FEW},  # heavy: they rattle less
]


def skews(*values):
    return {f"initial_skew_{k}_deg": value for k, value in enumerate(values, start=1)}


def order(result, k):
    """Complex amplitude of an order of the thrust."""
    assert result.attrs["finished"], str(result["outcome_detail"].values)
    return result["thrust_amplitude"].values[k] * np.exp(1j * np.radians(result["thrust_phase_deg"].values[k]))


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"joint_angle_deg": 6}, {"torque_n_m": 100}, {"torque_n_m": -50}])
def test_third_order_of_rollers_is_near_the_equilibrium(simulated, given):
    """Limit: inertia, clearances and a shaft of finite length are all that lies between the two models."""
    rollers, equilibrium = (abs(order(simulated(**given, model=model), 3)) for model in ("rollers", "equilibrium"))
    assert rollers == pytest.approx(equilibrium, rel=0.02)


def test_second_order_of_rollers_is_that_of_the_equilibrium(simulated):
    """Limit: needles at a prescribed skew make the same second order in both, 0.220 and 0.222 N."""
    rollers, equilibrium = (
        abs(order(simulated(**skews(0.4, -0.4, 0.4), model=model), 2)) for model in ("rollers", "equilibrium")
    )
    assert rollers == pytest.approx(equilibrium, rel=0.03)


def test_states_among_more_steps_are_read_by_the_machine_code_of_all_others(monkeypatch):
    """Regression: as views they had kernels compiled once more, ten seconds in a user's first run."""
    forces, read = thrust_parts._forces, []

    def look(tables, work, *states):
        read.extend(states)
        forces(tables, work, *states)

    monkeypatch.setattr(thrust_parts, "_forces", look)
    td.simulate(model="rollers", **skews(0.4, -0.4, 0.4))
    assert read
    assert all(states.flags.c_contiguous for states in read)


@pytest.mark.slow
@pytest.mark.parametrize("switch", ["needle_sliding", "needle_rolling", "groove_rolling", "groove_spinning"])
def test_switched_off_mechanisms_do_the_same_in_both_models(simulated, switch):
    """Limit: the same 2 %, and a mechanism that is off takes no power."""
    results = [simulated(model=model, **{switch: 0}) for model in ("rollers", "equilibrium")]
    assert abs(order(results[0], 3)) == pytest.approx(abs(order(results[1], 3)), rel=0.02)
    for result in results:
        assert result["friction_power_w"].sel(mechanism=switch) == 0
    powers = [result["friction_power_w"].values for result in results]
    assert powers[0] == pytest.approx(powers[1], rel=0.1, abs=0.02 * powers[1].sum())


@pytest.mark.slow
def test_reference_point(simulated):
    """Regression: 14.172 N by default, 14.155 N at 4e-3, 14.18 N converged; 0.221 N of second order at uneven skews."""
    assert abs(order(simulated(), 3)) == pytest.approx(14.172, abs=0.002)
    assert abs(order(simulated(relative_tolerance=4e-3), 3)) == pytest.approx(14.155, abs=0.002)
    assert abs(order(simulated(relative_tolerance=1e-3), 3)) == pytest.approx(14.18, abs=0.02)
    assert abs(order(simulated(**skews(0.4, -0.4, 0.4)), 2)) == pytest.approx(0.2206, abs=0.002)


def test_torque_doubles_the_third_order(simulated):
    """Published: proportional to the torque, within 2 %."""
    assert abs(order(simulated(torque_n_m=100), 3)) == pytest.approx(2 * abs(order(simulated(), 3)), rel=0.02)


def test_speed_matters_only_by_inertia(simulated):
    """Published: independent of speed (5 %). Exact physics: what is left goes with the square of the speed."""
    third = {speed: abs(order(simulated(speed_rpm=speed), 3)) for speed in (300, 600, 1200)}
    assert third[1200] == pytest.approx(third[300], rel=0.05)
    assert (third[1200] - third[300]) / (third[600] - third[300]) == pytest.approx((16 - 1) / (4 - 1), rel=0.1)


def test_equal_skews_make_no_second_order(simulated):
    """Published: the second order comes from uneven skew only."""
    uneven, equal = (abs(order(simulated(**skews(*s)), 2)) for s in ((0.4, -0.4, 0.4), (0.4, 0.4, 0.4)))
    assert equal < 0.01 * uneven


def test_reversed_skews_turn_the_second_order_by_half_a_turn(simulated):
    """Published: its beat turns by 180 deg; and the third order stays."""
    one, other = (simulated(**skews(s, -s, s)) for s in (0.4, -0.4))
    assert order(one, 2) == pytest.approx(-order(other, 2), rel=0.03)
    assert order(one, 3) == pytest.approx(order(other, 3), rel=1e-3)


def test_without_needle_sliding_skew_does_nothing(simulated):
    """Published: the second order is gone without the needles' sliding friction."""
    with_, without = (simulated(**skews(0.4, -0.4, 0.4), needle_sliding=on) for on in (1, 0))
    assert abs(order(without, 2)) < 0.01 * abs(order(with_, 2))


def test_first_order_is_in_the_grooves_and_not_in_the_sum(simulated):
    """Published: the sum's third order is three times the local one; the first cancels."""
    result = simulated()
    groove = result["groove_thrust_amplitude"].values
    assert 3 * groove[:, 3] == pytest.approx(np.full(3, result["thrust_amplitude"].values[3]), rel=1e-3)
    assert groove[:, 1].min() > 0.5 * groove[:, 3].max()
    assert result["thrust_amplitude"].values[1] < 1e-3 * groove[:, 1].min()


@pytest.mark.parametrize("given", [{"model": "rollers"}, {"model": "needles", **FEW}])
def test_all_thrust_passes_through_groove_friction(simulated, given):
    """Exact physics: a frictionless groove takes no axial force."""
    result = simulated(**given, groove_sliding=0, groove_spinning=0, groove_rolling=0, cycles=2)
    assert np.abs(result["thrust"].values).max() < 1e-9


def test_a_straight_joint_has_no_thrust(simulated):
    """Exact physics; it loses nothing either, which its energy balance must not be measured by."""
    result = simulated(joint_angle_deg=0)
    assert result.attrs["finished"], str(result["outcome_detail"].values)
    assert np.abs(result["thrust"].values).max() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, skews(0.4, -0.4, 0.4)])
def test_few_needles_behave_like_rollers(simulated, given):
    """Limit: bodies that roll with the bearing's friction; few thick needles rattle, so 5 % of the third order."""
    needles, rollers = (simulated(model=model, cycles=3, **FEW, **CALM, **given) for model in ("needles", "rollers"))
    assert abs(order(needles, 3)) == pytest.approx(abs(order(rollers, 3)), rel=0.05)
    assert needles["needle_skew_deg"].sizes == {"trunnion": 3, "rotation_deg": 720}
    summary = needles["needle_skew_summary_deg"]
    assert summary.sizes == {"trunnion": 3, "cycle": 3, "statistic": 3}
    mean, least, most = (summary.sel(statistic=statistic).values for statistic in ("mean", "min", "max"))
    assert (least <= mean).all()
    assert (mean <= most).all()
    last = needles["needle_skew_deg"].values.reshape(3, 2, 360).mean(axis=2)
    assert mean[:, 1:] == pytest.approx(last, abs=1e-9)


@pytest.mark.slow
def test_full_model_at_the_reference_point(simulated):
    """Regression: 507 degrees of freedom, 14.41 N; 0.163 N of second order at uneven skews, which stay within 0.15 deg.

    Both with a quarter of the tolerance, with errors of 0.005 N.
    """
    aligned, uneven = (simulated(model="needles", cycles=3, **skews(*s)) for s in ((0, 0, 0), (0.4, -0.4, 0.4)))
    for result in (aligned, uneven):
        assert abs(order(result, 3)) == pytest.approx(14.42, abs=0.05)
        assert result["thrust_amplitude_error"].values[3] < 0.02 * 14.42
        assert result["thrust_amplitude_scatter"].values[3] < 0.005 * 14.42
    assert abs(order(uneven, 2)) == pytest.approx(0.163, abs=0.008)
    assert abs(order(aligned, 2)) < 0.06
    mean = uneven["needle_skew_summary_deg"].sel(statistic="mean").values
    assert mean == pytest.approx(np.tile([[0.4], [-0.4], [0.4]], 3), abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("given", REFERENCE_POINTS)
def test_the_reported_error_covers_the_real_one(simulated, given):
    """Numerical error: against a quarter of the tolerance, whose own error counts too; and not by a factor of ten."""
    rough = simulated(**given)
    usual = MODELS[given.get("model", "rollers")].methods["adaptive-euler"]["relative_tolerance"]
    fine = simulated(**given, relative_tolerance=usual / 4)
    reported, left = (result["thrust_amplitude_error"].values[3] for result in (rough, fine))
    real = abs(order(rough, 3) - order(fine, 3))
    assert real < reported + left
    assert left < reported < 10 * (real + left)  # what is real is known to within what is left


@pytest.mark.slow
def test_the_error_is_of_first_order(simulated):
    """Numerical error: the steps are 1/3, 1/6 and 1/12 of a sample's 1 deg; changes must halve."""
    third = [order(simulated(relative_tolerance=np.radians(1) / (2 * n)), 3) for n in (3, 6, 12)]
    assert abs(third[0] - third[1]) / abs(third[1] - third[2]) == pytest.approx(2, rel=0.15)


@pytest.mark.slow
def test_other_methods_agree_within_their_errors(simulated):
    """Numerical error: an explicit method and one of a single linear solve a step, against the default at a quarter.

    At 1200 rpm, where steps of the same angle are explicit ones of 4e-6 s, within their limit.
    """
    fast = {"cycles": 3, "speed_rpm": 1200}
    settled = order(simulated(**fast, relative_tolerance=1e-3), 3)
    for method, step, near in (("symplectic-euler", 4e-6, 0.003), ("linearly-implicit-euler", 1e-5, 0.003)):
        result = simulated(**fast, method=method, step_s=step, samples_per_revolution=90)
        error = result["thrust_amplitude_error"].values[3]
        assert error < near * abs(settled)
        assert abs(abs(order(result, 3)) - abs(settled)) < 1.1 * error + 0.002 * abs(settled)


def outcome(**given):
    result = td.simulate(**{"model": "rollers", **given})
    return str(Outcome(int(result["outcome"])).label), str(result["outcome_detail"].values)


@pytest.mark.parametrize("model", [{"model": "rollers"}, {"model": "needles"}])
@pytest.mark.parametrize(
    ("given", "expected", "reason"),
    [
        ({"speed_rpm": 0}, {"out_of_range"}, "raise speed_rpm"),
        ({"torque_n_m": 0}, {"out_of_range"}, "no force presses the rollers"),
        ({"needle_diameter_mm": 6}, {"jammed"}, "do not fit on the pitch circle"),
        ({"roller_radius_mm": 9}, {"jammed"}, "the bore is larger"),
        ({"method": "symplectic-euler", "step_s": 1e-4}, {"inaccurate", "diverged"}, " at t = "),
    ],
)
def test_runs_that_cannot_go_well_say_why(model, given, expected, reason):
    """Outcomes: never finished with a wrong number."""
    label, detail = outcome(**FEW | model | given)
    assert label in expected, detail
    assert reason in detail


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        {"torque_n_m": 0.01, "relative_tolerance": 4e-3, "cycles": 2},
        {"joint_angle_deg": 40, "relative_tolerance": 4e-3, "cycles": 2},
        {"method": "symplectic-euler", "step_s": 1e-5, "cycles": 2},
    ],
)
def test_rollers_too_coarse_are_not_called_finished(given):
    """Outcomes: the numerical error, a bound or the energy balance shows it."""
    label, detail = outcome(**given)
    assert label in ("inaccurate", "diverged"), detail
    assert detail


def test_a_budget_that_is_used_up_is_reported():
    label, detail = outcome(evaluation_budget=200)
    assert label == "evaluation_limit"
    assert "force evaluations at t = " in detail


@pytest.mark.slow
def test_a_preloaded_bearing_gives_a_converged_answer(simulated):
    """Numerical error: -0.003 mm and -0.005 mm finish, with a number that holds at a quarter of the tolerance."""
    for clearance in (-0.003, -0.005):
        rough, fine = (
            simulated(bearing_radial_clearance_mm=clearance, cycles=3, **numerics)
            for numerics in ({}, {"relative_tolerance": 1e-3})
        )
        assert abs(order(rough, 3) - order(fine, 3)) < rough["thrust_amplitude_error"].values[3]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"method": "newton"}, "not a method of rollers"),
        ({"method": "linearly-implicit-euler", "relative_tolerance": 1e-3}, "relative_tolerance = 0.001: not used by"),
        ({"step_s": 1e-5}, "step_s = 1e-05: not used by adaptive-euler"),
    ],
)
def test_numerics_that_do_not_fit_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        td.simulate(model="rollers", **given)


def test_cycles_as_a_factor_cannot_keep_what_has_one_entry_a_cycle():
    with pytest.raises(InputError, match="different lengths"):
        simulator.check({"model": "needles"}, {"cycles": (3, 4)}, ["needle_skew_summary_deg"])
    assert simulator.check({"model": "needles"}, {"cycles": (3, 4)}, ["thrust_amplitude"]) == []


def test_every_method_is_offered_with_its_own_numerics():
    for name in ("rollers", "needles"):
        assert set(MODELS[name].methods) == set(METHODS)
        assert MODELS[name].default_method == "adaptive-euler"
        for method, used in MODELS[name].methods.items():
            assert list(used) == ["relative_tolerance" if METHODS[method].controlled else "step_s"]


STUDY = """
[study]
name = "ladder"
[base]
needle_count = 9
needle_diameter_mm = 5.89
spheres_per_needle = 3
torque_n_m = 150
relative_tolerance = 2e-3
cycles = 2
samples_per_revolution = 90
[factors.model]
values = ["equilibrium", "rollers", "needles"]
[factors.method]
values = ["newton", "adaptive-euler"]
[keep]
outputs = ["thrust_amplitude", "thrust_amplitude_error", "needle_skew_summary_deg", "largest_penetration_um"]
[run]
block = 1
expected_outcomes = ["not_applicable"]
"""


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_models_share_one_cube(write_study, tmp_path):
    """Invariance: a cell is NaN where its model has no such output or its method is not of its model."""
    summary = td.run(write_study(STUDY), out=tmp_path / "out", workers=0, progress=False)
    assert summary.good
    cube = td.open_cube(tmp_path / "out")
    there = {
        name: np.isfinite(cube[name]).all(dim=[d for d in cube[name].dims if d not in ("model", "method")])
        for name in ("thrust_amplitude", "thrust_amplitude_error", "needle_skew_summary_deg")
    }
    rows = {name: values.transpose("model", "method").values.tolist() for name, values in there.items()}
    no = [False, False]
    assert rows["thrust_amplitude"] == [[True, False], [False, True], [False, True]]
    assert rows["thrust_amplitude_error"] == [no, [False, True], [False, True]]
    assert rows["needle_skew_summary_deg"] == [no, no, [False, True]]
    assert cube["needle_skew_summary_deg"].sizes["cycle"] == 2


def test_the_largest_penetration_is_not_that_of_the_swing_in_in_coarse_steps():
    """Regression: 23.2 um for 5.6, from steps whose oscillation the last revolution does not have."""
    joint = {"joint_angle_deg": 12.0, "torque_n_m": 80.0, "pitch_radius_mm": 22.9865, "needle_length_mm": 13.909}
    rollers, balance = (
        float(td.simulate(model=model, speed_rpm=500.0, **joint)["largest_penetration_um"])
        for model in ("rollers", "kinetostatic")
    )
    assert rollers == pytest.approx(balance, rel=0.05)
