"""How pages tell a cube: sentences on what was found, and the table of an analysis that has one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import xarray as xr

from tripod_doe.report.claims import claim_table, find_in_claims, is_claims
from tripod_doe.report.claims_over_skew import find_over_skew, is_over_skew, over_skew_table
from tripod_doe.report.comparison import find_in_comparison
from tripod_doe.report.findings import find, find_in_analyses
from tripod_doe.report.speed_accuracy import find_in_speed_accuracy, is_speed_accuracy, price_table
from tripod_doe.report.stability import find_in_stability, is_stability, stability_table

__all__ = ["Table", "findings_of", "is_study", "table_of"]

Table = tuple[list[str], list[list[str]]]
"""Heads and rows."""


@dataclass(frozen=True)
class _Telling:
    """How one kind of analysis is known, what is said of it, and its table."""

    knows: Callable[[xr.Dataset], bool]
    find: Callable[[xr.Dataset], list[str]]
    table: Callable[[xr.Dataset], Table]


_TELLINGS = (
    _Telling(is_claims, find_in_claims, claim_table),
    _Telling(is_over_skew, find_over_skew, over_skew_table),
    _Telling(is_speed_accuracy, find_in_speed_accuracy, price_table),
    _Telling(is_stability, find_in_stability, stability_table),
)


def _telling_of(data: xr.Dataset) -> _Telling | None:
    return next((telling for telling in _TELLINGS if telling.knows(data)), None)


def is_study(data: xr.Dataset) -> bool:
    """Whether a cube holds the points of a study, and not what an analysis made of them."""
    return "outcome" in data and _telling_of(data) is None


def findings_of(name: str, data: xr.Dataset) -> list[str]:
    """Sentences on what a study or an analysis found; empty where the house has none for it."""
    if telling := _telling_of(data):
        return telling.find(data)
    if is_study(data):
        return find(data)
    return find_in_comparison(data) if "amplitude_difference" in data else find_in_analyses({name: data})


def table_of(data: xr.Dataset) -> Table | None:
    """The table of an analysis, None where it has none."""
    telling = _telling_of(data)
    return telling.table(data) if telling else None
