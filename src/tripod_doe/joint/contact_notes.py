"""Notes on points whose contacts violate Hertz's assumptions, or the user's limits of pressure and penetration.

Hertz's half-spaces have no edges: the ellipse in the groove must end within the width of the roller. A longer ellipse
is cut off: pressure at the edges is then higher, and the contact softer, than in the models.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.derived_constants.contact_pressure import ellipse_axes, groove_pressure
from tripod_doe.joint.values import JointValues
from tripod_doe.model_interface import BlockResult, Outcome

_CUT_OFF = (
    "the contact ellipse of a groove is longer than its roller is wide, where Hertz's theory ends: pressure and "
    "stiffness of the groove are taken from a wider roller"
)


@dataclass(frozen=True)
class Extremes:
    """Largest loads of the contacts of a block of points, each of shape (point,)."""

    normal_force: FloatArray  # in a groove, N
    penetration: FloatArray  # of any contact, um
    needle_pressure: FloatArray  # MPa; read only if the user sets a limit


def add_contact_notes(block: BlockResult, points: JointValues[FloatArray], extremes: Extremes) -> None:
    """Add notes to the points of a block that finished."""
    pressure = groove_pressure(points, extremes.normal_force)
    finished = block.outcome == Outcome.FINISHED
    reasons: list[tuple[NDArray[np.bool_], str, FloatArray, FloatArray | None]] = [
        (ellipse_axes(points, extremes.normal_force)[0] > points.roller_width / 2, _CUT_OFF, pressure, None),
        (
            pressure > points.pressure_limit,
            "the pressure in a groove reaches {:.4g} GPa, and pressure_limit_gpa is {:.4g}",
            pressure / 1e3,
            points.pressure_limit / 1e3,
        ),
        (
            extremes.needle_pressure > points.pressure_limit,
            "the pressure of a needle reaches {:.4g} GPa, and pressure_limit_gpa is {:.4g}",
            extremes.needle_pressure / 1e3,
            points.pressure_limit / 1e3,
        ),
        (
            extremes.penetration > 1e3 * points.penetration_limit,
            "a penetration reaches {:.4g} um, and penetration_limit_um is {:.4g}",
            extremes.penetration,
            1e3 * points.penetration_limit,
        ),
    ]
    for exceeded, text, value, limit in reasons:
        for i in map(int, np.flatnonzero(exceeded & finished)):
            note = text if limit is None else text.format(value[i], limit[i])
            block.detail[i] = f"{block.detail[i]}; {note}" if block.detail[i] else note
