"""Balances that say whether their joint vibrates: the same as `rollers`, with the same thrust as without the question."""

from __future__ import annotations

import time

import numpy as np
import pytest
from operating_points import points

from tripod_doe.joint.known_errors.vibration_record import SHARE
from tripod_doe.joint.models import multibody_models, multibody_run
from tripod_doe.joint.outputs import VIBRATES, VIBRATION_THIRD, VIBRATION_VERDICT
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import internal_values
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.model_interface import Accuracy, Outcome, Quantity, counted_time

JOINTS = {"torque_n_m": [50.0, 5.0, 50.0], "speed_rpm": [600.0, 300.0, 600.0], "joint_angle_deg": [10.0, 10.0, 0.0]}
"""The reference joint, one of so little torque that it vibrates, and a straight one."""


@pytest.mark.parametrize("model", ["equilibrium", "kinetostatic"])
def test_a_balance_says_what_rollers_say_and_keeps_its_thrust(model, joint_values):
    block = points(model=np.array([model], object), **JOINTS)
    asked = simulator.simulate(block, ("thrust_amplitude", *VIBRATION_VERDICT))
    plain = simulator.simulate(block, ("thrust_amplitude",))
    np.testing.assert_array_equal(asked.outputs["thrust_amplitude"].data, plain.outputs["thrust_amplitude"].data)
    assert (asked.outcome == Outcome.FINISHED).all()
    growth, rate, hertz = (asked.outputs[name].data for name in VIBRATION_VERDICT)
    vibration = growing_vibration(joint_values(torque_n_m=5.0, speed_rpm=300.0))
    told = vibration.growth.factor, vibration.growth.rate, vibration.hertz
    np.testing.assert_allclose([growth, rate, hertz], np.transpose([[1, 0, 0], told, [np.nan] * 3]), rtol=1e-6)
    assert [bool(detail) for detail in asked.detail] == [False, True, False]
    assert asked.detail[1].startswith("self-excited vibration at about 56")
    assert "which this model leaves out" in asked.detail[1]


def test_damping_has_no_effect_on_a_balance_unless_vibrations_are_asked_for():
    factors = {"contact_damping_time_s": [2.5e-6, 8e-6]}
    assert any("not represented" in told for told in simulator.check({}, factors, ("thrust_amplitude",)))
    assert not simulator.check({}, factors, ("thrust_amplitude", "vibration_growth"))


def test_a_balance_that_looks_for_vibrations_does_not_call_answers_with_other_damping_the_same():
    factors, keep = {"contact_damping_time_s": [2.5e-6, 8e-6]}, ("thrust_amplitude", VIBRATES)
    (told,) = simulator.check({}, factors, keep)
    assert "same answer" not in told
    assert "vibrates" in told
    (of_massless,) = simulator.check({"model": "equilibrium"}, factors, keep)  # which does not look
    assert "same answer" in of_massless


def test_modules_that_the_first_look_loads_are_not_counted(monkeypatch):
    def loads(point, method):
        while time.thread_time() - began < 0.1:
            pass

    monkeypatch.setattr(multibody_run, "compile_joint", loads)
    block = points(joint_angle_deg=[12.0], groove_sliding_friction=[0.1])
    began, (counted, _) = time.thread_time(), counted_time()
    multibody_models.prepare_multibody(internal_values(block), "adaptive-euler")
    assert time.thread_time() - began >= 0.1
    assert counted_time()[0] - counted < 0.05


def test_kernels_are_loaded_once_per_process(monkeypatch):
    """Price: every block of a study loaded them again, by a run that costs as much as ten joints."""
    block = internal_values(points(joint_angle_deg=[12.0], groove_sliding_friction=[0.1]))
    multibody_models.prepare_multibody(block, "adaptive-euler")
    monkeypatch.setattr(multibody_run, "run", None)
    multibody_models.prepare_multibody(block, "adaptive-euler")


MAY = {"joint_angle_deg": [10.0, 12.0, 17.0], "groove_sliding_friction": [0.05, 0.12, 0.15]}
"""Joints like the first do not vibrate; of those like the others some do."""

ROLLERS_WITH_VIBRATION = 271.6
"""N, +- 4.7; third order of the last of them by `rollers`, 391.7 N without the vibration."""


def test_a_joint_is_looked_at_where_those_on_record_do_not_say_that_it_is_calm():
    block = points(**MAY, torque_n_m=[50.0, 100.0, -300.0], speed_rpm=[600.0, 600.0, 1500.0])
    done = simulator.simulate(block, ("thrust_amplitude", VIBRATES, VIBRATION_THIRD))
    np.testing.assert_array_equal(done.outputs[VIBRATES].data, [np.nan, 0, 1])
    third = done.outputs[VIBRATION_THIRD].data
    np.testing.assert_array_equal(np.isnan(third), [True, True, False])
    assert third[2] == pytest.approx(ROLLERS_WITH_VIBRATION, rel=0.1)
    assert f"to about {third[2]:.3g} N" in done.detail[2]
    assert [detail.startswith("self-excited vibration") for detail in done.detail] == [False, False, True]
    by_record = simulator.model_errors(block)
    errors = simulator.model_errors(block, {VIBRATES: done.outputs[VIBRATES].data})
    assert errors.limit[0] == by_record.limit[0]
    assert errors.limit[1] < 0.05 < by_record.limit[1]  # without the vibrations of others
    assert np.isnan(errors.limit[2])
    assert "leaves the vibration out" in errors.unknown[2]
    assert outside_by_share(by_record) == [False, True, True]
    assert outside_by_share(errors) == [False, False, False]  # the verdict is the reason


def outside_by_share(errors):
    """Points whose neighbours on record vibrate too often for `kinetostatic`."""
    share = next(each for each in errors.departures if each.left.quantity == SHARE and each.model == "kinetostatic")
    return share.outside.tolist()


def test_a_choice_by_record_looks_at_joints_that_may_vibrate():
    asked = Accuracy((Quantity("thrust_amplitude_3", "thrust_amplitude", 3, 0.05),), 0.01)
    block = points(**MAY, torque_n_m=[50.0, 100.0, -300.0], speed_rpm=[600.0, 600.0, 1500.0])
    errors = simulator.recorded_errors(block, asked)
    assert np.isfinite(errors[1]).mean() > 0.5
    assert np.isnan(errors[2]).all()


def test_less_damping_than_joints_on_record_have_is_looked_at():
    block = points(joint_angle_deg=[10.0, 10.0], contact_damping_time_s=[8e-6, 1e-6])
    done = simulator.simulate(block, ("thrust_amplitude", VIBRATES))
    assert np.isfinite(done.outputs[VIBRATES].data).tolist() == [False, True]
