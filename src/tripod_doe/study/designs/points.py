"""All points of a study; what they are is made when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.study.designs.columns import NO_COLUMNS, Column, Columns, HeldColumns, Rows


@dataclass(frozen=True)
class Points:
    """All points of a study."""

    factors: Columns  # values of the factors at all points
    shape: tuple[int, ...]  # lengths of the cube's dimensions: one a factor for a grid, else the number of points
    dims: tuple[str, ...]  # names of these dimensions
    # whether a point meets the constraints, shape (point,); only a grid keeps cells that do not
    allowed: NDArray[np.bool_]
    # of a grid the values of the factors along each dimension; none for a list of points
    levels: Mapping[str, Column] = field(default_factory=dict)
    # further coordinates along ``point``, for instance which row of a sub-design a point belongs to
    labels: Columns = NO_COLUMNS
    # what the user should know of the design, for instance which effects it cannot tell apart
    notes: tuple[str, ...] = ()
    # values of parameters that a pilot chose, each of shape (point,): not factors, but what a point runs with
    chosen: dict[str, Column] = field(default_factory=dict)
    # error_estimate, accuracy_met: estimated relative errors of such a choice by quantity, and whether they meet the
    # accuracy that was asked for (1, 0, or -1 where nobody knows), each of shape (point,)
    error_estimate: dict[str, Column] = field(default_factory=dict)
    accuracy_met: Column | None = None
    has_excluded: bool = False  # whether a constraint leaves out any point of the whole design

    @property
    def count(self) -> int:
        """Number of points, excluded cells of a grid included."""
        return int(self.allowed.size)

    @property
    def is_grid(self) -> bool:
        """Whether the cube has a dimension for each factor."""
        return self.dims != ("point",)

    @property
    def columns(self) -> dict[str, Column]:
        """Values of the factors at all points, each of shape (point,), all in memory."""
        return self.factors.at(slice(None))

    @property
    def setting_names(self) -> list[str]:
        """Names of everything that differs between points: factors, and what was chosen."""
        return list(dict.fromkeys([*self.factors.names, *self.chosen]))

    def at(self, rows: Rows) -> dict[str, Column]:
        """Everything that differs between points, at some of them, each of shape (rows,)."""
        return self.factors.at(rows) | {name: column[rows] for name, column in self.chosen.items()}

    def settings_of(self, row: int) -> dict[str, Any]:
        """What differs between points, of one of them, as plain numbers and words."""
        return {name: column.tolist()[0] for name, column in self.at(np.array([row % self.count])).items()}

    def part(self, start: int, stop: int) -> Points:
        """Some consecutive points, as a list of points in memory."""
        rows = slice(start, stop)
        return replace(
            self,
            factors=HeldColumns(self.factors.at(rows)),
            shape=(stop - start,),
            dims=("point",),
            allowed=self.allowed[rows],
            levels={},
            labels=HeldColumns(self.labels.at(rows)),
            chosen={name: column[rows] for name, column in self.chosen.items()},
            error_estimate={name: column[rows] for name, column in self.error_estimate.items()},
            accuracy_met=None if self.accuracy_met is None else self.accuracy_met[rows],
        )
