"""Outputs of contacts: exact balances, Hertz's equations, agreement of the models, notes where a limit is passed."""

from __future__ import annotations

import numpy as np
import pytest
from few import CALM, FEW
from operating_points import points
from scipy.special import ellipe, ellipk

import tripod_doe as td
from tripod_doe.joint.contact_outputs import CONTACT_NAMES, NEEDLE_NAMES
from tripod_doe.joint.derived_constants.contact_pressure import ellipse_axes, groove_pressure
from tripod_doe.joint.simulator import simulator
from tripod_doe.study.simulate import simulate_point

POINT = {"joint_angle_deg": 13.0, "torque_n_m": -130.0, "speed_rpm": 900.0, "initial_skew_1_deg": 0.4}
KEPT = {*CONTACT_NAMES, "friction_power_w", "groove_thrust"}


@pytest.fixture(scope="module")
def answers():
    """Outputs of one joint by each model; each is computed once."""
    found = {}

    def of(model):
        if model not in found:
            few = {**FEW, **CALM, "cycles": 3} if model == "needles" else {}
            block = simulator.simulate(points(model=model, **POINT, **few), KEPT)
            assert block.outcome[0] == 0, block.detail
            found[model] = {name: values.data[0] for name, values in block.outputs.items()}
        return found[model]

    return of


MODELS = ["equilibrium", "kinetostatic", "rollers", pytest.param("needles", marks=pytest.mark.slow)]


@pytest.mark.parametrize("model", MODELS)
def test_friction_times_slip_is_the_power_that_sliding_in_the_grooves_takes(answers, model):
    """Exact physics: the force is opposite to the slip; the waveforms are of the revolutions of the powers."""
    found = answers(model)
    power = (found["groove_friction_force"] * found["groove_slip"]).sum(axis=0).mean() / 1e3
    assert power == pytest.approx(found["friction_power_w"][0], rel=2e-3)
    # the thrust of bodies is taken a part of a step ahead of the states that contacts are read off
    late = 0.02 * found["groove_friction_force"].max() if model in ("rollers", "needles") else 1e-9
    thrust = found["groove_thrust"]
    if model == "kinetostatic":  # which reads contacts off the mean of its revolutions
        thrust = np.tile(thrust.reshape(3, 2, -1).mean(1), 2)
    along = found["groove_friction_force"] * np.cos(np.radians(found["groove_slip_direction_deg"]))
    assert thrust == pytest.approx(along, abs=late + (0.15 if model == "kinetostatic" else 0))


@pytest.mark.parametrize("model", MODELS)
def test_friction_is_the_coefficient_times_the_normal_force_where_it_slips(answers, model):
    """Exact physics: mu_s N at slips far beyond the transition velocity."""
    found = answers(model)
    fast = found["groove_slip"] > 0.9 * found["groove_slip"].max()
    ratio = found["groove_friction_force"][fast] / found["groove_normal_force"][fast]
    assert ratio == pytest.approx(np.full(ratio.size, 0.05), rel=3e-3)


@pytest.mark.parametrize("model", ["equilibrium", "kinetostatic"])
def test_balances_agree_with_the_model_that_moves_bodies(answers, model):
    """Limit: what a balance leaves out of the forces is 2 % of them; of places and slip that of swing and tilt."""
    found, bodies = answers(model), answers("rollers")
    for name, error in (
        ("groove_normal_force", 0.02),
        ("groove_pressure_mpa", 0.01),
        ("groove_contact_place_mm", 0.02),
        ("groove_spin", 0.04),
        ("groove_slip", 0.1),
        ("roller_place_mm", 0.08),
        ("roller_contact_place_mm", 0.2),
        ("groove_contact_angle_deg", 0.2),
    ):
        miss = np.sqrt(np.mean((found[name] - bodies[name]) ** 2) / np.mean(bodies[name] ** 2))
        assert miss < error, name
    if model == "kinetostatic":
        across, true = (
            each["groove_slip"] * np.sin(np.radians(each["groove_slip_direction_deg"])) for each in (found, bodies)
        )
        assert np.sqrt(np.mean((across - true) ** 2) / np.mean(true**2)) < 0.1
        tilt, truth = found["roller_tilt_deg"], bodies["roller_tilt_deg"]
        assert np.corrcoef(tilt.ravel(), truth.ravel())[0, 1] > 0.97
        assert found["largest_needle_pressure_mpa"] == pytest.approx(bodies["largest_needle_pressure_mpa"], rel=0.1)


