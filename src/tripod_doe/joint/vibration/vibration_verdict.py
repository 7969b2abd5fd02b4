"""Test for self-excited vibration in models without vibration, by a run with lumped bearings.

A balance contains no departures from its motion. So the joint with lumped bearings is followed through a smooth motion,
and its departures are tested for growth (`growing_vibration`), as before each run of `rollers`: both results agree.
This costs several balances: the test runs on request, and if the recorded joints do not rule out vibration.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.known_errors.vibration_record import may_vibrate
from tripod_doe.joint.outputs import VIBRATES, VIBRATION_THIRD, VIBRATION_VERDICT
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.contact_damping_parameters import GREASED
from tripod_doe.model_interface import BlockResult, Outcome

if TYPE_CHECKING:
    from tripod_doe.joint.vibration.growing_vibration import Vibration

_MOST = 300
"""Number of joints of a study that are tested before it runs, some ten seconds."""


def rows_to_judge(points: JointValues[FloatArray], block: BlockResult) -> IntArray:
    """Rows of solved joints with angle, speed and torque; the test does not apply to others."""
    return np.flatnonzero((block.outcome == Outcome.FINISHED) & _in_motion(points))


def _in_motion(points: JointValues[FloatArray]) -> NDArray[np.bool_]:
    return np.asarray((points.joint_angle > 0) & (points.torque != 0) & (points.speed > 0))


def undecided_rows(points: JointValues[FloatArray], rows: IntArray) -> IntArray:
    """Rows whose joints may vibrate: similar recorded joints vibrate, or have more damping."""
    joints = points.take(rows)
    less = joints.contact_damping_time < GREASED  # as joints on record have it
    frictions = joints.groove_sliding_friction, joints.needle_sliding_friction
    return rows[less | may_vibrate(np.degrees(joints.joint_angle), *frictions)]


def some_vibrate(points: JointValues[FloatArray]) -> FloatArray:
    """Whether joints vibrate, 1 or 0, for the first joints that may; NaN at others, shape (point,)."""
    from tripod_doe.joint.vibration.growing_vibration import (
        growing_vibration,  # 0.6 s, which most processes do not need
    )

    verdicts = np.full(points.torque.size, np.nan)
    for row in undecided_rows(points, np.flatnonzero(_in_motion(points)))[:_MOST].tolist():
        verdicts[row] = growing_vibration(points.point(row)) is not None
    return verdicts


def judge_vibrations(
    points: JointValues[FloatArray], rows: IntArray, block: BlockResult, third: bool
) -> dict[str, FloatArray]:
    """Test some joints of a block for self-excited vibration; add a note at each vibrating joint.

    Args:
        third: Whether to compute the third order of the thrust with the vibration.

    Returns:
        The outputs `VIBRATES`, `VIBRATION_VERDICT` and `VIBRATION_THIRD`, shape (point,), NaN at other rows.
    """
    verdicts = np.full((2 + len(VIBRATION_VERDICT), block.count), np.nan)
    if rows.size:
        from tripod_doe.joint.vibration.growing_vibration import growing_vibration
    for row in map(int, rows):
        values = points.point(row)
        vibration = growing_vibration(values)
        if vibration is None:
            verdicts[:, row] = 0.0, 1.0, 0.0, 0.0, np.nan
            continue
        growth, with_it = vibration.growth, _third(values, vibration) if third else np.nan
        verdicts[:, row] = 1.0, growth.factor, growth.rate, vibration.hertz, with_it
        note = f"{vibration.described}, which this model leaves out"
        if not np.isnan(with_it):
            change = f"from {vibration.third:.3g} to about {with_it:.3g} N"
            note += f": it changes the third order, with needles that keep their skew, {change}"
        notes = [block.detail[row], f"{note}; rollers follow it"]
        block.end(np.array([row]), Outcome.FINISHED, "; ".join(note for note in notes if note))
    return dict(zip((VIBRATES, *VIBRATION_VERDICT, VIBRATION_THIRD), verdicts, strict=True))


def _third(values: JointValues[float], vibration: Vibration) -> float:
    from tripod_doe.joint.vibration.third_with_vibration import third_with_vibration

    return third_with_vibration(values, vibration.revolution)
