"""Poses of all parts over one revolution, from the outputs of a simulated point and the ideal kinematics.

Axes are fixed in space: z is the input axis towards the intermediate shaft, whose axis is (sin theta, 0, cos theta).
Groove k is at the angle phi + (k - 1) 120 deg about z. The spider moves as in `kinematics`, and the centres of the
rollers move on the axes of their grooves; the model gives the needles, and the places along trunnions and grooves.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.model_interface import Value

_Z = np.array([0.0, 0.0, 1.0])
_TURNED = 2 * np.pi / 3 * np.arange(3)


@dataclass(frozen=True)
class Poses:
    """Poses and loads over one revolution, in mm, N and rad."""

    phi: FloatArray  # rotation angle of the housing, shape (sample,)
    spider: FloatArray  # centre of the spider, shape (sample, 3)
    trunnions: FloatArray  # directions of the trunnions, outward, shape (sample, 3, 3)
    rollers: FloatArray  # centres of the rollers, shape (sample, 3, 3)
    axes: FloatArray  # axes of the rollers, outward, shape (sample, 3, 3)
    contacts: FloatArray  # directions from a roller's centre to its contact with the groove, shape (sample, 3, 3)
    normal: FloatArray  # normal forces of the grooves, shape (sample, 3)
    friction: FloatArray  # size of the sliding friction on the rollers, against their slip, shape (sample, 3)
    slip: FloatArray  # size of their slip over the grooves in mm/s, shape (sample, 3)
    # direction of the slip, from the input axis towards away from the joint's axis, shape (sample, 3)
    direction: FloatArray
    pressure: FloatArray  # largest pressure in the grooves in MPa, shape (sample, 3)
    # angle from the loaded side, place along the trunnion, skew and load of each needle, force of its stop: shape
    # (sample, 3, needle, 5); loads are NaN where a model does not know them
    needles: FloatArray
    thrust: FloatArray  # shape (sample,)


def ideal_spider(values: JointValues[float], phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre of the spider and directions of the trunnions, shapes (sample, 3) and (sample, 3, 3)."""
    theta, e = values.joint_angle, values.eccentricity
    first, second = np.array([np.cos(theta), 0.0, -np.sin(theta)]), np.array([0.0, 1.0, 0.0])
    centre = -e * (np.cos(3 * phi)[:, None] * first + np.sin(3 * phi)[:, None] * second)
    turned = phi[:, None] + _TURNED
    return centre, np.cos(turned)[..., None] * first + np.sin(turned)[..., None] * second


def poses_of(parameters: Mapping[str, Value], outputs: Mapping[str, Any]) -> Poses:
    """Poses of a point that finished."""
    values = point_values(parameters).point(0)
    place = _first_turn(outputs["groove_contact_place_mm"], parameters)
    count = len(place)
    phi = 2 * np.pi * np.arange(count) / count
    spider, trunnions = ideal_spider(values, phi)
    turned = phi[:, None] + _TURNED
    outward = np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=-1)
    around, side = np.cross(_Z, outward), -1.0 if values.torque < 0 else 1.0
    angle = np.radians(_first_turn(outputs["groove_contact_angle_deg"], parameters))[..., None]
    contacts = -side * np.cos(angle) * around + np.sin(angle) * outward
    normal = _first_turn(outputs["groove_normal_force"], parameters)
    rollers = values.pitch_radius * outward + place[..., None] * _Z
    tilt = (
        np.radians(_first_turn(outputs["roller_tilt_deg"], parameters)) if "roller_tilt_deg" in outputs else 0 * normal
    )
    axes = trunnions + tilt[..., None] * np.cross(_Z, trunnions)
    return Poses(
        phi,
        spider,
        trunnions,
        rollers,
        axes / np.linalg.norm(axes, axis=-1, keepdims=True),
        contacts,
        normal,
        _first_turn(outputs["groove_friction_force"], parameters),
        _first_turn(outputs["groove_slip"], parameters),
        np.radians(_first_turn(outputs["groove_slip_direction_deg"], parameters)),
        _first_turn(outputs["groove_pressure_mpa"], parameters),
        _needles(values, phi, trunnions, outputs, parameters),
        _first_turn(outputs["thrust"], parameters),
    )


def _first_turn(data: FloatArray, parameters: Mapping[str, Value]) -> FloatArray:
    """The first of the two revolutions of an output, its samples first: (sample, ...)."""
    count = int(float(parameters["samples_per_revolution"] or 0))
    return np.moveaxis(np.asarray(data)[..., :count], -1, 0)


def _needles(
    values: JointValues[float],
    phi: FloatArray,
    trunnions: FloatArray,
    outputs: Mapping[str, Any],
    parameters: Mapping[str, Value],
) -> FloatArray:
    """Every needle: from the model, or as if it rolled without slip, in the middle and at its initial skew."""
    names = ("needle_angle_deg", "needle_place_mm", "needle_yaw_deg", "needle_load", "needle_stop_force")
    count = int(values.needle_count)
    if all(name in outputs and np.isfinite(outputs[name]).all() for name in names):
        data = np.stack([_first_turn(outputs[name], parameters) for name in names], axis=-1)
        data[..., (0, 2)] = np.radians(data[..., (0, 2)])
        return data
    needles = np.full((phi.size, 3, count, 5), np.nan)
    needles[..., 0] = _rolled(values, phi)[..., None] + 2 * np.pi * np.arange(count) / count
    needles[..., 1], needles[..., 2] = 0.0, np.array(values.initial_skews)[:, None]
    return needles


def _rolled(values: JointValues[float], phi: FloatArray) -> FloatArray:
    """Path of the needles around a trunnion while the roller rolls, from phi = 0: (sample, trunnion)."""
    turned, side = phi[:, None] + _TURNED, -1.0 if values.torque < 0 else 1.0
    cosine, sine = np.cos(turned), np.sin(turned)
    sin_theta, versine = np.sin(values.joint_angle), 1 - np.cos(values.joint_angle)
    t_r, t_t, t_z = 1 - versine * cosine**2, versine * sine * cosine, -sin_theta * cosine
    w_r, w_t, w_z = sin_theta * cosine, -sin_theta * sine, -versine  # divided by the speed
    along = values.pitch_radius * np.tan(values.joint_angle) * sine
    spin = -(side * along / values.roller_radius + w_r) / t_r
    pace = 0.5 * values.bore_radius / values.bearing_radius * spin + w_r * t_r + w_t * t_t + w_z * t_z
    moved = np.cumsum(pace, axis=0) * (phi[1] - phi[0])
    rolled: FloatArray = moved - moved[:1]
    return rolled
