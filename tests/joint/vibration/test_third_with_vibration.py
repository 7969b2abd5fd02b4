"""The third order of a vibrating joint from a part of a revolution."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tripod_doe.joint.vibration import third_with_vibration as module
from tripod_doe.joint.vibration.growing_vibration import growing_vibration
from tripod_doe.joint.vibration.third_with_vibration import departed, third_with_vibration


def test_a_departure_is_carried_on_to_another_state(joint_assembly):
    """Of the shaft whole, of a roller without its turning on the trunnion: a spun roller departs by nothing."""
    assembly = joint_assembly(False)
    smooth = assembly.initial_state()
    state, other = smooth.copy(), smooth.copy()
    shaft, first, second = (assembly.names.index(name) for name in ("shaft", "roller 1", "roller 2"))
    other.positions[:, :3] += 1.0
    state.positions[shaft, :3] += [0.0, 1e-3, 0.0]
    state.velocities[shaft, 5] += 3.0
    twist = Rotation.from_rotvec([0.0, 0.0, 1e-3])
    for body, turn in ((shaft, twist), (first, spin_of(smooth, first, 1.0)), (second, twist)):
        attitude = turn * Rotation.from_quat(smooth.positions[body, 3:], scalar_first=True)
        state.positions[body, 3:] = attitude.as_quat(scalar_first=True)
    new = departed(assembly, state, smooth, other)
    np.testing.assert_allclose(
        new.positions[shaft], [*(other.positions[shaft, :3] + [0, 1e-3, 0]), *state.positions[shaft, 3:]]
    )
    assert new.velocities[shaft, 5] == other.velocities[shaft, 5] + 3.0
    np.testing.assert_allclose(new.positions[first], other.positions[first], atol=1e-12)
    np.testing.assert_allclose(axis(new, second), axis(state, second), atol=1e-6)
    assert abs(axis(new, second) - axis(other, second)).max() > 5e-4


def spin_of(state, roller, angle):
    """A turn of a roller on its trunnion."""
    return Rotation.from_rotvec(angle * axis(state, roller))


def axis(state, body):
    """Direction of a body's own z axis."""
    return Rotation.from_quat(state.positions[body, 3:], scalar_first=True).apply([0.0, 0.0, 1.0])


def test_a_vibration_whose_motion_stops_has_no_third_order(joint_values):
    values = joint_values(joint_angle_deg=17.0, torque_n_m=-300.0, speed_rpm=1500.0, evaluation_budget=50)
    smooth = [module.assemble(module.build_joint(values, needles=False)).initial_state()] * 145
    assert math.isnan(third_with_vibration(values, smooth))


@pytest.mark.slow
def test_at_low_speed_parts_of_the_angles_stand_for_all_of_them(joint_values, monkeypatch):
    values = joint_values(**SLOW)
    smooth = growing_vibration(values).revolution
    in_parts = third_with_vibration(values, smooth)
    monkeypatch.setattr(module, "_IN_A_PART", 10**6)
    assert in_parts == pytest.approx(third_with_vibration(values, smooth), rel=0.04)


SLOW = {
    "joint_angle_deg": 14.0,
    "torque_n_m": 20.0,
    "speed_rpm": 120.0,
    "groove_sliding_friction": 0.15,
    "contact_damping_time_s": 2.5e-6,
}
"""A joint that vibrates some 350 times in a revolution; 19.3 N from all angles, 21.3 N without the vibration."""
