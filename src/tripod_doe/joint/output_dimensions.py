"""Dimensions of the joint's outputs, with their labels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.orders import ORDERS
from tripod_doe.model_interface import Dimension


def rotation_angles(samples_per_revolution: int) -> NDArray[np.floating]:
    """Rotation angles of the samples of the last two revolutions, in degrees."""
    return np.arange(2 * samples_per_revolution) * (360 / samples_per_revolution)


ROTATION = Dimension(
    "rotation_deg",
    rotation_angles,
    "degree",
    "rotation angle of the housing",
    length_parameter="samples_per_revolution",
    convention="0: the centre of roller 1 lies in the plane of both axes, between them; grooves 2 and 3 follow at +120 "
    "and +240 degree",
)
ORDER = Dimension("order", ORDERS, "1", "rotating order")
GROOVE = Dimension("groove", np.arange(1, 4), "1", "number of the groove")
TRUNNION = Dimension("trunnion", np.arange(1, 4), "1", "number of the trunnion")
CYCLE = Dimension("cycle", lambda cycles: np.arange(1, cycles + 1), length_parameter="cycles")
STATISTIC = Dimension("statistic", np.array(["mean", "min", "max"]))
NEEDLE = Dimension(
    "needle",
    lambda count: np.arange(1, count + 1),
    "1",
    "number of the needle on its trunnion",
    length_parameter="needle_count",
    convention="1: in the middle of the load at the start; counterclockwise about the outward normal of the trunnion",
)
