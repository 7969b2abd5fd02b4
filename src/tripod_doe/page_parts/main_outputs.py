"""The main outputs of an analysis, each with its name in words and its unit."""

import json
from collections.abc import Collection, Hashable
from typing import NamedTuple

import numpy as np
import xarray as xr

from tripod_doe.number_text import count_of, digits_apart, number, text_range, with_unit
from tripod_doe.page_parts.words import ORDINALS, place_text, spoken, unit_text
from tripod_doe.phases import turned_on
from tripod_doe.study.cube.dataset import PHASES, RESPONSES

_MOST = 4  # outputs of a function
_AMPLITUDE = "thrust_amplitude"
_MOST_DIGITS = 12
_UNNAMED = "the output"  # of a result that does not say what it was made of


class OutputPart(NamedTuple):
    """Answers on one output, without its dimensions: which output of the cube, what it is in words, and its unit.

    A phase has no smallest value: its quantiles are of its differences from the mean.
    """

    output: str
    what: str
    unit: str
    answers: xr.Dataset

    @property
    def is_phase(self) -> bool:
        """Whether it is an angle on a circle."""
        return self.output in str(self.answers.attrs.get(PHASES, "")).split(", ")


def main_outputs(
    result: xr.Dataset, key: str, over: Collection[str] = (), orders: Collection[int] = (3, 2)
) -> list[OutputPart]:
    """Orders of the thrust, usually the third and second, and the responses of the study; of a function, four outputs.

    Of further dimensions they are the answers at the first labels, which they name.

    Args:
        key: Name of the answer's variable; parts without a number in it are left out.
        over: Dimensions of the answer that the output does not have.
        orders: Orders of the thrust.
    """
    several = [str(name) for name in result["output"].values] if "output" in result.dims else []
    outputs = several or str(result.attrs.get("outputs", _UNNAMED)).split(", ")[:1]
    own = [name for name in str(result.attrs.get(RESPONSES, "")).split(", ") if name in outputs]
    if _AMPLITUDE in outputs:
        outputs = [_AMPLITUDE, *own]
    parts, table = [], in_table(result)
    for output in outputs[: max(_MOST, len(own))]:
        of_output = result.sel(output=output) if several else result
        for order in _own_orders(of_output[table], orders) or (None,):
            part = of_output if order is None else of_output.sel(order=order)
            first = dict.fromkeys((dim for dim in part[key].dims if dim not in over), 0)
            named = {dim: at for dim, at in first.items() if differ(part[table], dim)}
            part, place = part.isel(first), place_text(part, named)
            if part[key].notnull().any():
                parts.append(output_part(output, _words(output, order) + place, part))
    return parts


def in_table(result: xr.Dataset) -> list[Hashable]:
    """Names of the answers on several outputs at once; all of a result without such: others are on one output each."""
    return [name for name, each in result.data_vars.items() if "output" in each.dims] or [*result.data_vars]


def output_part(output: str, what: str, answers: xr.Dataset) -> OutputPart:
    """Answers on one output with its unit; of a phase about its mean."""
    units: dict[str, str] = json.loads(str(answers.attrs.get("output_units", "{}")))
    part = OutputPart(output, what, unit_text(units.get(output, "1")), answers)
    return part._replace(answers=_about_mean(answers)) if part.is_phase else part


def _own_orders(answers: xr.Dataset, orders: Collection[int]) -> list[int]:
    """The wanted orders that an output has; none for an output without orders in a table of several."""
    known = answers["order"].values.tolist() if "order" in answers.dims and differ(answers, "order") else []
    return [order for order in orders if order in known]


def differ(answers: xr.Dataset, dim: Hashable) -> bool:
    """Whether answers differ along a dimension; in a table of several outputs, one without it repeats its answers."""
    along = [(each, each.isel({dim: 0}, drop=True)) for each in answers.data_vars.values() if dim in each.dims]
    return not all(bool(((each == first) | (each.isnull() & first.isnull())).all()) for each, first in along)


