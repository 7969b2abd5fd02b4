"""What one design is asked for, what it answers, and the one interface of all kinds of designs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tripod_doe.errors import InputError
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import DesignTable, FactorTable
from tripod_doe.study.designs.columns import NO_COLUMNS, Column, Columns, HeldColumns


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

    columns: Columns  # values of its factors
    labels: Columns = NO_COLUMNS  # further coordinates of its points
    notes: tuple[str, ...] = ()  # what the user should know of it


def held(
    columns: Mapping[str, Column], labels: Mapping[str, Column] | None = None, notes: tuple[str, ...] = ()
) -> Made:
    """The points of a design whose columns are in memory."""
    return Made(HeldColumns(columns), HeldColumns(labels or {}), notes)


def _alone(table: DesignTable, width: int) -> int:
    return 1


_LISTED_BYTES = 24


def _listed(table: DesignTable) -> int:
    return _LISTED_BYTES


@dataclass(frozen=True)
class Family:
    """One kind of design."""

    make: Callable[[Request], Made]  # makes the points of a request, always the same ones
    count: Callable[[Request], int]  # how many these are, from counts alone; 0 where only making them tells
    # (table, number of factors or groups) -> how many points in a row an analysis needs together. A constraint cannot
    # leave out one of them, and where one of them failed, the others are of no use.
    block: Callable[[DesignTable, int], int] = _alone
    uncorrelated: str = "it does not sample distributions"  # why its factors cannot be correlated; empty where they can
    grouped: bool = False  # whether factors can be varied in groups
    # bytes of memory that a value of a factor takes while the points are made; 0 where they are made when they are
    # asked for
    value_bytes: Callable[[DesignTable], int] = _listed


def levels_of(factor: Factor) -> Column:
    """The levels of a factor in file order.

    Raises
    ------
    InputError
        If it has none.
    """
    if factor.values is None:
        raise InputError(
            f"[factors.{factor.parameter.name}]: this design needs levels; give values, or low, high and count"
        )
    return column_of(factor, factor.values)


def column_of(factor: Factor, values: Iterable[Any]) -> Column:
    """Values of a factor as a column."""
    return factor.parameter.column(list(values))


def axis_levels(factor: Factor) -> Column:
    """Levels of a factor along an axis of a grid: numbers ascend, or descend where the study lists them so.

    An axis in the order in which levels were added could not be asked for a range.
    """
    levels = levels_of(factor)
    if levels.dtype.kind not in "iuf" or (np.diff(levels) < 0).all():
        return levels
    return np.sort(levels)


def factor_groups(tables: Mapping[str, FactorTable]) -> dict[str, list[str]]:
    """Factors by the group that they vary in, in the order of their first members; one alone is its own group."""
    groups: dict[str, list[str]] = {}
    for name, table in tables.items():
        groups.setdefault(table.group or name, []).append(name)
    return groups
