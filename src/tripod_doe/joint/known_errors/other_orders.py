"""Errors of the orders of the thrust but the third, and of all phases, of the balances against `needles`.

From runs of `needles` at 145 random joints in drive and 26 in coast (2 to 15 deg, 20 to 300 N m;
benchmarks/RESULTS.md). An amplitude errs by a part of itself and a part of the third order: small orders are
differences of large forces. Phases err by more than amplitudes: a roller that swings in its groove turns them, which
`equilibrium` leaves out. The widths are those with which 19 of 20 intervals of 95 % hold.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import Simulator

_PARTS = "thrust_part_amplitude"

SOURCE = "runs of needles at 145 random joints in drive and 26 in coast"
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


# what deviations of amplitudes are multiplied by in coast, and those of phases: by model and order
_IN_COAST: dict[str, tuple[dict[int, float], dict[int, float]]] = {
    "kinetostatic": (
        {4: 1.5, 5: 4, 6: 1.3, 7: 2, 8: 2.4, 9: 3, 10: 2.5, 11: 2},
        {2: 1.5, 3: 1.5, 4: 3, 8: 1.5, 9: 1.3, 10: 3},
    ),
    "equilibrium": ({1: 3.2, 4: 1.5, 5: 4, 6: 3, 7: 8, 8: 1.7, 9: 2.4, 10: 1.3, 11: 6, 12: 2}, {}),
}


def deviations_of_orders(
    simulator: Simulator, columns: Mapping[str, NDArray[Any]], amplitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Standard deviations of the amplitudes (N) and phases (deg) at some points.

    Args:
        simulator, columns: The joint, and every parameter of the points, each of shape (point,).
        amplitude: Of the orders 0 to 12, N, shape (point, order).

    Returns:
        shape (point, order) each: amplitudes, NaN for orders 0 and 3, which have other records; phases, NaN where
        unknown, as are those of amplitudes within their own 95 %. NaN of models without a record.
    """
    own, third, phase = np.full((3, *amplitude.shape), np.nan)
    for model, recorded in _RECORDED.items():
        rows = np.flatnonzero(columns["model"] == model)
        coast = rows[columns["torque_n_m"][rows] < 0]
        for order, parts in recorded.items():
            own[rows, order], third[rows, order], phase[rows, order] = parts
        amplitudes, phases = _IN_COAST[model]
        for order, factor in amplitudes.items():
            own[coast, order] *= factor
            third[coast, order] *= factor
        for order, factor in phases.items():
            phase[coast, order] *= factor
    forces = _opposed_forces(simulator, columns, amplitude[:, 3])
    sizes = np.hypot(own * amplitude, third * forces[:, None])
    phase[:, 3] *= np.divide(forces, amplitude[:, 3], out=np.ones(len(forces)), where=amplitude[:, 3] > 0)
    phase[amplitude <= 2 * sizes] = np.nan
    sizes[:, 3] = np.nan
    return sizes, phase


def _opposed_forces(simulator: Simulator, columns: Mapping[str, NDArray[Any]], third: FloatArray) -> FloatArray:
    """Size of the forces of which orders are differences, N, shape (point,): in drive the third order `third`.

    In coast needle friction opposes groove friction. The third order may nearly vanish, and errors do not: there it is
    the sum of what the friction mechanisms contribute.
    """
    forces = third.copy()
    coast = np.flatnonzero((columns["torque_n_m"] < 0) & np.isin(columns["model"], list(_RECORDED)))
    if coast.size:
        outputs = simulator.simulate({name: each[coast] for name, each in columns.items()}, [_PARTS]).outputs
        parts = outputs[_PARTS].data[:, :, 3].sum(axis=1)
        forces[coast] = np.fmax(third[coast], parts)  # of a point that does not finish the third order
    return forces
