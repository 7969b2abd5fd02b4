"""The joint as a simulator: outcomes instead of silent numbers, and a point that is the same in any company."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.errors import InputError
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.joint.simulator import simulator
from tripod_doe.model_interface import Outcome

KEEP = ["thrust_amplitude", "friction_power_w", "largest_penetration_um", "energy_residual"]


def simulate(model="kinetostatic", keep=KEEP, **given):
    count = max((np.size(value) for value in given.values()), default=1)
    columns = {name: np.broadcast_to(np.asarray(value, float), (count,)) for name, value in given.items()}
    return simulator.simulate(simulator.columns({"model": model}, columns, count), keep)


def test_numerics_that_the_model_does_not_use_are_flagged_in_a_grid():
    result = simulate(step_s=[1e-5, np.nan])
    assert result.outcome.tolist() == [Outcome.NOT_APPLICABLE, Outcome.FINISHED]
    assert "step_s" in result.detail[0]
    assert np.isnan(result.outputs["thrust_amplitude"].data[0]).all()
    with pytest.raises(InputError, match="step_s"):
        simulator.check({"step_s": 1e-5}, {}, KEEP)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"needle_count": 28}, "do not fit on the pitch circle"),
        ({"needle_diameter_mm": 9, "needle_pitch_diameter_mm": 8}, "trunnion has no diameter"),
        ({"roller_radius_mm": 9}, "bore is larger"),
        ({"initial_skew_2_deg": -4.6}, "skewed by initial_skew_2_deg do not fit"),
        ({"bearing_radial_clearance_mm": -0.01}, "cannot move on their trunnions"),
        ({"bearing_radial_clearance_mm": -0.05}, "exceeds a contact pressure"),
    ],
)
def test_parts_that_do_not_fit_are_jammed(given, reason):
    result = simulate(**given)
    assert result.outcome.tolist() == [Outcome.JAMMED]
    assert reason in result.detail[0]


@pytest.mark.parametrize(("angle", "torque"), [(2, 35), (10, -420), (25, 180)])
def test_a_joint_at_rest_or_almost_has_no_thrust_to_compute(angle, torque):
    """Exact physics: Coulomb friction does not depend on speed, so a lower thrust at a lower speed is the floor's.

    Regression: 0 rpm finished with zeros, and 0.02 rpm with half of the thrust.
    """
    speeds = np.array([0, 1e-3, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 100])
    result = simulate(joint_angle_deg=angle, torque_n_m=torque, speed_rpm=speeds)
    finished = result.outcome == Outcome.FINISHED
    assert finished[-1]
    assert not finished[0]
    assert set(result.outcome[~finished]) == {Outcome.OUT_OF_RANGE}
    enough = float(re.search(r"raise speed_rpm to at least ([\d.]+)[;,]", result.detail[0])[1])
    near = simulate(joint_angle_deg=angle, torque_n_m=torque, speed_rpm=np.array([enough, 0.9 * enough]))
    assert near.outcome.tolist() == [Outcome.FINISHED, Outcome.OUT_OF_RANGE]
    third = result.outputs["thrust_amplitude"].data[finished, 3]
    assert third == pytest.approx(third[-1], rel=2e-3)


@pytest.mark.parametrize("model", ["equilibrium", "kinetostatic"])
def test_a_straight_joint_turns_without_thrust(model):
    """Exact: regression, 1e-7 N were left by the iteration, and shares of a contribution study were made of them."""
    skewed = {"initial_skew_1_deg": 0.3, "initial_skew_2_deg": -0.6, "needle_crown_um": 2}
    keep = ["thrust", "thrust_amplitude", "groove_thrust_amplitude", "thrust_part_amplitude"]
    result = simulate(model, keep, joint_angle_deg=0, torque_n_m=np.array([-60.0, 2, 900]), speed_rpm=300, **skewed)
    assert result.outcome.tolist() == [Outcome.FINISHED] * 3
    assert set(result.outputs) == set(keep)
    assert all((result.outputs[name].data == 0).all() for name in keep)


def test_a_roller_that_lifts_off_is_out_of_range():
    """Rough needles hold a roller back so hard that the balance wants its groove to pull."""
    result = simulate("equilibrium", joint_angle_deg=20, samples_per_revolution=30, needle_sliding_friction=0.6)
    assert result.outcome.tolist() == [Outcome.OUT_OF_RANGE]
    assert "lifts off" in result.detail[0]


@pytest.mark.parametrize("model", ["equilibrium", "kinetostatic"])
def test_balances_refuse_a_preloaded_bearing(model):
    """Regression: at -0.003 mm they give 16 N where the multibody models agree on 32 to 36 N."""
    result = simulate(model, samples_per_revolution=30, bearing_radial_clearance_mm=-0.003)
    assert result.outcome.tolist() == [Outcome.OUT_OF_RANGE]
    assert "rollers or needles" in result.detail[0]


@pytest.mark.parametrize(("model", "with_all"), [("equilibrium", 14.077), ("kinetostatic", 14.422)])
def test_all_mechanism_combinations_finish_at_the_reference_point(model, with_all):
    """The contribution breakdown needs all 2^5; 1e-5 is the limit of `equilibrium` on its energy balance."""
    switches = np.array(list(itertools.product((0, 1), repeat=len(MECHANISMS)))).T
    result = simulate(model, **dict(zip(MECHANISMS, switches, strict=True)), initial_skew_1_deg=0.4)
    assert (result.outcome == Outcome.FINISHED).all()
    third = dict(zip(map(tuple, switches.T), result.outputs["thrust_amplitude"].data[:, 3], strict=True))
    assert third[1, 1, 1, 1, 1] == pytest.approx(with_all, abs=1e-3)
    assert all(value < 1e-6 for key, value in third.items() if key[0] == 0)
    power = result.outputs["friction_power_w"].data
    assert (power[switches.T == 0] == 0).all()


def test_random_joints_end_in_an_outcome():
    """Invariance: finished means finite and balanced; anything else says why."""
    rng = np.random.default_rng(7)
    result = simulate(
        "equilibrium",
        joint_angle_deg=rng.uniform(0, 40, 60),
        torque_n_m=rng.uniform(-500, 500, 60),
        speed_rpm=rng.uniform(0, 5000, 60),
        groove_sliding_friction=rng.uniform(0.02, 0.3, 60),
        needle_sliding_friction=rng.uniform(0, 0.2, 60),
        pitch_radius_mm=rng.uniform(12, 40, 60),
        initial_skew_1_deg=rng.uniform(-4, 4, 60),
    )
    finished = result.outcome == Outcome.FINISHED
    assert finished.mean() > 0.8
    assert np.isfinite(result.outputs["thrust_amplitude"].data[finished]).all()
    assert np.abs(result.outputs["energy_residual"].data[finished]).max() <= 1e-5
    assert all(result.detail[i] for i in np.flatnonzero(~finished))


def test_waveforms_of_different_lengths_are_refused():
    with pytest.raises(InputError, match="different lengths"):
        simulator.check({}, {"samples_per_revolution": ()}, ["thrust"])
    assert simulator.check({}, {"samples_per_revolution": (60, 90)}, KEEP) == []


@pytest.mark.parametrize("model", ["kinetostatic", "rollers"])
@pytest.mark.parametrize("factor", [0.4, 2.0])
def test_forces_stiffnesses_and_masses_scale_alike(model, factor):
    """Exact: dimensional analysis; with every one of them times a factor, motions stay and forces are multiplied.

    Regression: needle contacts grew with Young's modulus to the power 10/9.
    """
    given = {"torque_n_m": -210.0, "youngs_modulus_gpa": 207.0, "density_kg_m3": 7850.0}
    given |= {"shaft_mass_kg": 2.0, "output_inertia_kg_m2": 0.01}
    others = {"model": model, "joint_angle_deg": 12.9, "speed_rpm": 900.0, "needle_sliding_friction": 0.07}
    once, often = (
        td.simulate(**others, **{name: each * value for name, value in given.items()}) for each in (1.0, factor)
    )
    amplitude = once["thrust_amplitude"]
    assert float(amplitude.max()) > 50
    np.testing.assert_allclose(often["thrust_amplitude"] / factor, amplitude, rtol=1e-6, atol=1e-6)
