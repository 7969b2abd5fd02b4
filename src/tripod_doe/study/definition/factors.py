"""Factors of a study: each table [factors.PARAMETER] checked against its parameter."""

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.errors import InputError
from tripod_doe.model_interface import Parameter, Value
from tripod_doe.study.definition.study_file_schema import FactorTable, Scalar


@dataclass(frozen=True)
class Factor:
    """A factor: its parameter, and either its values or a distribution to sample."""

    parameter: Parameter  # the parameter that varies
    values: tuple[Value, ...] | None  # checked values in file order; None where it is sampled
    table: FactorTable  # its entry in the study file


def checked_factor(parameter: Parameter, table: FactorTable) -> Factor:
    """Check one factor: each of its levels, or the ends of its distribution."""
    if table.values is not None and table.distribution != "discrete":
        if any(value is not None for value in (table.low, table.high, table.count)):
            raise InputError("give either values, or low and high, not both")
        return Factor(parameter, _checked_values(parameter, table.values), table)
    if table.count is not None:
        low, high = _ends(parameter, table)
        if table.scale == "log" and low <= 0:
            raise InputError(f"low = {low:g}: must be above 0 on a logarithmic scale")
        spaced = np.geomspace(low, high, table.count) if table.scale == "log" else np.linspace(low, high, table.count)
        return Factor(parameter, _checked_values(parameter, [float(value) for value in spaced]), table)
    _check_distribution(parameter, table)
    return Factor(parameter, None, table)


_OF_SAMPLES = {"distribution", "mean", "std", "mode", "weights"}


def refuse_unread(table: FactorTable) -> None:
    """Refuse a distribution together with levels, which no design would sample."""
    listed = "count" if table.count else "values" if table.values and table.distribution != "discrete" else ""
    if listed and (unread := sorted(table.model_fields_set & _OF_SAMPLES)):
        raise InputError(f"{listed} and {', '.join(unread)}: give either levels or a distribution, not both")


def _checked_values(parameter: Parameter, values: list[Scalar]) -> tuple[Value, ...]:
    if not values:
        raise InputError("values is empty; give at least one")
    if parameter.kind == "argument" and len({isinstance(value, str) for value in values}) > 1:
        raise InputError("values are numbers and texts; write all as numbers, or all as texts")
    return tuple(parameter.check(value) for value in values)


def _ends(parameter: Parameter, table: FactorTable) -> tuple[float, float]:
    if table.low is None or table.high is None:
        raise InputError("give values, or low and high (with count for a grid), or a distribution")
    if parameter.kind == "choice":
        raise InputError(f"{parameter.name} is a choice; give values ({parameter.range_text})")
    for value in (table.low, table.high):
        parameter.check(value)
    if not table.low < table.high:
        raise InputError(f"low = {table.low:g} must be below high = {table.high:g}")
    return table.low, table.high


_NARROWEST, _FARTHEST = 1e-5, 1e3  # standard deviations, beyond which the quantiles of SciPy lose their digits
_NEEDED: dict[str, tuple[str, ...]] = {
    "uniform": ("low", "high"),
    "log-uniform": ("low", "high"),
    "triangular": ("low", "high", "mode"),
    "normal": ("mean", "std"),
    "truncated-normal": ("mean", "std", "low", "high"),
    "discrete": ("values",),
}


def _check_distribution(parameter: Parameter, table: FactorTable) -> None:
    kind = table.sampled_as
    missing = [name for name in _NEEDED[kind] if getattr(table, name) is None]
    if missing and table.distribution is None and not table.model_fields_set:
        return  # a table design takes its values from a file
    if missing:
        raise InputError(f"a {kind} distribution needs {', '.join(missing)}")
    given = table.model_fields_set - {"distribution", "scale", "group"} - set(_NEEDED[kind])
    if table.scale == "log" and kind != "log-uniform":
        given |= {"scale"}
    if given - ({"weights"} if kind == "discrete" else set()):
        raise InputError(f"a {kind} distribution does not use {', '.join(sorted(given))}")
    if parameter.kind in ("integer", "switch") and kind not in ("uniform", "discrete"):
        raise InputError(f"{parameter.name} takes whole numbers; give low and high, or a discrete distribution")
    if kind == "discrete":
        values = _checked_values(parameter, table.values or [])
        weights = table.weights or [1.0] * len(values)
        if len(weights) != len(values) or not all(w >= 0 for w in weights) or not 0 < sum(weights) < math.inf:
            raise InputError("weights must be one number >= 0 for each of the values, and not all 0")
    elif kind != "normal":
        low, high = _ends(parameter, table)
        if kind == "log-uniform" and low <= 0:
            raise InputError(f"low = {low:g}: must be above 0 for a log-uniform distribution")
        if kind == "truncated-normal":
            _refuse_far_range(table.mean or 0.0, table.std or 0.0, low, high)
        if kind == "triangular" and not low <= (table.mode or 0) <= high:
            raise InputError(f"mode = {table.mode} must lie between low and high")


def _refuse_far_range(mean: float, std: float, low: float, high: float) -> None:
    if high - low < _NARROWEST * std:
        raise InputError(f"std = {std:g}: between low and high this distribution is uniform; give low and high alone")
    if max(low - mean, mean - high) > _FARTHEST * std:
        raise InputError(f"mean = {mean:g}: lies more than {_FARTHEST:g} standard deviations outside of low and high")
