"""What a study found, in sentences with numbers taken from its cube."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.report.responses import Response, finished, numeric_factors, responses, spoken, unit_text
from tripod_doe.results import Outcome

__all__ = ["find", "find_in_analyses"]

_FLAT = 1e-6  # relative change below which a response does not depend on a factor
_STRAIGHT = 0.98  # R^2 above which a line is a fair summary


def find(cube: xr.Dataset) -> list[str]:
    """Sentences on what the cube shows: completeness, the dominant order, and the effect of every factor.

    Parameters
    ----------
    cube
        A result cube.

    Returns
    -------
    list of str
        The most important first.
    """
    sentences = []
    good = int(finished(cube).sum())
    total = int((cube["outcome_detail"] != "excluded by a constraint").sum())
    if good == 0:
        return [f"None of {total:,} points finished; {_reasons(cube)}."]
    if "thrust_amplitude" in cube:
        sentences.append(_dominant_order(cube))
    for response in responses(cube):
        sentences.extend(_effects(response, cube))
    if good < total:
        sentences.append(f"{total - good:,} of {total:,} points did not finish: {_reasons(cube)}.")
    return sentences


def _reasons(cube: xr.Dataset) -> str:
    outcome = cube["outcome"].values.ravel()
    counts = {kind: int((outcome == kind).sum()) for kind in Outcome if kind is not Outcome.FINISHED}
    return ", ".join(f"{count:,} {kind.label}" for kind, count in counts.items() if count)


def _dominant_order(cube: xr.Dataset) -> str:
    amplitude = cube["thrust_amplitude"]
    mean = amplitude.mean([dim for dim in amplitude.dims if dim != "order"]).isel(order=slice(1, None))
    first, second = (int(mean["order"].values[i]) for i in np.argsort(mean.values)[::-1][:2])
    return (
        f"Order {first} of the thrust force dominates: {_number(float(mean.sel(order=first)))} N on average; "
        f"the next is order {second} with {_number(float(mean.sel(order=second)))} N."
    )


def _effects(response: Response, cube: xr.Dataset) -> list[str]:
    """A sentence on every factor's effect on a response, the strongest first."""
    values = response.values.values
    if not np.isfinite(values).any():
        return []
    low, high, unit = float(np.nanmin(values)), float(np.nanmax(values)), _spaced(response.unit)
    name = response.label
    if high - low <= _FLAT * max(abs(high), abs(low)):
        return [f"The {name} is the same at all points: {_number(high)}{unit}."]
    sentences = [f"The {name} lies between {_number(low)} and {_number(high)}{unit}."]
    effects = []
    for factor in numeric_factors(cube):
        levels, curve = _main_effect(response, cube, factor)
        if levels.size > 1:
            effects.append((float(np.ptp(curve)), _sentence(response, cube, factor, levels, curve)))
    return sentences + [text for _, text in sorted(effects, key=lambda effect: -effect[0])]


def _main_effect(response: Response, cube: xr.Dataset, factor: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of the response over all other factors, at the levels of one (or in ten classes of a sampled one)."""
    values, levels = (array.values.ravel() for array in xr.broadcast(response.values, cube[factor]))
    good = np.isfinite(values)
    values, levels = values[good], levels[good]
    distinct = np.unique(levels)
    if distinct.size > 40:
        edges = np.quantile(levels, np.linspace(0, 1, 11))
        group = np.clip(np.searchsorted(edges, levels, side="right") - 1, 0, 9)
    else:
        group = np.searchsorted(distinct, levels)
    count = np.bincount(group)
    used = count > 0
    mean_level, mean_value = (np.bincount(group, weights=w)[used] / count[used] for w in (levels, values))
    return mean_level, mean_value


def _sentence(
    response: Response, cube: xr.Dataset, factor: str, levels: NDArray[np.float64], curve: NDArray[np.float64]
) -> str:
    unit = unit_text(str(cube[factor].attrs.get("units", "1")))
    name, subject, rise = spoken(factor), f"the {response.label}", float(np.ptp(curve))
    span = f"{_number(levels[0])} to {_number(levels[-1])}{_spaced(unit)}"
    if rise <= _FLAT * np.abs(curve).max():
        return f"{subject.capitalize()} does not depend on the {name} ({span}): it changes by less than {_FLAT:g} of itself."
    slope, offset = np.polyfit(levels, curve, 1)
    residual = curve - (slope * levels + offset)
    straight = 1 - float(residual @ residual) / max(float(((curve - curve.mean()) ** 2).sum()), 1e-300)
    if straight >= _STRAIGHT and levels.size > 2:
        verb = "grows" if slope > 0 else "falls"
        per = f" per {unit or 'unit'}" + f" of {name}"
        return (
            f"{subject.capitalize()} {verb} {_number(abs(slope))}{_spaced(response.unit)}{per} "
            f"(mean over the other factors, {span}; straight line with R2 = {straight:.4f})."
        )
    least, most = levels[int(np.argmin(curve))], levels[int(np.argmax(curve))]
    return (
        f"{subject.capitalize()} is on average {_number(curve.min())}{_spaced(response.unit)} at a {name} of "
        f"{_number(least)}{_spaced(unit)} and {_number(curve.max())}{_spaced(response.unit)} at {_number(most)}{_spaced(unit)}."
    )


def find_in_analyses(analyses: Mapping[str, xr.Dataset]) -> list[str]:
    """Sentences on the strongest factor of each sensitivity analysis."""
    sentences = []
    for name, result in analyses.items():
        key = "ST" if "ST" in result else "mu_star"
        index = result[key]
        if "output" in index.dims:
            index = index.isel(output=0)
        if "order" in index.dims:
            index = index.sel(order=3)
        if index.ndim != 1 or not bool(index.notnull().any()):
            continue
        strongest = str(index["factor"].values[int(index.argmax())])
        interval = float(
            result[f"{key}_conf"].sel({str(d): index[d] for d in index.coords if d != "factor"}).sel(factor=strongest)
        )
        what = "total Sobol' index" if key == "ST" else "mean elementary effect"
        sentences.append(
            f"By analysis {name} the {spoken(strongest)} matters most: {what} {_number(float(index.max()))} +- {_number(interval)}."
        )
    return sentences


def _spaced(unit: str) -> str:
    return f" {unit}" if unit else ""


def _number(value: float) -> str:
    return f"{value:.4g}" if value else "0"
