"""Known errors of the models, and the ranges in which the models hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.quantities import allowed_range

NOTABLE_ERROR = 0.05
"""Relative error of a model above which an answer is flagged."""


@dataclass(frozen=True)
class ModelErrors:
    """Relative errors of the models at some points; numerical errors are not part of them."""

    quantity: str  # the quantity with the errors, for instance ``third order``
    reference: str  # the model that the others are compared with
    models: NDArray[np.object_]  # the model of every point, shape (point,)
    # median error at points like each that finer models computed, shape (point,); NaN where it is not known
    expected: FloatArray
    limit: FloatArray  # 90th percentile of the error at those points, shape (point,)
    unknown: NDArray[np.object_]  # why the error is not known, shape (point,); empty where it is
    departures: Sequence[Departure] = ()  # the ranges in which these models hold, each with the points that leave it

    def of(self, rows: NDArray[np.bool_]) -> ModelErrors:
        """The errors at some of the points."""
        departures = [
            replace(each, outside=each.outside[rows], values=each.values[rows[each.outside]])
            for each in self.departures
        ]
        return replace(
            self,
            models=self.models[rows],
            expected=self.expected[rows],
            limit=self.limit[rows],
            unknown=self.unknown[rows],
            departures=departures,
        )


@dataclass(frozen=True)
class ValidRange:
    """A range outside which a model does not hold."""

    quantity: str  # a parameter, or a ratio that follows from several
    reason: str  # the neglected effect that matters beyond it
    # low, high: ends of the range; they belong to it
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""  # of the quantity, for people; empty without dimension
    meaning: str = ""  # definition of the quantity, where its name does not say it

    @property
    def text(self) -> str:
        """The range in words: ``swing_ratio (its definition) up to 0.2``."""
        name = f"{self.quantity} ({self.meaning})" if self.meaning else self.quantity
        return f"{name} {allowed_range(self.low, self.high, self.unit)}"


@dataclass(frozen=True)
class Departure:
    """Points that leave a range of their model."""

    model: str  # name of the model
    left: ValidRange  # the range
    outside: NDArray[np.bool_]  # which points leave it, shape (point,)
    values: FloatArray  # its quantity at these points, shape (points outside,)
