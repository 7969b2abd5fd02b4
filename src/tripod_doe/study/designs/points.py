"""All points of a study, as columns of its factors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Column", "Points"]

Column = NDArray[Any]
"""Values of one factor or label, shape (point,)."""


@dataclass(frozen=True)
class Points:
    """All points of a study.

    Attributes
    ----------
    columns
        Values of the factors, each of shape (point,).
    shape
        Lengths of the cube's dimensions: one a factor for a grid, else the number of points.
    dims
        Names of these dimensions.
    allowed
        Whether a point meets the constraints, shape (point,); only a grid keeps cells that do not.
    labels
        Further coordinates along ``point``, for instance which row of a sub-design a point belongs to.
    notes
        What the user should know of the design, for instance which effects it cannot tell apart.
    chosen
        Values of parameters that a pilot chose, each of shape (point,): not factors, but what a point runs with.
    error_estimate, accuracy_met
        Estimated relative errors of such a choice by quantity, and whether they meet the accuracy that was asked for
        (1, 0, or -1 where nobody knows), each of shape (point,).
    """

    columns: dict[str, Column]
    shape: tuple[int, ...]
    dims: tuple[str, ...]
    allowed: NDArray[np.bool_]
    labels: dict[str, Column] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    chosen: dict[str, Column] = field(default_factory=dict)
    error_estimate: dict[str, Column] = field(default_factory=dict)
    accuracy_met: Column | None = None

    @property
    def settings(self) -> dict[str, Column]:
        """Everything that differs between points: factors, and what was chosen."""
        return self.columns | self.chosen

    @property
    def count(self) -> int:
        """Number of points, excluded cells of a grid included."""
        return int(self.allowed.size)
