"""Errors of the model at the points of records, as standard deviations of complex amplitudes.

The error on record is a median, which of a normal error is 0.67 of its deviation. It counts as an error that all
records of a joint share, since models differ by what they leave out, and twice its square in each record alone: at 64
points of eight joints, `kinetostatic` differs from `needles` by 0.9 times the former in the mean of a joint and by 1.3
times between its points in the third order, by 1.1 and 1.9 times in the second (benchmarks/fit.py). A given error
counts with half of its square in each record.
Beside them stand the numerical error that a run reports, and the difference between its last two revolutions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import Accuracy, Quantity, Simulator

_DEVIATION = 1.48  # of a normal error over its median
_ASSUMED = 0.03  # relative, where nothing is on record
_OTHER = 0.13  # relative error of any order but the third where it is not on record: those points, too
_FINEST = {3: 0.003, 2: 0.05}  # between two implementations of the finest model
_FINEST_OTHER = 0.05


@dataclass(frozen=True)
class ModelError:
    """Errors of the model at the points of the records, N."""

    own: FloatArray  # deviation in one record alone, shape (record, order)
    shared: FloatArray  # deviation that all records share, shape (record, order)
    source: str  # in words, where it comes from


def model_error(
    simulator: Simulator,
    columns: Mapping[str, NDArray[Any]],
    orders: Sequence[int],
    amplitude: FloatArray,
    reported: FloatArray,
    setting: Literal["recorded"] | float,
) -> ModelError:
    """Errors at the points of the records.

    Args:
        orders, amplitude: The fitted orders, and their amplitudes, shape (record, order).
        reported: Numerical error and scatter that the runs report, N, shape (record, order).
        setting: The relative error, or "recorded".
    """
    if setting != "recorded":
        whole = float(setting) * amplitude
        words = f"{100 * float(setting):g} % of each order, as given" if setting else "none, as given"
        return ModelError(np.hypot(whole / np.sqrt(2), reported), whole, words)
    relative, known = np.empty(amplitude.shape), np.ones(len(amplitude), bool)
    third = _third(simulator, columns)
    finest = np.array([str(model) == simulator.model_names[-1] for model in columns["model"]])
    for column, order in enumerate(orders):
        if order == 3:
            known = np.isfinite(third) | finest
            usual = np.where(np.isfinite(third), _DEVIATION * third, _ASSUMED)
        else:
            usual = np.full(len(amplitude), _OTHER)
        relative[:, column] = np.where(finest, _FINEST.get(order, _FINEST_OTHER), usual)
    whole = relative * amplitude
    if 2 in orders and 3 in orders:
        at, by = list(orders).index(2), list(orders).index(3)
        missed = _second(simulator, columns) * amplitude[:, by]
        recorded = np.isfinite(missed) & ~finest
        whole[recorded, at] = np.minimum(whole[recorded, at], _DEVIATION * missed[recorded])
    words = "recorded for similar points"
    if not known.all():
        words += f"; at {int((~known).sum())} of {known.size} records none is, and {100 * _ASSUMED:g} % is assumed"
    return ModelError(np.hypot(np.sqrt(2) * whole, reported), whole, words)


def _third(simulator: Simulator, columns: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Typical relative error of the third order; NaN where it is not known."""
    errors = simulator.model_errors(columns)
    return np.full(len(columns["model"]), np.nan) if errors is None else errors.expected


def _second(simulator: Simulator, columns: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Typical error of the second order over the third; NaN where it is not known."""
    asked = Accuracy((Quantity("thrust_amplitude_2", "thrust_amplitude", 2, 1.0),), floor=1.0)
    errors = np.full(len(columns["model"]), np.nan)
    for model in dict.fromkeys(columns["model"].tolist()):
        rows = np.flatnonzero(columns["model"] == model)
        similar = simulator.recorded_errors({name: column[rows] for name, column in columns.items()}, asked)
        if similar is not None:
            errors[rows] = np.median(similar[..., 0], axis=1)
    return errors