@pytest.mark.parametrize("model", ["kinetostatic", pytest.param("needles", marks=pytest.mark.slow)])
def test_needles_carry_what_presses_the_roller_into_its_groove(answers, model):
    """Balance of a roller: the loads of its needles along the load are the normal force, but for friction and inertia."""
    found = answers(model)
    carried = (found["needle_load"] * np.cos(np.radians(found["needle_angle_deg"]))).sum(axis=1)
    assert carried.mean() == pytest.approx(found["groove_normal_force"].mean(), rel=0.02)
    reach = 0.1 + 5 * (1 - np.cos(np.radians(found["needle_yaw_deg"])))
    assert (np.abs(found["needle_place_mm"]) < reach + 0.01).all()
    pressed = np.abs(found["needle_stop_force"]) > 0.1
    assert (np.sign(found["needle_stop_force"]) == np.sign(found["needle_place_mm"]))[pressed].all()
    assert (np.abs(found["needle_place_mm"])[pressed] > 0.08).all()


def test_the_ellipse_meets_hertz_equations(joint_values):
    """Published: Johnson, Contact Mechanics, Eq. 4.26, for the two relative curvatures; 1 % for printed constants."""
    values = joint_values(groove_radius_ratio=1.03, roller_radius_mm=14)
    force = np.array([100.0, 1000.0])
    major, minor = ellipse_axes(values, force)
    pressure = groove_pressure(values, force)
    assert pressure == pytest.approx(1.5 * force / (np.pi * major * minor))
    modulus = values.youngs_modulus / (2 * (1 - values.poissons_ratio**2))
    squared = 1 - (minor / major) ** 2
    scale = pressure / modulus * minor / (squared * major**2)
    flat = scale * (ellipk(squared) - ellipe(squared))
    steep = scale * ((major / minor) ** 2 * ellipe(squared) - ellipk(squared))
    assert 2 * flat == pytest.approx(np.full(2, 1 / 14 - 1 / (14 * 1.03)), rel=0.01)
    assert 2 * steep == pytest.approx(np.full(2, 1 / 14), rel=0.01)


@pytest.mark.parametrize("model", ["equilibrium", "rollers"])
def test_a_limit_that_is_passed_is_noted(model):
    quiet = td.simulate(model=model, pressure_limit_gpa=5, penetration_limit_um=50)
    assert str(quiet["outcome_detail"].values) == ""
    loud = str(td.simulate(model=model, pressure_limit_gpa=0.4, penetration_limit_um=2)["outcome_detail"].values)
    assert "the pressure in a groove reaches 0.63" in loud
    assert "the pressure of a needle reaches" in loud
    assert "penetration_limit_um is 2" in loud


def test_the_end_of_hertz_theory_is_noted():
    """Exact: a = 0.376 mm N^(-1/3) N^(1/3) is half the width of 11 mm at 3.1 kN, 200 N m."""
    calm, beyond = (str(td.simulate(torque_n_m=torque)["outcome_detail"].values) for torque in (150, 250))
    assert calm == ""
    assert "longer than its roller is wide" in beyond


def test_contacts_are_computed_on_request_only(tmp_path):
    usual = td.simulate()
    assert not CONTACT_NAMES & set(usual.data_vars)
    (tmp_path / "study.toml").write_text(
        '[study]\nname = "c"\n[factors]\ntorque_n_m = { values = [20, 40] }\n'
        f"[keep]\noutputs = {sorted(NEEDLE_NAMES)}\n[base]\nsamples_per_revolution = 36\n".replace("'", '"')
    )
    td.run(tmp_path / "study.toml", out=tmp_path / "out", progress=False, workers=0)
    cube = td.open_cube(tmp_path / "out")
    assert cube["needle_load"].dims == ("torque_n_m", "trunnion", "needle", "rotation_deg")
    assert cube["needle"].values.tolist() == list(range(1, 28))


def test_the_largest_pressure_alone_is_that_of_all_places():
    """Invariance: it is read off the largest load where no pressure of a place is wanted."""
    joint = {"model": "equilibrium", "joint_angle_deg": 11, "torque_n_m": -70, "initial_skew_2_deg": 0.4}
    alone = simulate_point("joint", ("largest_needle_pressure_mpa",), **joint).outputs
    everywhere = simulate_point("joint", ("largest_needle_pressure_mpa", "needle_pressure_mpa"), **joint).outputs
    assert alone["largest_needle_pressure_mpa"].data == everywhere["largest_needle_pressure_mpa"].data
    assert alone["largest_needle_pressure_mpa"].data == everywhere["needle_pressure_mpa"].data.max()
