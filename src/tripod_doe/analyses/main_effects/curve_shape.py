"""The course of a response over the levels of one factor: one direction, an optimum inside, none, or none of these."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray

_MIRRORED = 0.01  # part of the change of a curve by which its two sides may differ where it counts as symmetric


class Shape(IntEnum):
    """Course of a curve. Changes within the error of the response are none."""

    NONE = 0
    """No two values differ."""
    RISING = 1
    """It rises somewhere, and falls nowhere."""
    FALLING = 2
    """It falls somewhere, and rises nowhere."""
    VALLEY = 3
    """It falls, then rises: the smallest value is inside, both ends are above it."""
    PEAK = 4
    """It rises, then falls: the largest value is inside, both ends are below it."""
    MIXED = 5
    """It rises and falls, with more than one turn, or with an end that is no higher or lower than the turn."""


def curve_shapes(curves: FloatArray, error: float) -> IntArray:
    """Shape of each curve.

    Args:
        curves: Values over ascending levels, shape (curve, level).
        error: Difference up to which two values count as equal.

    Returns:
        A `Shape` per curve.
    """
    rises, falls = _largest_rise(curves) > error, _largest_rise(-curves) > error
    shapes = np.full(len(curves), Shape.NONE, np.int64)
    shapes[rises & falls] = Shape.MIXED
    shapes[rises & falls & _falls_then_rises(-curves, error)] = Shape.PEAK
    shapes[rises & falls & _falls_then_rises(curves, error)] = Shape.VALLEY
    shapes[rises & ~falls] = Shape.RISING
    shapes[falls & ~rises] = Shape.FALLING
    return shapes


def _largest_rise(curves: FloatArray) -> FloatArray:
    """Largest rise from any value to a later one, shape (curve,)."""
    return (curves - np.minimum.accumulate(curves, axis=1)).max(axis=1)


def _falls_then_rises(curves: FloatArray, error: float) -> NDArray[np.bool_]:
    """Whether a curve nowhere rises before its smallest value and nowhere falls after it, and both ends lie above."""
    lowest = curves.argmin(axis=1)[:, None]
    bottom = np.take_along_axis(curves, lowest, axis=1)
    at = np.arange(curves.shape[1])
    before, after = np.where(at <= lowest, curves, bottom), np.where(at >= lowest, curves, bottom)
    one_way = (_largest_rise(before) <= error) & (_largest_rise(-after) <= error)
    higher = (curves[:, [0, -1]] - bottom > error).all(axis=1)
    return one_way & higher


def extreme_levels(level: FloatArray, curve: FloatArray, shape: Shape, error: float) -> FloatArray:
    """The levels of the optimum of a valley or a peak: those whose values do not differ from the extreme one."""
    extreme = curve.max() if shape is Shape.PEAK else curve.min()
    return level[np.abs(curve - extreme) <= error]


def mirror_level(level: FloatArray, curve: FloatArray, error: float) -> float | None:
    """The level about which a curve is symmetric; None if the curve or its levels are not symmetric.

    The two sides may differ by the error or by one percent of the change of the curve.
    """
    middle = (level[0] + level[-1]) / 2
    spacing = np.abs(level + level[::-1] - 2 * middle)
    if (spacing > 1e-9 * np.ptp(level)).any():
        return None
    apart = float(np.abs(curve - curve[::-1]).max())
    return float(middle) if apart <= max(error, _MIRRORED * float(np.ptp(curve))) else None
