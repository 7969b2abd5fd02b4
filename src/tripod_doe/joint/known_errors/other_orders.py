"""Errors of the orders of the thrust but the third, and of all phases, of the balances against `needles`.

From 145 runs of `needles` at random joints (2 to 15 deg, 20 to 300 N m; benchmarks/RESULTS.md). An amplitude
errs by a part of itself and a part of the third order: small orders are differences of large forces. Phases err by more
than amplitudes: a roller that swings in its groove turns them, which `equilibrium` leaves out. The widths are those
with which 19 of 20 intervals of 95 % hold.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.orders import ORDERS

SOURCE = "145 runs of needles at random joints"
"""Where these errors come from, in words."""

_UNKNOWN = math.nan
# by model and order: deviation of the amplitude, over itself and over the third order, and of the phase in deg
_RECORDED: dict[str, dict[int, tuple[float, float, float]]] = {
    "kinetostatic": {
        1: (0.7, 0.0005, _UNKNOWN),
        2: (0.2, 0.002, 10.0),
        3: (0.0, 0.0, 0.75),
        4: (0.13, 0.001, 18.0),
        5: (0.16, 0.001, _UNKNOWN),
        6: (0.0, 0.004, 35.0),
        7: (0.7, 0.0005, _UNKNOWN),
        8: (0.0, 0.001, 30.0),
        9: (0.05, 0.002, 10.0),
        10: (0.08, 0.001, 17.0),
        11: (0.5, 0.0005, _UNKNOWN),
        12: (0.0, 0.003, _UNKNOWN),
    },
    "equilibrium": {
        1: (0.0, 0.004, _UNKNOWN),
        2: (1.0, 0.03, _UNKNOWN),
        3: (0.0, 0.0, 33.0),
        4: (1.0, 0.007, _UNKNOWN),
        5: (0.0, 0.003, _UNKNOWN),
        6: (0.0, 0.005, _UNKNOWN),
        7: (0.0, 0.0015, _UNKNOWN),
        8: (0.0, 0.003, _UNKNOWN),
        9: (0.4, 0.0, _UNKNOWN),
        10: (0.0, 0.004, _UNKNOWN),
        11: (0.0, 0.0015, _UNKNOWN),
        12: (0.0, 0.003, _UNKNOWN),
    },
}


def deviations_of_orders(model: str, amplitude: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Standard deviations of the amplitudes (N) and phases (deg) of a model; None of models without a record.

    Args:
        amplitude: Of the orders 0 to 12, N, shape (order,).

    Returns:
        shape (order,) each: amplitudes, NaN for orders 0 and 3, which have other records; phases, NaN where unknown,
        as are those of amplitudes within their own 95 %.
    """
    if model not in _RECORDED:
        return None
    own, third, phase = np.full((3, ORDERS.size), np.nan)
    for order, parts in _RECORDED[model].items():
        own[order], third[order], phase[order] = parts
    sizes = np.hypot(own * amplitude, third * amplitude[3])
    phase[amplitude <= 2 * sizes] = np.nan
    sizes[3] = np.nan
    return sizes, phase
