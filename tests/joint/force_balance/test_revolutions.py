"""Single revolutions of a balance whose needles turn, and needles that repeat."""

import numpy as np
import pytest

from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic
from tripod_doe.joint.massless_needles import load_sharing
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.outputs import BY_CYCLE, SETTLED, STEP_ERROR
from tripod_doe.joint.parameters import JOINT_PARAMETERS, MECHANISMS
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.model_interface import Outcome
from tripod_doe.study.simulate import simulate_point

UNEVEN = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4}
COAST = {"joint_angle_deg": 12, "torque_n_m": -200, "speed_rpm": 1800, "initial_skew_2_deg": 0.5}
TO_AND_FRO = UNEVEN | {"joint_angle_deg": 9, "torque_n_m": 120, "speed_rpm": 800, "needle_length_mm": 8}


def second(cycles, settled=0, **given):
    values = point_values({"relative_tolerance": 1e-6, "cycles": cycles, "settled_needles": settled} | given)
    return abs(complex_amplitudes(solve_kinetostatic(values, 360).groove_thrust.sum(1))[0, 2])


def test_revolutions_are_kept_apart():
    """Exact: the orders are those of the mean of the last two revolutions, whose difference is the scatter."""
    found = {
        name: values.data for name, values in simulate_point("joint", (BY_CYCLE, SETTLED), **UNEVEN).outputs.items()
    }
    orders = complex_amplitudes(found["thrust"].reshape(2, -1))
    assert found["thrust_amplitude"] == pytest.approx(np.abs(orders.mean(0)), abs=1e-9)
    assert found["thrust_amplitude_scatter"] == pytest.approx(np.abs(np.diff(np.abs(orders), axis=0)[0]), abs=1e-9)
    assert found[BY_CYCLE][-2:] == pytest.approx(np.abs(orders), abs=1e-9)
    assert 0.005 < found["thrust_amplitude_scatter"][2] < 0.02 < 0.1 < found["thrust_amplitude"][2]
    # the first two as they are at the end of a shorter run
    assert found[BY_CYCLE][:2, 2].mean() == pytest.approx(second(2, **UNEVEN), rel=0.005)


@pytest.mark.parametrize("given", [UNEVEN, COAST, TO_AND_FRO])
def test_needles_that_repeat_are_where_many_revolutions_take_them(given):
    """Exact: extrapolated needles give the second order of 200 revolutions, which differs from that of four."""
    settled = second(4, settled=1, **given)
    assert settled == pytest.approx(second(200, **given), rel=0.01)
    assert abs(second(4, **given) / settled - 1) > 0.1


def test_settled_orders_of_a_point_are_those_of_needles_that_repeat():
    """Invariance: asked as an output, they are the orders with `settled_needles`, by a tolerance of 1e-4."""
    settled = simulate_point("joint", (SETTLED,), **COAST).outputs[SETTLED].data
    assert settled[2] == pytest.approx(second(4, settled=1, **COAST), rel=1e-4)


CROWNED = {
    "joint_angle_deg": 15,
    "torque_n_m": -150,
    "groove_sliding_friction": 0.12,
    "needle_sliding_friction": 0.1,
    "needle_crown_um": 6,
    "initial_skew_1_deg": 0.8,
    "initial_skew_2_deg": -0.5,
}
"""Needles turn fast on their crowns, stopped by much friction."""


@pytest.mark.parametrize(("given", "most"), [(UNEVEN, 0.01), (CROWNED, 0.08)])
def test_errors_of_the_steps_of_needles_hold_finer_steps(monkeypatch, given, most):
    """Convergence: of 32 times as many steps; a second order that settles needles otherwise was off by 9 %."""
    done = simulate_point("joint", ("thrust_amplitude", STEP_ERROR), **given).outputs
    plain = simulate_point("joint", ("thrust_amplitude",), **given).outputs["thrust_amplitude"].data
    monkeypatch.setattr(load_sharing, "_LEAST_STEPS", 32 * 360)
    finest = simulate_point("joint", ("thrust_amplitude",), **given).outputs["thrust_amplitude"].data
    amplitude, error = done["thrust_amplitude"].data, done[STEP_ERROR].data
    np.testing.assert_array_equal(amplitude, plain)
    assert (np.abs(amplitude - finest)[2:4] <= error[2:4]).all()
    assert amplitude[2] == pytest.approx(finest[2], rel=most)


def test_needles_that_never_reach_their_stops_turn_on():
    """Physics: at a small angle a needle's play is more than its way, and only a slow creep turns it."""
    done = simulate_point("joint", settled_needles=1, joint_angle_deg=3, torque_n_m=100, initial_skew_1_deg=0.3)
    assert done.outcome == Outcome.INACCURATE
    assert "did not become periodic" in done.detail


def test_bodies_are_not_extrapolated():
    done = simulate_point("joint", model="needles", settled_needles=1)
    assert done.outcome == Outcome.NOT_APPLICABLE
    assert "raise cycles" in done.detail


def test_an_ablation_switches_mechanisms_only():
    """Needles that repeat are no mechanism: an ablation without factors leaves them as they are."""
    assert [name for name, each in JOINT_PARAMETERS.items() if each.kind == "switch"] == list(MECHANISMS)
