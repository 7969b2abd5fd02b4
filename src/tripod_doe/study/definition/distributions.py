"""From the unit interval to a factor's values: the quantile function of its distribution."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study_file_schema import FactorTable

_INSIDE = 1e-12  # keeps the ends of the unit interval off the infinite tails


def is_unbounded(factor: Factor) -> bool:
    """Whether the factor's distribution has infinite tails."""
    return factor.table.distribution == "normal"


def has_levels(factor: Factor) -> bool:
    """Whether the factor takes only some values: whole numbers, or the values of a list."""
    return factor.table.distribution == "discrete" or factor.parameter.kind in ("integer", "switch")


def quantile(factor: Factor, unit: FloatArray) -> NDArray[Any]:
    """Values of a sampled factor at given points of the unit interval.

    Args:
        factor: A factor with a range or a distribution. Whole-number parameters and switches take every whole number of
            a uniform range with equal probability.
        unit: Numbers in [0, 1], shape (point,).

    Returns:
        ndarray, shape (point,)

    Raises:
        InputError: If the factor has explicit values without distribution = "discrete", or if a tail reaches values
            that the parameter does not allow.
    """
    parameter, table = factor.parameter, factor.table
    if factor.values is not None or (table.low is None and table.mean is None and table.values is None):
        raise InputError(
            f"[factors.{parameter.name}]: this design samples; give low and high or a distribution "
            '(distribution = "discrete" for a list of values)'
        )
    if table.distribution == "discrete":
        values: NDArray[Any] = parameter.column([parameter.check(value) for value in table.values or []])
        weights = np.array(table.weights or [1.0] * len(values))
        chosen = np.searchsorted(np.cumsum(weights) / weights.sum(), unit, side="right")
        return values[np.minimum(chosen, len(values) - 1)]
    if has_levels(factor):
        low, high = math.ceil(table.low or 0), math.floor(table.high or 0)
        return np.minimum(np.floor(low + unit * (high - low + 1)), high)
    if is_unbounded(factor):
        sampled = np.asarray(_frozen(table).ppf(np.clip(unit, _INSIDE, 1 - _INSIDE)), float)
    elif table.sampled_as == "uniform":
        low_end, high_end = table.low or 0.0, table.high or 0.0
        sampled = np.clip(low_end + unit * (high_end - low_end), low_end, high_end)
        if low_end < 0 < high_end:  # a level of -2e-16 is 0
            sampled[np.abs(sampled) <= 2**-50 * max(-low_end, high_end)] = 0.0
    else:
        sampled = np.clip(_frozen(table).ppf(unit), table.low, table.high)  # exact ends in spite of rounding
    for extreme in (sampled.min(), sampled.max()):
        try:
            parameter.check(float(extreme))
        except InputError as error:
            raise InputError(f"[factors.{parameter.name}]: {error}; use a truncated-normal distribution") from error
    return sampled


def _frozen(table: FactorTable) -> Any:
    """The scipy distribution of a continuous factor."""
    from scipy import stats  # slow to import, and most studies sample nothing

    low, high, mean, std = table.low or 0.0, table.high or 0.0, table.mean or 0.0, table.std or 1.0
    match table.sampled_as:
        case "normal":
            return stats.norm(mean, std)
        case "truncated-normal":
            return stats.truncnorm((low - mean) / std, (high - mean) / std, mean, std)
        case "log-uniform":
            return stats.loguniform(low, high)
        case "triangular":
            return stats.triang(((table.mode or 0.0) - low) / (high - low), low, high - low)
        case _:
            return stats.uniform(low, high - low)


@dataclass(frozen=True)
class Scatter:
    """The scatter of a factor."""

    density: Callable[[FloatArray], FloatArray]  # its density over its values, or over their logarithms
    centre: float  # centre of the scatter: mean or the end of the range next to it, middle of a range, or peak
    logarithmic: bool  # whether density and centre belong to logarithms


def scatter_density(table: FactorTable) -> Scatter | None:
    """The scatter of a factor from its distribution; None for listed values, which have no density."""
    from scipy import stats

    kind, low, high = table.sampled_as, table.low or 0.0, table.high or 0.0
    if kind == "discrete" or table.values is not None:
        return None
    if kind == "log-uniform":
        low, high = math.log(low), math.log(high)
        return Scatter(stats.uniform(low, high - low).pdf, (low + high) / 2, True)
    centre = {"triangular": table.mode, "normal": table.mean}.get(kind)
    if kind == "truncated-normal":  # the end next to a mean outside of the range: a narrower scatter stays in the range
        centre = min(max(table.mean or 0.0, low), high)
    return Scatter(_frozen(table).pdf, (low + high) / 2 if centre is None else centre, False)


def scaled_table(table: FactorTable, scale: float) -> FactorTable:
    """The factor with its scatter about the centre multiplied; not for listed values."""
    return _moved(table, scale, 0.0)


def shifted_table(table: FactorTable, shift: float) -> FactorTable:
    """The factor with a new centre in its unit and the same scatter (on a logarithmic scale as a ratio)."""
    return _moved(table, 1.0, shift)


def _moved(table: FactorTable, scale: float, shift: float) -> FactorTable:
    scatter = scatter_density(table)
    if scatter is None:
        raise ValueError("listed values have no mean value to shift")
    centre = math.exp(scatter.centre) if scatter.logarithmic else scatter.centre

    def placed(value: float) -> float:
        if scatter.logarithmic:
            return (centre + shift) * (value / centre) ** scale
        return centre + shift + (value - centre) * scale

    given = {key: getattr(table, key) for key in ("low", "high", "mean", "mode")}
    moved = {key: placed(value) for key, value in given.items() if value is not None}
    return table.model_copy(update=moved | ({} if table.std is None else {"std": table.std * scale}))
