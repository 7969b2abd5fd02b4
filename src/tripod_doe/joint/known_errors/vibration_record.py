"""Record of vibrating joints: the share that vibrates among similar ones, and the error of a model without vibration.

`vibrating_joints.csv` holds joints that were followed with vibration and without (by `benchmarks/vibrating_joints.py`).
Joint angle and sliding friction predict best which of them vibrate; needle friction counts half as much as groove
friction: a joint is compared with the nearest ones in the logarithms of angle and such a sum. At all of 35 vibrating
joints that are not on record, one of the 20 nearest vibrates; at 31, one of the 10 nearest in angle and groove friction
alone. Of ordinary joints (`benchmarks/ordinary_joints.py`), none of which vibrates, 13 % have one or the other.
All have the default contact damping; with more, fewer joints vibrate.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.known_errors.nearest import ALIKE, nearest_rows
from tripod_doe.model_interface import NOTABLE_ERROR

VIBRATING = Path(__file__).with_name("vibrating_joints.csv")
"""File of the recorded joints."""

SHARE = "vibration_share"
SHARE_MEANING = (
    "share of the recorded joints with such an angle and such frictions that vibrate by themselves, by which their "
    f"third order changes by more than {100 * NOTABLE_ERROR:g} %"
)

VIBRATES_BY = (
    "joint_angle_deg",
    "groove_sliding_friction",
    "groove_sliding",
    "needle_sliding_friction",
    "needle_sliding",
)
"""Parameters by which joints are compared."""

_LEAST_ANGLE, _LEAST_FRICTION = 0.1, 1e-3
"""Angle in deg and friction below which no joint vibrates; smaller values are raised to these."""

_OF_NEEDLES = 0.5
"""Share of the needles' friction that counts: of 0 to 1.5 in steps of 0.25 the one that misses no vibrating joint."""

_DECIDE = ((_OF_NEEDLES, 2 * ALIKE), (0.0, ALIKE))
"""Share of the needles' friction, and number of the nearest recorded joints: a joint counts as calm if none of these
vibrates, by either way of comparing. By the first alone, a larger joint of 12.7 deg, 40 N m and frictions of 0.055 and
0.03 counts as calm, and vibrates."""


def vibration_errors(points: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Errors of the third order from omitting vibration, at the recorded joints most similar to each point.

    Args:
        points: At least the parameters of `VIBRATES_BY`, in the units of their names, each of shape (point,).

    Returns:
        shape (point, recorded joint): Relative to the third order with vibration; 0 where the recorded joint does not
            vibrate.
    """
    return _errors_like(_compared(points), _OF_NEEDLES, ALIKE)


def near_vibrating(points: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """As `may_vibrate`, of points as in `vibration_errors`."""
    return may_vibrate(*_compared(points))


def _compared(points: Mapping[str, NDArray[Any]]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angle in deg and both sliding frictions, 0 where they are switched off."""
    angle, groove, groove_slides, needle, needle_slides = (points[name] for name in VIBRATES_BY)
    return angle, groove * groove_slides, needle * needle_slides


def may_vibrate(angle: NDArray[Any], groove: NDArray[Any], needle: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether any similar recorded joint vibrates, for angles in deg and sliding frictions of grooves and needles."""
    near = [_errors_like((angle, groove, needle), share, count).any(axis=1) for share, count in _DECIDE]
    return np.logical_or.reduce(near)


def _errors_like(compared: tuple[NDArray[Any], ...], share: float, count: int) -> FloatArray:
    recorded, errors, spread = _recorded(share)
    near: FloatArray = errors[nearest_rows(recorded, _places(compared, share) / spread, count)]
    return near


def vibration_share(errors: FloatArray) -> FloatArray:
    """Share of similar recorded joints in which vibration matters (`SHARE_MEANING`), shape (point,)."""
    share: FloatArray = (errors > NOTABLE_ERROR).mean(axis=1)
    return share


def _places(compared: tuple[NDArray[Any], ...], share: float) -> FloatArray:
    """Logarithms of angle and frictions, shape (joint, 2)."""
    angle, groove, needle = compared
    friction = groove + share * needle
    columns = [np.maximum(angle, _LEAST_ANGLE), np.maximum(friction, _LEAST_FRICTION)]
    return np.asarray(np.log(np.stack(columns, axis=1)), float)


@cache
def _recorded(share: float = _OF_NEEDLES) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of the recorded joints over their spread, their errors, and that spread."""
    with VIBRATING.open(encoding="utf-8") as file:
        table = np.genfromtxt(file, delimiter=",", names=True, skip_header=1)
    places = _places((table["joint_angle_deg"], table["groove_friction"], table["needle_friction"]), share)
    spread = places.std(axis=0)
    return places / spread, np.abs(1 / (1 + table["third_changed"]) - 1), spread
