"""Poses and velocities at the start of a run: every roller rolls in its groove.

Axes turn with the housing: z is the input axis towards the intermediate shaft, groove k stands at 120 deg (k - 1) from
x. The shaft hangs on its outboard end, which circles backwards in these axes; three trunnion axes pass three groove
axes at a given distance (what load and clearances make), which fixes the shaft's attitude. Unlike `kinematics` this
knows the shaft's finite length. Velocities are central differences in the rotation angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from tripod_doe.array_types import FloatArray

GROOVE_ANGLES = np.radians([0.0, 120.0, 240.0])
_STEP = 1e-4  # rad; the differences' error is below 1e-8 of a velocity
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Pose:
    """A body's place and motion: position, attitude, velocity and angular velocity in the housing's axes."""

    position: FloatArray
    attitude: Rotation
    velocity: FloatArray
    rotation: FloatArray


@dataclass(frozen=True)
class InitialState:
    """Places and motions of shaft, output shaft and rollers."""

    # of its spider centre; its z axis runs to the outboard end, trunnion k at 120 deg (k - 1) from its x axis
    shaft: Pose
    output: Pose  # of the outboard end; its z axis is the output axis, its y axis the fork of the universal joint
    rollers: tuple[Pose, Pose, Pose]  # of the rollers' centres; their z axes are the trunnions', outward


def _frame(axis: FloatArray, fork: FloatArray) -> Rotation:
    """Attitude with a given z axis and, across it, a y axis perpendicular to the `fork` of the other body."""
    across = np.cross(axis, fork)
    across /= np.linalg.norm(across)
    return Rotation.from_matrix(np.column_stack([np.cross(across, axis), across, axis]))


def _attitudes(
    angle: float, theta: float, outboard: float, length: float, pitch: float, lag: float
) -> tuple[list[FloatArray], list[Rotation]]:
    """Points (spider, outboard end, three roller centres) and attitudes (shaft, output, three trunnions)."""
    turned = Rotation.from_rotvec([0.0, 0.0, -angle])
    end = turned.apply(length * np.array([np.sin(theta), 0.0, np.cos(theta)]))
    ideal = turned * Rotation.from_rotvec([0.0, theta, 0.0]) * Rotation.from_rotvec([0.0, 0.0, angle])
    outward = np.column_stack([np.cos(GROOVE_ANGLES), np.sin(GROOVE_ANGLES), np.zeros(3)])
    behind = -lag * np.cross(_Z, outward)

    def gaps(unknown: FloatArray) -> FloatArray:
        shaft = Rotation.from_rotvec(unknown[:3]) * ideal
        on_trunnion = end - length * shaft.apply(_Z) + unknown[3:6, None] * shaft.apply(outward)
        in_groove = pitch * outward + behind + unknown[6:, None] * _Z
        difference: FloatArray = (on_trunnion - in_groove).ravel()
        return difference

    guess = np.concatenate([np.zeros(3), np.full(3, pitch), -pitch * np.tan(theta) * np.cos(GROOVE_ANGLES + angle)])
    solution = root(gaps, guess, tol=1e-14).x
    shaft = Rotation.from_rotvec(solution[:3]) * ideal
    centres = list(pitch * outward + behind + solution[6:, None] * _Z)
    trunnions = [
        shaft * Rotation.from_rotvec(a * _Z) * Rotation.from_rotvec([0.0, np.pi / 2, 0.0]) for a in GROOVE_ANGLES
    ]
    axis = turned.apply([np.sin(theta - outboard), 0.0, np.cos(theta - outboard)])
    output = _frame(axis, shaft.apply(_X))
    return [end - length * shaft.apply(_Z), end, *centres], [shaft, output, *trunnions]


def initial_state(
    joint_angle: float, outboard_angle: float, shaft_length: float, pitch_radius: float, speed: float, lag: float
) -> InitialState:
    """Initial state, at rotation angle 0.

    Args:
        joint_angle, outboard_angle: Angles between input axis and shaft and between shaft and output axis in rad; the
            output axis is bent back towards the input axis.
        shaft_length, pitch_radius: In mm.
        speed: Of the housing in rad/s.
        lag: How far the trunnion axes pass behind the groove axes, in mm; negative on coast.

    Raises:
        ValueError: If the trunnions cannot pass the groove axes so.
    """
    at, before, after = (
        _attitudes(angle, joint_angle, outboard_angle, shaft_length, pitch_radius, lag)
        for angle in (0.0, -_STEP, _STEP)
    )
    poses = []
    for i in range(5):
        velocity = (after[0][i] - before[0][i]) * (speed / (2 * _STEP))
        turn = (after[1][i] * before[1][i].inv()).as_rotvec() * (speed / (2 * _STEP))
        poses.append(Pose(at[0][i], at[1][i], velocity, turn))
    return InitialState(poses[0], poses[1], (poses[2], poses[3], poses[4]))
