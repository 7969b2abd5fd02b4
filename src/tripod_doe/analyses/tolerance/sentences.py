"""Findings and table of a tolerance analysis: quantiles, probabilities to exceed limits, what to tighten first."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.page_parts.main_outputs import OutputPart, left_points, main_outputs, quantile_text
from tripod_doe.page_parts.responses import listed, spoken, unit_text
from tripod_doe.quantities import interval, number, with_unit

_MOST_NAMED = 3
_AMPLITUDE = "thrust_amplitude"
_NOTABLE = 0.1  # of the largest order, from which on another one is stated
_MOST_ORDERS = 6


def tolerance_parts(result: xr.Dataset) -> list[OutputPart]:
    """Main outputs with their quantiles and gains; of the thrust also orders that are large, or have a limit."""
    return main_outputs(result, "mean", orders=_orders(result))


def _orders(result: xr.Dataset) -> tuple[int, ...]:
    """The third and second order, those with a limit, and those of at least a tenth of the largest one."""
    usual = (3, 2)
    several = "output" in result.dims
    if "order" not in result.dims or (several and _AMPLITUDE not in result["output"].values):
        return usual
    own = result.sel(output=_AMPLITUDE) if several else result
    means = own["mean"].sel(order=own["order"] > 0)
    means = means.isel(dict.fromkeys((dim for dim in means.dims if dim != "order"), 0)).fillna(0.0)
    limits = own["limit"].isel(dict.fromkeys((dim for dim in own["limit"].dims if dim != "order"), 0))
    large = means.sel(order=means >= _NOTABLE * means.max()).sortby(-means)["order"].values.tolist()
    limited = own["order"].values[np.isfinite(limits.values)].tolist()
    return tuple(dict.fromkeys([*usual, *limited, *large]))[:_MOST_ORDERS]


def find_in_tolerance(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on quantiles, limits and gains of each main output."""
    sentences = []
    for _, what, unit, part in tolerance_parts(result):
        sentences += [*_quantiles(what, part, unit, name), *_exceedance(what, part, unit), *_gains(what, part, unit)]
        sentences += _keeping(what, part, unit)
    sentences += left_points(result)
    if region := str(result.attrs.get("failing_region", "")):
        sentences.append(f"Points fail {region}; the distribution leaves them out.")
    return sentences


def _quantiles(what: str, part: xr.Dataset, unit: str, name: str) -> list[str]:
    mean, deviation = (with_unit(number(float(part[key])), unit) for key in ("mean", "std"))
    centre = f"mean {mean}, standard deviation {deviation}"
    return [f"Scatter of {what}: {centre}; {quantile_text(part, unit)} (analysis {name})."]


def _exceedance(what: str, part: xr.Dataset, unit: str) -> list[str]:
    if not np.isfinite(part["exceedance"]):
        return []
    low, value, high = (100 * float(part[key]) for key in ("exceedance_low", "exceedance", "exceedance_high"))
    limit = with_unit(number(float(part["limit"])), unit)
    return [
        f"The probability that {what} exceeds {limit} is {number(value, 2)} % "
        f"({number(low, 2)} to {number(high, 2)} %)."
    ]


def _gains(what: str, part: xr.Dataset, unit: str) -> list[str]:
    """Which scatter to halve first: only gains that exceed their intervals."""
    rows = zip(
        map(str, part["factor"].values),
        part["gain_of_halving"].values,
        part["gain_of_halving_conf"].values,
        part["exceedance_if_halved"].values,
        strict=True,
    )
    exceeds = np.isfinite(part["exceedance"]) and float(part["exceedance"]) > 0
    resolved = [row for row in rows if row[1] - row[2] > 0]
    known = sorted(resolved, key=lambda row: (row[3], -row[1]) if exceeds else (-row[1], 0))
    if not known:
        return [f"These points resolve no gain for {what} by halving the scatter of a single factor."]
    first = known[0]
    after = ""
    if np.isfinite(first[3]) and float(part["exceedance"]) > 0:
        limit = with_unit(number(float(part["limit"])), unit)
        after = (
            f", and {number(100 * float(first[3]), 2)} % in place of {number(100 * float(part['exceedance']), 2)} % "
            f"would exceed {limit}"
        )
    head = (
        f"For {what}, tighten {spoken(first[0])} first: half its scatter takes {_percent(first)} off the standard "
        f"deviation{after}"
    )
    others = listed([f"{spoken(row[0])} {_percent(row)}" for row in known[1:_MOST_NAMED]])
    return [f"{head}{f'; next {others}' if others else ''}."]


