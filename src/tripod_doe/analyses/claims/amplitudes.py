"""Amplitudes of orders from the evidence: single points, lines over a factor, and measures of several amplitudes."""

import math
from typing import Any

import numpy as np

from tripod_doe.analyses.claims.cases import Cases
from tripod_doe.analyses.claims.evidence import ANY, Evidence, Measured, MissingPointError, Point
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import level, number

_PAPER_ANGLES = (4.0, 14.0)


def point_of(evidence: Evidence, cases: Cases, case: int, **more: Any) -> Point:
    """The first point of a case with these values."""
    return evidence.joint(**cases.wanted(case), **more)[0]


def ratio(above: Measured, below: Measured, scale: float = 1.0, note: str = "") -> Measured:
    """A quotient with its error; the errors of both numbers count as independent."""
    if not below.value > 0:
        raise MissingPointError("the value in the denominator is zero")
    error = math.hypot(above.error, above.value / below.value * below.error) / below.value
    return Measured(scale * above.value / below.value, scale * error, note)


def line_over(
    evidence: Evidence, cases: Cases, case: int, factor: str, order: int
) -> tuple[FloatArray, list[Measured]]:
    """Values of a factor with at least three levels, sorted, and an order's amplitude there."""
    points = sorted(evidence.joint(**cases.wanted(case), **{factor: ANY}), key=lambda point: float(point.value(factor)))
    if factor == "joint_angle_deg":
        points = [point for point in points if _PAPER_ANGLES[0] <= point.value(factor) <= _PAPER_ANGLES[1]]
    if len(points) < 3:
        raise MissingPointError(f"fewer than three values of {factor} were run")
    return np.array([float(p.value(factor)) for p in points]), [point.amplitude(order) for point in points]


def pairs_text(levels: FloatArray, amplitudes: list[Measured], unit: str) -> str:
    """The values and their amplitudes in a sentence."""
    pairs = (f"{number(a.value)} N at {level(value)}{unit}" for value, a in zip(levels, amplitudes, strict=True))
    return f"Values: {', '.join(pairs)}."


def spread_of(amplitudes: list[Measured], levels: FloatArray | None = None, note: str = "") -> Measured:
    """Largest deviation from the mean of amplitudes, or of amplitudes over levels, in percent."""
    below = np.ones(len(amplitudes)) if levels is None else levels
    values = np.array([a.value for a in amplitudes]) / below
    errors = np.array([a.error for a in amplitudes]) / below
    return Measured(
        100 * float(np.abs(values / values.mean() - 1).max()), 100 * float(errors.max() / values.mean()), note
    )


def fit_line(levels: FloatArray, amplitudes: list[Measured]) -> tuple[float, float, float]:
    """Slope, offset and R^2 of the straight line."""
    values = np.array([a.value for a in amplitudes])
    slope, offset = np.polyfit(levels, values, 1)
    rest = values - slope * levels - offset
    return float(slope), float(offset), 1 - float(rest @ rest / ((values - values.mean()) ** 2).sum())
