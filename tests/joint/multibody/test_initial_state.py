"""Where the parts of the joint start: constraints as geometry, and the closed form that a long shaft must approach."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.geometry.kinematics import ideal_motion
from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES, initial_state

X, Y, Z = np.eye(3)
PITCH, SPEED = 21.0, 20 * np.pi
CASES = [(0.17, 0.0, 350.0, 0.0), (0.17, 0.1, 350.0, 0.16), (0.5, 0.0, 80.0, -0.2), (0.02, 0.3, 350.0, 0.1)]


def groove_axes(k):
    """Radial and tangential direction of groove k."""
    angle = GROOVE_ANGLES[k]
    return np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])


@pytest.mark.parametrize(("angle", "outboard", "length", "lag"), CASES)
def test_rollers_stand_on_trunnions_and_behind_grooves(angle, outboard, length, lag):
    """Exact physics; 1e-9 mm is what the root finder leaves of 21 mm."""
    state = initial_state(angle, outboard, length, PITCH, SPEED, lag)
    shaft = state.shaft
    assert np.linalg.norm(state.output.position - shaft.position) == pytest.approx(length, abs=1e-9)
    assert shaft.attitude.apply(length * Z) == pytest.approx(state.output.position - shaft.position, abs=1e-9)
    for k, roller in enumerate(state.rollers):
        outward, along = groove_axes(k)
        assert roller.position[:2] == pytest.approx((PITCH * outward - lag * along)[:2], abs=1e-9)
        trunnion = shaft.attitude.apply(outward)
        assert roller.attitude.apply(Z) == pytest.approx(trunnion, abs=1e-12)
        assert np.cross(roller.position - shaft.position, trunnion) == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize(("angle", "outboard", "length", "lag"), CASES)
def test_shafts_stand_at_their_angles(angle, outboard, length, lag):
    """Exact physics: the outboard end is where the joint angle puts it; the fork of the universal joint is square."""
    state = initial_state(angle, outboard, length, PITCH, SPEED, lag)
    end = length * np.array([np.sin(angle), 0.0, np.cos(angle)])
    assert state.output.position == pytest.approx(end, abs=1e-12)
    axis = state.output.attitude.apply(Z)
    assert np.arctan2(axis[0], axis[2]) == pytest.approx(angle - outboard, abs=1e-12)
    assert state.output.attitude.apply(Y) @ state.shaft.attitude.apply(X) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("angle", "outboard", "length", "lag"), CASES)
def test_velocities_obey_the_same_constraints(angle, outboard, length, lag):
    """Exact physics: rollers move along their groove, and against the spider only along its trunnion."""
    state = initial_state(angle, outboard, length, PITCH, SPEED, lag)
    shaft, rate = state.shaft, 1e-6 * PITCH * SPEED
    for k, roller in enumerate(state.rollers):
        outward, _ = groove_axes(k)
        trunnion = shaft.attitude.apply(outward)
        carried = shaft.velocity + np.cross(shaft.rotation, roller.position - shaft.position)
        assert roller.velocity[:2] == pytest.approx(np.zeros(2), abs=rate)
        assert np.cross(roller.velocity - carried, trunnion) == pytest.approx(np.zeros(3), abs=rate)
    reach = state.output.position - shaft.position
    carried = shaft.velocity + np.cross(shaft.rotation, reach)
    assert carried == pytest.approx(np.cross([0, 0, -SPEED], state.output.position), abs=rate)
    axis = state.output.attitude.apply(Z)
    turning = state.output.rotation + SPEED * Z  # in axes at rest the output shaft only turns about its axis
    assert np.cross(turning, axis) == pytest.approx(np.zeros(3), abs=1e-6 * SPEED)


def test_a_long_shaft_approaches_the_closed_form():
    """Exact physics: what the shaft's length does falls as R_p / L, here 2e-5."""
    angle = 0.2
    state = initial_state(angle, 0.0, 1e6, PITCH, SPEED, 0.0)
    shaft, close = state.shaft, 1e-4
    for k, roller in enumerate(state.rollers):
        phi, (outward, along) = GROOVE_ANGLES[k], groove_axes(k)
        motion = ideal_motion(np.cos(phi), np.sin(phi), np.cos(angle), np.sin(angle), PITCH, SPEED)
        axis = roller.attitude.apply(Z)
        frame = np.stack([outward, along, Z])
        assert frame @ axis == pytest.approx([motion.t_r, motion.t_t, motion.t_z], abs=close)
        assert frame @ shaft.rotation == pytest.approx([motion.w_r, motion.w_t, motion.w_z], abs=close * SPEED)
        assert (roller.position - shaft.position) @ axis == pytest.approx(motion.distance, abs=close * PITCH)
        assert roller.velocity[2] == pytest.approx(motion.along_groove, abs=close * PITCH * SPEED)
        carried = shaft.velocity + np.cross(shaft.rotation, roller.position - shaft.position)
        assert (roller.velocity - carried) @ axis == pytest.approx(motion.along_trunnion, abs=close * PITCH * SPEED)


def test_a_straight_joint_turns_as_one():
    """Exact physics: at zero joint angle nothing moves in the housing's axes."""
    state = initial_state(0.0, 0.0, 350.0, PITCH, SPEED, 0.0)
    for pose in (state.shaft, state.output, *state.rollers):
        assert pose.velocity == pytest.approx(np.zeros(3), abs=1e-6)
        assert pose.rotation == pytest.approx(np.zeros(3), abs=1e-7)
    assert state.shaft.position == pytest.approx(np.zeros(3), abs=1e-9)
    for k, roller in enumerate(state.rollers):
        assert roller.position == pytest.approx(PITCH * groove_axes(k)[0], abs=1e-9)
