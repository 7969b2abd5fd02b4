"""Known errors of the models, and the ranges in which the models hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import allowed_range

NOTABLE_ERROR = 0.05
"""Relative error of a model above which a result is flagged."""


@dataclass(frozen=True)
class ModelErrors:
    """Relative errors of the models at some points; numerical errors are not part of them."""

    quantity: str  # the quantity with the errors, for instance ``third order``
    reference: str  # the reference model
    models: NDArray[np.object_]  # the model of every point, shape (point,)
    # median error at similar points that finer models computed, shape (point,); NaN if unknown
    expected: FloatArray
    limit: FloatArray  # 90th percentile of the error at these similar points, shape (point,)
    unknown: NDArray[np.object_]  # why the error is unknown, shape (point,); empty if it is known
    departures: Sequence[Departure] = ()  # valid ranges of these models, each with the points outside
    stated: Sequence[str] = ()  # texts of `unknown` that a verdict states as they are
    # unsettled, why_unsettled: points that are not sure although similar points err little, shape (point,), None
    # for no point; and the reason
    unsettled: NDArray[np.bool_] | None = None
    why_unsettled: str = ""

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
            unsettled=None if self.unsettled is None else self.unsettled[rows],
        )


@dataclass(frozen=True)
class ValidRange:
    """A range outside which a model is not valid."""

    quantity: str  # a parameter, or a ratio that follows from several
    reason: str  # the neglected effect that matters outside
    # low, high: ends of the range, included
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""  # of the quantity, for people; empty without dimension
    meaning: str = ""  # definition of the quantity, if its name is not enough
    remedy: str = ""  # what to change if no other model helps: ``raise spheres_per_needle``

    def left_by(self, values: str) -> str:
        """Values outside in words: ``swing_ratio (its definition) = 0.3 to 0.4, valid up to 0.2``."""
        name = f"{self.quantity} ({self.meaning})" if self.meaning else self.quantity
        return f"{name} = {values}, valid {self.ends}"

    @property
    def ends(self) -> str:
        """The range in words: ``up to 0.2``."""
        return allowed_range(self.low, self.high, self.unit)


@dataclass(frozen=True)
class Departure:
    """Points that leave a range of their model."""

    model: str  # name of the model
    left: ValidRange  # the range
    outside: NDArray[np.bool_]  # which points leave it, shape (point,)
    values: FloatArray  # its quantity at these points, shape (points outside,)

    @property
    def reason(self) -> str:
        """Why a point outside is doubtful."""
        return f"model {self.model} is valid only for {self.left.quantity} {self.left.ends}"

    @property
    def excess(self) -> FloatArray:
        """Value over the upper end of the range at the points outside; 1 where that end is 0, or below the range."""
        return np.fmax(self.values / self.left.high, 1.0) if self.left.high > 0 else np.ones(self.values.shape)
