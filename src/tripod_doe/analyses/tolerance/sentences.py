"""Findings and table of a tolerance analysis: quantiles, probabilities to exceed limits, what to tighten first."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.quantities import interval, number, with_unit
from tripod_doe.report.main_outputs import OutputPart, left_points, main_outputs, quantile_text
from tripod_doe.report.responses import listed, spoken

_MOST_NAMED = 3


def tolerance_parts(result: xr.Dataset) -> list[OutputPart]:
    """Main outputs with their quantiles and gains."""
    return main_outputs(result, "mean")


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
    """How far one scatter, or two, must shrink so that the limit is kept; nothing where it is kept."""
    keep = float(part.attrs.get("keep", np.nan))
    if not np.isfinite(part["exceedance"]) or "scale_to_keep" not in part or not float(part["exceedance"]) > 1 - keep:
        return []
    names, scale = [str(name) for name in part["factor"].values], part["scale_to_keep"].values
    aim = f"To keep {what} within {with_unit(number(float(part['limit'])), unit)} with {100 * keep:g} %"
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
    return [f"{aim}, these points resolve no smaller scatter of one factor or two that is enough: shift a mean value."]


def _percent(row: tuple[str, float, float, float]) -> str:
    return f"{interval(100 * float(row[1]), 100 * float(row[2]))} %"


def tolerance_table(result: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """What halving the scatter of each factor gains, for each main output, the largest first."""
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
