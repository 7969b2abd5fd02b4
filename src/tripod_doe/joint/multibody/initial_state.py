"""Poses and velocities at the start of a run: every roller rolls in its groove.

Axes turn with the housing: z is the input axis towards the intermediate shaft, groove k is at 120 deg (k - 1) from
x. The shaft hangs on its outboard end, which circles backwards in these axes; three trunnion axes pass three groove
axes at a given distance (what load and clearances make), which fixes the shaft's attitude. Unlike `kinematics` this
knows the shaft's finite length. Velocities are central differences in the rotation angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tripod_doe.array_types import FloatArray

GROOVE_ANGLES = np.radians([0.0, 120.0, 240.0])
_STEP = 1e-4  # rad; the differences' error is below 1e-8 of a velocity
_Z = np.array([0.0, 0.0, 1.0])
_OUTWARD = np.stack([np.cos(GROOVE_ANGLES), np.sin(GROOVE_ANGLES), 0.0 * GROOVE_ANGLES])
"""Of the trunnions in the shaft's axes and the grooves in the housing's, as columns."""
_ONWARD = np.stack([-np.sin(GROOVE_ANGLES), np.cos(GROOVE_ANGLES), 0.0 * GROOVE_ANGLES])
"""Along the circle of the grooves in the housing's axes, as columns."""
_TRUNNIONS = Rotation.from_euler("ZY", np.column_stack([GROOVE_ANGLES, np.full(3, np.pi / 2)])).as_matrix()
"""Attitudes of the trunnions in the shaft's axes: their z axis points outward."""
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]
_NEWTON, _NO_TURN = 50, 1e-12
"""Most iterations, and limit of the last turn in rad: the remaining error is its square."""


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


def _shaft_attitudes(ideal: FloatArray, end: FloatArray, length: float, passed: FloatArray) -> FloatArray:
    """Attitude of the shaft whose trunnion axes pass given points of the groove axes, by Newton's method.

    Args:
        ideal: To start from, shape (angle, 3, 3).
        end: Of the shaft, outboard, shape (angle, 3).
        length: Of the shaft in mm.
        passed: Point of every groove axis in the plane of the housing, as columns, shape (3, groove).

    Returns:
        Attitudes, shape (angle, 3, 3).

    Raises:
        ValueError: If the trunnions cannot pass these points.
    """
    attitude = ideal
    for _ in range(_NEWTON):
        trunnions, arm = attitude @ _OUTWARD, length * attitude[..., 2]
        away = passed - (end - arm)[..., None]
        away[:, 2] = 0.0  # rollers may stand anywhere along their groove
        missed = trunnions[:, 0] * away[:, 1] - trunnions[:, 1] * away[:, 0]
        # a turn w changes a trunnion's axis t by w x t, and what is missing to the groove by w x arm
        slopes = trunnions[:, 2, None] * away - arm[:, 2, None, None] * trunnions
        slopes[:, 2] += (trunnions * (arm[..., None] - away)).sum(axis=1)
        turn = np.linalg.solve(slopes.swapaxes(1, 2), -missed[..., None])[..., 0]
        attitude = Rotation.from_rotvec(turn).as_matrix() @ attitude
        if np.abs(turn).max() < _NO_TURN:
            return attitude
    raise ValueError("the trunnions cannot pass the groove axes at this distance")


def _places(
    angles: FloatArray, theta: float, outboard: float, length: float, pitch: float, lag: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (spider, outboard end, three roller centres), shape (point, angle, 3); attitudes of shaft and output."""
    cosine, sine = np.cos(angles), np.sin(angles)

    def turned_back(x: float, z: float) -> FloatArray:
        """A vector (x, 0, z) turned about the input axis, against these angles."""
        return np.stack([x * cosine, -x * sine, np.full_like(angles, z)], axis=1)

    end = length * turned_back(math.sin(theta), math.cos(theta))
    turned = np.zeros((angles.size, 3, 3))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1], turned[:, 2, 2] = cosine, sine, -sine, cosine, 1
    bent = [[math.cos(theta), 0.0, math.sin(theta)], [0.0, 1.0, 0.0], [-math.sin(theta), 0.0, math.cos(theta)]]
    passed = pitch * _OUTWARD - lag * _ONWARD
    shaft = _shaft_attitudes(turned @ bent @ turned.swapaxes(1, 2), end, length, passed)
    trunnions, spider = shaft @ _OUTWARD, end - length * shaft[..., 2]
    level, away = trunnions[:, :2], passed[:2] - spider[:, :2, None]
    climbed = trunnions[:, 2] * (level * away).sum(axis=1) / (level * level).sum(axis=1)
    rollers = passed.T[:, None] + _Z * (spider[:, 2, None] + climbed).T[..., None]
    axis = turned_back(math.sin(theta - outboard), math.cos(theta - outboard))
    across = _cross(axis, shaft[..., 0])  # the fork of the output shaft is square to the shaft's
    across /= np.sqrt((across * across).sum(axis=1, keepdims=True))
    return np.stack([spider, end, *rollers]), shaft, np.stack([_cross(across, axis), across, axis], axis=2)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of vectors, shape (vector, 3); NumPy's takes five times as long."""
    product: FloatArray = a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT]
    return product


def _turn(first: FloatArray, last: FloatArray) -> FloatArray:
    """Rotation vector of a small turn from one attitude to another, in the axes of both."""
    turn = last @ first.T
    twice = (turn - turn.T)[[2, 0, 1], [1, 2, 0]]  # its axis times 2 sin(angle)
    sine = math.sqrt(twice @ twice) / 2
    return twice * (math.asin(sine) / (2 * sine) if sine else 0.5)


def initial_state(
    joint_angle: float, outboard_angle: float, shaft_length: float, pitch_radius: float, speed: float, lag: float
) -> InitialState:
    """Initial state, at rotation angle 0.

    Args:
        joint_angle, outboard_angle: Angles between input axis and shaft and between shaft and output axis in rad; the
            output axis is bent back towards the input axis.
        shaft_length, pitch_radius: In mm.
        speed: Of the housing in rad/s.
        lag: Distance of the trunnion axes behind the groove axes, in mm; negative on coast.

    Raises:
        ValueError: If the trunnions cannot pass the groove axes so.
    """
    angles = _STEP * np.array([-1.0, 0.0, 1.0])
    points, shaft, output = _places(angles, joint_angle, outboard_angle, shaft_length, pitch_radius, lag)
    per_second = speed / (2 * _STEP)
    velocities = (points[:, 2] - points[:, 0]) * per_second
    turns, turns_of_output = (_turn(each[0], each[2]) * per_second for each in (shaft, output))
    attitudes = Rotation.from_matrix(np.stack([shaft[1], output[1], *(shaft[1] @ _TRUNNIONS)]))
    rollers = [Pose(points[2 + k, 1], attitudes[2 + k], velocities[2 + k], turns) for k in range(GROOVE_ANGLES.size)]
    return InitialState(
        Pose(points[0, 1], attitudes[0], velocities[0], turns),
        Pose(points[1, 1], attitudes[1], velocities[1], turns_of_output),
        (rollers[0], rollers[1], rollers[2]),
    )
