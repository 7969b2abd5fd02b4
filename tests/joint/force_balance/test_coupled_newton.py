"""Joints that do not relax: the whole revolution at once, rollers that slide freely, and loads that lift a roller."""

from __future__ import annotations

import time
from itertools import product

import numpy as np
import pytest

from tripod_doe.joint.force_balance import coupled_newton, equilibrium
from tripod_doe.joint.force_balance.coupled_newton import settle_together
from tripod_doe.joint.force_balance.equilibrium import solve_equilibrium
from tripod_doe.joint.force_balance.free_rollers import settle_free
from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic
from tripod_doe.joint.models import registry
from tripod_doe.model_interface import Outcome, counted_time

SWITCHES = ("groove_sliding", "groove_spinning", "groove_rolling", "needle_sliding", "needle_rolling")
SKEWS = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4}


@pytest.fixture
def points(internal_points):
    def make(**given):
        return internal_points(**{"relative_tolerance": 1e-9, **given})

    return make


@pytest.fixture
def combinations(points):
    """All combinations of mechanisms at one operating point."""

    def make(**given):
        switched = np.array(list(product((0.0, 1.0), repeat=5)))
        return points(**dict(zip(SWITCHES, switched.T, strict=True)), **given)

    return make


@pytest.mark.parametrize("solve", [solve_equilibrium, solve_kinetostatic])
def test_two_ways_to_the_same_balance(points, monkeypatch, solve):
    """Invariance: relaxation and Newton's method for the whole revolution solve the same equations."""
    given = points(joint_angle_deg=np.array([4.0, 10, 20]), torque_n_m=np.array([100.0, -50, 300]), **SKEWS)
    relaxed = solve(given, 120)
    for name in ("settle_still", "settle_moving"):
        monkeypatch.setattr(equilibrium, name, lambda row, memory, *_: settle_together(row, memory))
    together = solve(given, 120)
    assert together.settled.all()
    assert (together.sweeps < relaxed.sweeps).all()
    largest = np.abs(relaxed.groove_thrust).max()
    np.testing.assert_allclose(together.groove_thrust, relaxed.groove_thrust, rtol=0, atol=1e-7 * largest)


@pytest.mark.slow
@pytest.mark.parametrize(
    "given",
    [
        {"joint_angle_deg": 9, "torque_n_m": 60, **SKEWS},
        {"joint_angle_deg": 0, "torque_n_m": -200, "speed_rpm": 1500},
        {"joint_angle_deg": 2, "torque_n_m": 400, "groove_sliding_friction": 0.12, "transition_ratio": 0.1, **SKEWS},
    ],
)
@pytest.mark.parametrize(("name", "solve"), [("equilibrium", solve_equilibrium), ("kinetostatic", solve_kinetostatic)])
def test_every_combination_of_mechanisms_has_an_answer(combinations, name, solve, given):
    """Regression: 17 of 768 combinations of `equilibrium` and 152 of `kinetostatic` had none."""
    block = combinations(**given, relative_tolerance=registry.MODELS[name].methods["newton"]["relative_tolerance"])
    result = registry.MODELS[name].simulate(block, "newton", 360, ("thrust_amplitude",))
    assert [Outcome(outcome).label for outcome in result.outcome] == ["finished"] * 32
    free = block.groove_sliding_friction == 0
    assert (result.outputs["thrust_amplitude"].data[free] == 0).all()


def test_rollers_that_slide_freely_balance_where_relaxation_runs_in_circles(points, monkeypatch):
    """Exact physics: their friction takes what the shaft gives, to rounding, though no slope leads to the balance."""
    given = points(
        joint_angle_deg=8.32,
        torque_n_m=-218,
        speed_rpm=1560,
        needle_sliding_friction=0.137,
        transition_ratio=0.121,
        groove_sliding=0,
        groove_rolling=0,
        needle_rolling=0,
        initial_skew_1_deg=1.1,
        initial_skew_2_deg=-0.2,
        groove_spin_friction=0.06,
    )
    rounds = []
    monkeypatch.setattr(equilibrium, "settle_free", lambda *it: rounds.append(settle_free(*it)) or rounds[-1])
    monkeypatch.setattr(equilibrium, "settle_still", lambda *_: (False, 0))
    result = solve_equilibrium(given, 360)
    assert rounds[0][0]
    assert abs(result.unexplained_power[0]) < 1e-9
    assert (result.groove_thrust == 0).all()


@pytest.mark.slow
def test_without_groove_sliding_the_thrust_is_zero_even_where_the_spin_is_open(points):
    """Exact physics: the rollers may spin in several ways here, and none of them passes thrust. Regression: diverged."""
    given = points(
        joint_angle_deg=2.1448747287190235,
        torque_n_m=288.85918870907028,
        speed_rpm=535.69380606289974,
        groove_sliding_friction=0.16851689302579362,
        needle_sliding_friction=0.11487753914271878,
        transition_ratio=0.067266296547435767,
        initial_skew_1_deg=1.6073661655283482,
        initial_skew_2_deg=1.5764232738407329,
        initial_skew_3_deg=0.24826485388254982,
        bearing_radial_clearance_mm=0.004660103621180251,
        pitch_radius_mm=19.692868187269589,
        roller_radius_mm=14.234544815595999,
        roller_width_mm=9.3385831700554149,
        needle_count=24,
        needle_diameter_mm=1.8436772119568454,
        needle_length_mm=9.451562294270774,
        needle_pitch_diameter_mm=20.862500214219878,
        shaft_mass_kg=2.0854212160687489,
        groove_radius_ratio=1.0090021501159869,
        groove_sliding=0,
        groove_rolling=0,
        needle_rolling=0,
        relative_tolerance=registry.MODELS["kinetostatic"].methods["newton"]["relative_tolerance"],
    )
    assert not solve_kinetostatic(given, 360).settled[0]
    result = registry.MODELS["kinetostatic"].simulate(given, "newton", 360, ("thrust", "friction_power_w"))
    assert Outcome(result.outcome[0]) == Outcome.FINISHED
    assert "friction power is not known" in result.detail[0]
    assert (result.outputs["thrust"].data == 0).all()
    assert np.isnan(result.outputs["friction_power_w"].data).all()


