"""The columns of a list of points, made when they are asked for: what is not stored needs no memory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Column = NDArray[Any]
"""Values of one factor or label, shape (point,)."""

Rows = NDArray[np.integer[Any]] | slice


class Columns(Protocol):
    """Columns of equal lengths by name."""

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        ...

    @property
    def count(self) -> int:
        """Their length."""
        ...

    def at(self, rows: Rows) -> dict[str, Column]:
        """Their values in some rows, each of shape (rows,); a row has the same ones beside whatever others."""
        ...


@dataclass(frozen=True)
class HeldColumns:
    """Columns in memory."""

    columns: Mapping[str, Column]  # the columns, each of shape (count,)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self.columns)

    @property
    def count(self) -> int:
        """Their length; 0 where there are none."""
        return len(next(iter(self.columns.values()), ()))

    def at(self, rows: Rows) -> dict[str, Column]:
        """Their values in some rows."""
        return {name: column[rows] for name, column in self.columns.items()}


NO_COLUMNS = HeldColumns({})
"""None at all."""


@dataclass(frozen=True)
class CrossedColumns:
    """Every row of the first part with every row of the next one, of which the last changes fastest."""

    parts: Sequence[Columns]  # the parts; no name stands in two of them
    names: tuple[str, ...]  # names of all their columns, in the order in which they are given

    @property
    def count(self) -> int:
        """Product of the lengths of the parts."""
        return math.prod(part.count for part in self.parts)

    def at(self, rows: Rows) -> dict[str, Column]:
        """Their values in some rows."""
        places = np.unravel_index(row_numbers(rows, self.count), [part.count for part in self.parts])
        found: dict[str, Column] = {}
        for part, place in zip(self.parts, places, strict=True):
            found |= part.at(place)
        return {name: found[name] for name in self.names}


@dataclass(frozen=True)
class ChosenColumns:
    """Some rows of columns."""

    whole: Columns  # the columns
    rows: NDArray[np.integer[Any]]  # the rows, which count from 0 here

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return self.whole.names

    @property
    def count(self) -> int:
        """Number of the rows."""
        return self.rows.size

    def at(self, rows: Rows) -> dict[str, Column]:
        """Their values in some rows."""
        return self.whole.at(self.rows[rows])


def row_numbers(rows: Rows, count: int) -> NDArray[np.integer[Any]]:
    """Rows of so many, as numbers."""
    return np.arange(*rows.indices(count)) if isinstance(rows, slice) else rows
