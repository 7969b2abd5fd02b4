"""One design: its request, its points, and the common interface of all kinds of designs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable

Column = NDArray[Any]
"""Values of one factor or label, shape (point,)."""

Sampler = Callable[[DesignTable, Mapping[str, FactorTable]], FloatArray]
"""Gives points on the unit cube, shape (point, factor), before factors are correlated."""


SAMPLED_BYTES = 64
"""Memory of a value of a factor while points are sampled."""

Block = Callable[[DesignTable, int], int]
"""Number of points by the design and its number of factors or groups."""


@dataclass(frozen=True)
class Request:
    """One design of a study, or one part of a product."""

    study: Study  # the study
    table: DesignTable  # its table [design], or [design.NAME] of a part
    factors: Mapping[str, Factor]  # the factors that this design varies, in file order

    @property
    def tables(self) -> dict[str, FactorTable]:
        """Entries of these factors in the study file."""
        return {name: factor.table for name, factor in self.factors.items()}


@dataclass(frozen=True)
class Made:
    """The points of one design."""

    columns: Mapping[str, Column]  # values of its factors
    labels: Mapping[str, Column] = field(default_factory=dict)  # further coordinates of its points
    notes: tuple[str, ...] = ()  # limits of the design that the user should know


def one_point(table: DesignTable, width: int) -> int:
    """The block of a design whose points stand alone."""
    return 1


@dataclass(frozen=True)
class Family:
    """One kind of design."""

    make: Callable[[Request], Made]  # makes the points of a request, always the same ones
    count: Callable[[Request], int]  # their number from counts alone; 0 if they must be made to count them
    # (table, number of factors or groups) -> points in a row that an analysis needs together: a constraint cannot
    # leave out one of them, and where one of them fails, the others are of no use
    block: Block = one_point
    uncorrelated: str = "it does not sample distributions"  # why its factors cannot be correlated; empty where they can
    grouped: bool = False  # whether factors can be varied in groups
    sample: Sampler | None = None  # of a sampled design
    value_bytes: int = 24  # memory of a value of a factor while the points are made


def column_of(factor: Factor, values: Iterable[Any]) -> Column:
    """Values of a factor as a column."""
    return factor.parameter.column(list(values))


def levels_of(factor: Factor) -> Column:
    """The levels of a factor in file order; InputError if it has none."""
    if factor.values is None:
        raise InputError(
            f"[factors.{factor.parameter.name}]: this design needs levels; give values, or low, high and count"
        )
    return column_of(factor, factor.values)


def axis_levels(factor: Factor) -> Column:
    """Levels of a factor along an axis of a grid: numbers ascend, or descend where the study lists them so.

    Ranges can be selected only on a monotonic axis.
    """
    levels = levels_of(factor)
    if levels.dtype.kind not in "iuf" or (np.diff(levels) < 0).all():
        return levels
    return np.sort(levels)


def crossed(parts: Sequence[Mapping[str, Column]]) -> dict[str, Column]:
    """Every row of the first part with every row of the next one, the rows of the last changing fastest."""
    shape = [len(next(iter(part.values()))) for part in parts]
    columns: dict[str, Column] = {}
    for axis, part in enumerate(parts):
        along = [-1 if at == axis else 1 for at in range(len(shape))]
        columns |= {name: np.broadcast_to(column.reshape(along), shape).ravel() for name, column in part.items()}
    return columns


def factor_groups(tables: Mapping[str, FactorTable]) -> dict[str, list[str]]:
    """Factors by group, in the order of first members; a factor without group forms its own group."""
    groups: dict[str, list[str]] = {}
    for name, table in tables.items():
        groups.setdefault(table.group or name, []).append(name)
    return groups