def _about_mean(answers: xr.Dataset) -> xr.Dataset:
    """The distribution of a phase as differences from its mean, deg; its quantiles grow with their probability."""
    if "mean" not in answers or "quantile" not in answers:
        return answers
    parts = [answers["quantile"], answers["distribution"]]
    chance = np.concatenate([part[dim].values for part, dim in zip(parts, ("probability", "share"), strict=True)])
    phases = np.concatenate([part.values for part in parts])
    by_chance = np.argsort(chance, kind="stable")
    first = -turned_on(float(answers["mean"] - phases[by_chance[0]]))
    relative = np.empty_like(phases)
    relative[by_chance] = first + np.append(0.0, np.cumsum(turned_on(np.diff(phases[by_chance]))))
    quantile, distribution = np.split(relative, [parts[0].size])
    low, high = (answers[f"quantile_{end}"] for end in ("low", "high"))
    return answers.assign(
        quantile=("probability", quantile),
        distribution=("share", distribution),
        quantile_low=("probability", quantile - turned_on((answers["quantile"] - low).values)),
        quantile_high=("probability", quantile + turned_on((high - answers["quantile"]).values)),
    )


def _words(output: str, order: int | None) -> str:
    if order is None:
        return output
    return (
        f"the {ORDINALS[order]}"
        if output in (_AMPLITUDE, _UNNAMED)
        else f"the {spoken(output)} of the {ORDINALS[order]}"
    )


def quantile_text(part: OutputPart) -> str:
    """Quantiles of a distribution, each with its interval, or with the one end that the points bound, or none."""
    answers = part.answers
    lows, values, highs = (answers[key].values.tolist() for key in ("quantile_low", "quantile", "quantile_high"))
    known = [_digits(low, high) for low, high in zip(lows, highs, strict=True)]
    most, texts = max([3, *filter(None, known)]), []
    for chance, value, low, high, own in zip(answers["probability"].values, values, lows, highs, known, strict=True):
        digits = own or most  # with fewer digits it may lie below a smaller one
        shown = with_unit(number(value, digits), part.unit)
        texts.append(f"{100 * chance:g} % below {shown} ({_bounds(low, high, digits)})")
    start = "from this mean, " if part.is_phase else ""
    return start + ", ".join(texts)


def _digits(low: float, high: float) -> int | None:
    """Digits that tell the ends of an interval apart; None if an end is not known, or they are alike."""
    digits = digits_apart(low, high) if np.isfinite([low, high]).all() else _MOST_DIGITS + 1
    return digits if digits <= _MOST_DIGITS else None


def _bounds(low: float, high: float, digits: int) -> str:
    """Value and interval of a quantile from the points."""
    if np.isfinite(low) and np.isfinite(high):
        return text_range(number(low, digits), number(high, digits))
    if np.isfinite(low):
        return f"at least {number(low, digits)}"
    return f"at most {number(high, digits)}" if np.isfinite(high) else "too few points for an interval"


def left_points(result: xr.Dataset) -> list[str]:
    """What an analysis leaves out: outputs, and points that are missing, with the region in which most of them lie."""
    lines = [line.partition(": ") for line in str(result.attrs.get("left_out", "")).splitlines()]
    said = [f"The output {spoken(name)} is left out: {reason}." for name, _, reason in lines]
    dropped, block = int(result.attrs.get("points_dropped", 0)), int(result.attrs.get("block_size", 1))
    if dropped:
        of_blocks = f" in {count_of(dropped // block, 'block')} of {block} points" if block > 1 else ""
        how = f"{'is' if dropped == 1 else 'are'} {'missing' if block == 1 else 'dropped'}"
        said.append(f"{count_of(dropped, 'point')}{of_blocks} {how}, {int(result.attrs['points_used']):,} are used.")
    region = str(result.attrs.get("failing_region", ""))
    return said + [f"Points fail {region}."] * bool(region)


def answered_range(result: xr.Dataset, name: str) -> list[str]:
    """The range of a factor for which alone an analysis of this name answers; empty if it answers for all of them."""
    if not (answered := str(result.attrs.get("answered_range", ""))):
        return []
    used, outside = (f"{int(result.attrs.get(key, 0)):,}" for key in ("points_used", "points_outside"))
    points = f"{used} points in this range are used, {outside} points that have an answer outside of it are not"
    return [f"Results of analysis {name} hold for {answered} only: {points}."]
