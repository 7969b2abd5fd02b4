"""Does a joint whose motion was balanced vibrate by itself? What its lumped joint says, for models without vibration.

A balance knows no departures from its motion. So the joint with lumped bearings is followed through a smooth motion,
and departures from that are tested for growth (`onset`), as before each run of `rollers`: both say the same. This costs
as much as several balances, so it is done on request.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.outputs import VIBRATION_VERDICT
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration.onset import growing_vibration
from tripod_doe.model_interface import BlockResult, Outcome


def rows_to_judge(points: JointValues[FloatArray], block: BlockResult) -> IntArray:
    """Rows of the joints that are answered, bend, turn, and carry a torque: of others nothing is known."""
    bends = (points.joint_angle > 0) & (points.torque != 0) & (points.speed > 0)
    return np.flatnonzero((block.outcome == Outcome.FINISHED) & bends)


def judge_vibrations(points: JointValues[FloatArray], rows: IntArray, block: BlockResult) -> dict[str, FloatArray]:
    """Whether some joints of a block vibrate by themselves; a note at each that does.

    Returns:
        The outputs `VIBRATION_VERDICT`, shape (point,), NaN at other rows.
    """
    verdicts = np.full((len(VIBRATION_VERDICT), block.count), np.nan)
    for row in map(int, rows):
        vibration = growing_vibration(points.point(row))
        if vibration is None:
            verdicts[:, row] = 1.0, 0.0, 0.0
            continue
        verdicts[:, row] = vibration.growth.factor, vibration.growth.rate, vibration.hertz
        notes = [block.detail[row], f"{vibration.described}, which this model leaves out; rollers follow it"]
        block.end(np.array([row]), Outcome.FINISHED, "; ".join(note for note in notes if note))
    return dict(zip(VIBRATION_VERDICT, verdicts, strict=True))
