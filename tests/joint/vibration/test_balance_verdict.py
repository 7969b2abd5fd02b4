"""Balances that say whether their joint vibrates: the same as `rollers`, with the same thrust as without the question."""

from __future__ import annotations

import numpy as np
import pytest
from operating_points import points

from tripod_doe.joint.outputs import VIBRATION_VERDICT
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.vibration.onset import growing_vibration
from tripod_doe.model_interface import Outcome

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
