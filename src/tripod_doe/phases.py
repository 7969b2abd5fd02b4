"""Phases: angles on a circle, in degrees. Which variables are some, and what may be calculated with them.

A phase has differences, a mean and distances, but no zero, no largest value and no percentages: an analysis that needs
one of these refuses it or leaves it out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray

PHASE_ATTRIBUTES = {"wraps_at": "+-180 degree"}
"""Attributes by which a variable of a cube states that it is a phase: one of the joint, or a formula of phases."""

JUMPS = "a phase jumps from 180 to -180 deg, so it has no zero, no largest value and no percentages"
"""Why a phase is refused, or left out."""

_END = "_phase_deg"
_QUARTER_TURN = 90.0  # deg: phases within this of their mean are in one half of the circle, where they have an order
_ROUNDING = 1e-9  # deg, and part of a turn


def is_phase_name(name: str) -> bool:
    """Whether an output of this name is a phase, also one of a user's function: ``X_phase_deg``."""
    return name.endswith(_END)


def is_phase(variable: Any) -> bool:
    """Whether a variable of a cube is a phase, by its attributes or its name."""
    return bool(PHASE_ATTRIBUTES.keys() & variable.attrs.keys()) or is_phase_name(str(getattr(variable, "name", "")))


def amplitude_of(name: str) -> str:
    """The name of the amplitude of which a variable is the phase: ``X_amplitude`` of ``X_phase_deg``; else empty."""
    return f"{name.removesuffix(_END)}_amplitude" if is_phase_name(name) else ""


def shorter_way(degrees: Any) -> Any:
    """Angles, or their differences by the shorter way, above -180 and up to 180 deg; half a turn is 180 deg."""
    with np.errstate(invalid="ignore"):  # of an infinity
        turned = 180 - (180 - degrees) % 360
    return turned + 360 * (turned <= _ROUNDING - 180)


def turned_on(degrees: Any) -> Any:
    """Angles from 0 to 360 deg; one that is below 0 by rounding does not become 360."""
    return (degrees + _ROUNDING) % 360 - _ROUNDING


def around_mean(degrees: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Phases by their differences from the circular mean along the first axis, and that mean; those unknown stay NaN.

    Where opposite phases leave no mean, the first of them stands for it.
    """
    known = np.isfinite(degrees)
    sum_ = (known * np.exp(1j * np.radians(np.where(known, degrees, 0.0)))).sum(axis=0)
    first = np.take_along_axis(degrees, known.argmax(axis=0)[None], axis=0)[0]
    centre = np.where(np.abs(sum_) > _ROUNDING * known.sum(axis=0), np.degrees(np.angle(sum_)), first)
    return shorter_way(np.where(known, degrees, np.nan) - centre), np.nan_to_num(centre)


def in_a_row(degrees: FloatArray) -> FloatArray | None:
    """Phases as numbers that do not jump at 180 deg; None where they lie in no half of the circle, so have no order."""
    relative, centre = around_mean(degrees.ravel())
    if not np.nanmax(np.abs(relative), initial=0.0) < _QUARTER_TURN:
        return None
    return np.asarray(relative + centre).reshape(degrees.shape)