def _keeping(what: str, part: xr.Dataset, unit: str) -> list[str]:
    """The scale by which one scatter, or two, must shrink to keep the limit; nothing where it is kept."""
    keep = float(part.attrs.get("keep", np.nan))
    if not np.isfinite(part["exceedance"]) or "scale_to_keep" not in part or not float(part["exceedance"]) > 1 - keep:
        return []
    names, scale = [str(name) for name in part["factor"].values], part["scale_to_keep"].values
    aim = f"To keep {what} within {with_unit(number(float(part['limit'])), unit)} with {100 * keep:g} %"
    return [*_smaller_scatter(aim, names, scale), *_cheapest(part, names), *_shift(part, names)]


def _cheapest(part: xr.Dataset, names: list[str]) -> list[str]:
    """The cheapest set of smaller scatters, where costs are given."""
    if "cheapest_scale" not in part or not np.isfinite(part["cheapest_cost"]):
        return []
    sizes = part["cheapest_scale"].values
    changed = [
        f"{spoken(name)} {number(float(s), 2)} times as far" for name, s in zip(names, sizes, strict=True) if s < 1
    ]
    cost = float(part["cheapest_cost"])
    verb = "scatters" if len(changed) == 1 else "scatter"
    return [
        f"At the costs given, the cheapest way is that {listed(changed)} {verb}, for {number(cost, 3)} "
        "(a scale s costs 1 / s - 1 times what it costs to halve that scatter)."
    ]


def _shift(part: xr.Dataset, names: list[str]) -> list[str]:
    """Which nominal value to move, with the scatter as it is: the one that moves least, in its standard deviations."""
    if "shift_to_keep" not in part:
        return []
    units = json.loads(str(part.attrs.get("factor_units", "{}")))
    moves = [
        f"{spoken(name)} by {with_unit(f'{float(move):+.3g}', unit_text(units.get(name, '1')))}"
        for name, move in zip(names, part["shift_to_keep"].values, strict=True)
        if np.isfinite(move)
    ]
    if not moves:
        return []
    return [
        f"With the scatter as it is, it is enough to move the nominal value of {' or of '.join(moves[:_MOST_NAMED])}."
    ]


def _smaller_scatter(aim: str, names: list[str], scale: NDArray[np.floating[Any]]) -> list[str]:
    """One scatter that is enough, else two."""
    alone = sorted((-scale[k, k], names[k]) for k in range(len(names)) if np.isfinite(scale[k, k]))
    if alone:
        ways = [f"{spoken(name)} scatters {number(-size, 2)} times as far" for size, name in alone[:_MOST_NAMED]]
        return [f"{aim}, it is enough that {' or that '.join(ways)} (by the same points)."]
    pairs = sorted(
        (-scale[k, m], names[m], names[k]) for k in range(len(names)) for m in range(k) if np.isfinite(scale[k, m])
    )
    if pairs:
        size, first, second = pairs[0]
        both = f"{spoken(first)} and {spoken(second)} both scatter {number(-size, 2)} times as far"
        return [f"{aim}, no single scatter suffices; it is enough that {both} (by the same points)."]
    return [f"{aim}, these points resolve no smaller scatter of one factor or two that is enough."]


def _percent(row: tuple[str, float, float, float]) -> str:
    return f"{interval(100 * float(row[1]), 100 * float(row[2]))} %"


def tolerance_table(result: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Gain of halving the scatter of each factor for each main output, the largest first."""
    rows = []
    for _, what, _, part in tolerance_parts(result):
        gains = part["gain_of_halving"].values
        for at in np.argsort(-np.nan_to_num(gains, nan=-np.inf)):
            one = part.isel(factor=int(at))
            row = ("", float(one["gain_of_halving"]), float(one["gain_of_halving_conf"]), 0.0)
            if_halved = float(one["exceedance_if_halved"])
            chance = f"{number(100 * if_halved, 2)} %" if np.isfinite(if_halved) else "-"
            rows.append(
                [what, spoken(str(one["factor"].values)), _percent(row) if np.isfinite(row[1]) else "-", chance]
            )
    return ["output", "factor", "standard deviation less by", "exceeds the limit if halved"], rows