def test_compilation_of_other_ways_is_no_cost_of_the_first_point_that_needs_them(points, monkeypatch):
    """Regression: the price of the first such point held eleven seconds of compilation; half a second stands for it."""
    calls = []

    def compiled_first(row, memory):
        end = time.thread_time() + (0 if calls else 0.5)
        while time.thread_time() < end:
            pass
        calls.append(memory.samples)
        return settle_together(row, memory)

    equilibrium._compile_other_ways.cache_clear()
    monkeypatch.setattr(equilibrium, "settle_moving", lambda *_: (False, 0))
    monkeypatch.setattr(equilibrium, "settle_together", compiled_first)
    began = counted_time()[0]
    assert solve_kinetostatic(points(), 90).settled.all()
    assert calls == [8, 90, 90]  # once more with the needles that follow
    assert counted_time()[0] - began < 0.4


def test_a_straight_joint_has_no_thrust(points):
    """Exact limit: nothing slips, and inertia alone decides the loads."""
    result = solve_kinetostatic(points(joint_angle_deg=0, torque_n_m=np.array([50, -400.0]), speed_rpm=1500), 360)
    assert result.settled.all()
    assert np.abs(result.groove_thrust).max() < 1e-4
    assert np.abs(result.friction_power).max() < 1e-6


def test_an_orbiting_shaft_lifts_rollers_off(internal_points):
    """A failure is recognised and named: 384 N of the orbiting shaft at 152 N a groove."""
    given = internal_points(joint_angle_deg=23, torque_n_m=9, speed_rpm=2700, relative_tolerance=1e-6)
    result = registry.MODELS["kinetostatic"].simulate(given, "newton", 120, ("thrust_amplitude",))
    assert Outcome(result.outcome[0]) is Outcome.OUT_OF_RANGE
    assert "lifts off" in result.detail[0]
    assert result.force_evaluations[0] <= 40, "what no balance can hold costs no search for one"


def test_a_straight_joint_with_skewed_needles_settles(points):
    """Regression: hasty at the widest transition velocities, where nothing can be gone back to, it gave up 60 times."""
    given = points(
        joint_angle_deg=0,
        torque_n_m=5.160312377165763,
        speed_rpm=2378.361528918933,
        groove_sliding_friction=0.09199592026610104,
        needle_sliding_friction=0.12313973639391294,
        groove_rolling_friction=0.003137209009426322,
        transition_ratio=0.38657386145123057,
        needle_rolling=0,
        initial_skew_1_deg=0.9508045881641998,
        initial_skew_2_deg=0.25397975219987945,
        initial_skew_3_deg=1.3988282515781072,
        bearing_radial_clearance_mm=0.03777204373349923,
        pitch_radius_mm=18.82771288283176,
        roller_radius_mm=19.19123653141017,
        roller_width_mm=8.637299812247432,
        needle_count=20,
        needle_diameter_mm=1.547742852979717,
        needle_length_mm=8.12440259834563,
        needle_pitch_diameter_mm=18.392515456552804,
        shaft_mass_kg=1.8999895672309615,
        groove_radius_ratio=1.009691433309751,
        relative_tolerance=1e-6,
    )
    assert solve_kinetostatic(given, 360).settled[0]


def test_no_point_takes_more_iterations_than_allowed(points, monkeypatch):
    """A failure is bounded: the last step of the transition velocities took up to 27 iterations more than the limit."""
    monkeypatch.setattr(coupled_newton, "_IN_ALL", 50)
    given = points(
        joint_angle_deg=2.09,
        torque_n_m=238,
        speed_rpm=1938,
        groove_sliding_friction=0.134,
        groove_spinning=0,
        needle_sliding_friction=0.14,
        transition_ratio=0.05,
        initial_skew_1_deg=-1.18,
        initial_skew_2_deg=1.2,
        initial_skew_3_deg=0.49,
        relative_tolerance=1e-6,
    )
    found = solve_kinetostatic(given, 360)
    assert not found.settled[0]
    assert found.sweeps[0] == 40 + 50


@pytest.mark.slow
def test_needles_that_hold_back_rollers_that_hardly_move_settle(simulated):
    """Regression: friction of the needles four times the joint angle and a steep transition; given up after 120."""
    result = simulated(
        model="kinetostatic",
        joint_angle_deg=0.9535,
        torque_n_m=40,
        speed_rpm=164.2,
        groove_sliding_friction=0.04317,
        needle_sliding_friction=0.07177,
        groove_rolling_friction=0.005568,
        needle_rolling_friction=0.004497,
        transition_ratio=0.0507,
        initial_skew_1_deg=-0.6488,
        initial_skew_2_deg=1.8246,
        initial_skew_3_deg=-1.5277,
        bearing_radial_clearance_mm=0.006328,
        pitch_radius_mm=21.917,
        roller_radius_mm=15.247,
        roller_width_mm=13.26,
        groove_radius_ratio=1.00688,
        needle_length_mm=12.266,
    )
    assert result.attrs["finished"], str(result["outcome_detail"].values)
