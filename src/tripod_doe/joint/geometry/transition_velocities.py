"""Transition velocities of the regularised friction laws: the paper's quarter rule on the ideal kinematics (3.1).

v_st = transition_ratio x the largest slip of ideal kinematics. It does not depend on the friction coefficients, so
switching a mechanism off does not move it.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.values import JointValues

_FLOOR = 1e-3  # mm/s and rad/s: at zero speed or joint angle nothing slips, and tanh(0 / floor) says so


@dataclass(frozen=True)
class Transition:
    """Transition velocities, each of shape (point,)."""

    # groove_slip, needle_slip: in mm/s, at the groove, and of a needle along its axis on trunnion and bore
    groove_slip: FloatArray
    needle_slip: FloatArray
    # groove_roll, roller_spin, groove_spin: in rad/s, of rolling in the groove, turning on the trunnion (at which all
    # needles reach theirs), and of spinning about the normal of the groove
    groove_roll: FloatArray
    roller_spin: FloatArray
    groove_spin: FloatArray


def transition_velocities(values: JointValues[Any]) -> Transition:
    """Transition velocities of every point.

    Args:
        values: Of one point or of a block.

    Sliding in the groove: (R_p omega tan theta sin theta / 2) sqrt(1 + (R_s / R_p)^2). Needles: half of the roller's
    plunging 4 e omega, since they slip on trunnion and bore alike. Rolling in the groove: R_p omega tan theta / R_s;
    on the trunnion that spin together with omega sin theta, out of phase. Spinning: theta omega.
    """
    return Transition(*(np.maximum(velocity, _FLOOR) for velocity in astuple(_quarter_rule(values))))


def slides_too_slowly(values: JointValues[FloatArray]) -> NDArray[np.bool_]:
    """Points where the floor replaces the quarter rule, shape (point,): friction there decreases with the slip.

    At 10 deg this holds below 0.22 rpm; at 0.02 rpm the thrust is half of its value at higher speeds. A straight joint
    does not slip: its thrust is zero by symmetry, and it is not included unless it stands still.
    """
    unset = np.full_like(values.speed, np.nan)
    ideal = _quarter_rule(replace(values, groove_transition_velocity=unset, needle_transition_velocity=unset))
    floored = np.any(np.array(astuple(ideal)) < _FLOOR, axis=0) & (values.joint_angle > 0)
    return np.asarray(floored | (values.speed == 0), bool)


def _quarter_rule(values: JointValues[Any]) -> Transition:
    """Transition velocities as given or from ideal kinematics, without a floor."""
    theta, omega, ratio = values.joint_angle, values.speed, values.transition_ratio
    pitch, roller = values.pitch_radius, values.roller_radius
    travel = pitch * omega * np.tan(theta)
    eccentricity = pitch * (1 / np.cos(theta) - 1) / 2
    groove = ratio * travel * np.sin(theta) / 2 * np.hypot(1, roller / pitch)
    needle = ratio * 2 * eccentricity * omega
    given_groove, given_needle = values.groove_transition_velocity, values.needle_transition_velocity
    return Transition(
        groove_slip=np.where(np.isnan(given_groove), groove, given_groove),
        needle_slip=np.where(np.isnan(given_needle), needle, given_needle),
        groove_roll=ratio * travel / roller,
        roller_spin=ratio * np.hypot(travel / roller, omega * np.sin(theta)),
        groove_spin=ratio * theta * omega,
    )
