"""Transition velocities of the regularised friction laws: the paper's quarter rule on the ideal kinematics (3.1).

v_st = transition_ratio x the largest slip of ideal kinematics. It does not depend on the friction coefficients, so
switching a mechanism off does not move it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.values import JointValues

__all__ = ["Transition", "transition_velocities"]

FloatArray = NDArray[np.float64]

_FLOOR = 1e-3  # mm/s and rad/s: at zero speed or joint angle nothing slips, and tanh(0 / floor) says so


@dataclass(frozen=True)
class Transition:
    """Transition velocities a point, each of shape (point,).

    Attributes
    ----------
    groove_sliding, needle_sliding
        In mm/s, of the slip at the groove and of a needle along its axis on trunnion and bore.
    groove_rolling, roller_spin, spinning
        In rad/s, of the rolling in the groove, of the roller's turning on its trunnion (at which all its needles
        reach theirs), and of the spinning about the normal of the groove.
    """

    groove_sliding: FloatArray
    needle_sliding: FloatArray
    groove_rolling: FloatArray
    roller_spin: FloatArray
    spinning: FloatArray


def transition_velocities(values: JointValues[Any]) -> Transition:
    """Transition velocities of every point.

    Parameters
    ----------
    values
        Of one point or of a block.

    Notes
    -----
    Sliding in the groove: (R_p omega tan theta sin theta / 2) sqrt(1 + (R_s / R_p)^2). Needles: half of the roller's
    plunging 4 e omega, since they slip on trunnion and bore alike. Rolling in the groove: R_p omega tan theta / R_s;
    on the trunnion that spin together with omega sin theta, out of phase. Spinning: theta omega.
    """
    theta, omega, ratio = values.joint_angle, values.speed, values.transition_ratio
    pitch, roller = values.pitch_radius, values.roller_radius
    travel = pitch * omega * np.tan(theta)
    eccentricity = pitch * (1 / np.cos(theta) - 1) / 2
    groove = ratio * travel * np.sin(theta) / 2 * np.hypot(1, roller / pitch)
    needle = ratio * 2 * eccentricity * omega
    given_groove, given_needle = values.groove_transition_velocity, values.needle_transition_velocity
    return Transition(
        groove_sliding=np.maximum(np.where(np.isnan(given_groove), groove, given_groove), _FLOOR),
        needle_sliding=np.maximum(np.where(np.isnan(given_needle), needle, given_needle), _FLOOR),
        groove_rolling=np.maximum(ratio * travel / roller, _FLOOR),
        roller_spin=np.maximum(ratio * np.hypot(travel / roller, omega * np.sin(theta)), _FLOOR),
        spinning=np.maximum(ratio * theta * omega, _FLOOR),
    )
