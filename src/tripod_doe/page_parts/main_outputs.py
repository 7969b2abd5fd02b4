"""The outputs of an analysis that a reader asks for first, each with its name in words and its unit."""

import json
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import xarray as xr

from tripod_doe.page_parts.main_results import ORDINALS, spoken, unit_text
from tripod_doe.quantities import count_of, digits_apart, in_words, number, text_range, with_unit
from tripod_doe.study.cube.dataset import RESPONSES

_MOST = 4  # outputs of a function
_AMPLITUDE = "thrust_amplitude"
_MOST_DIGITS = 6
_UNNAMED = "the output"  # of a result that does not say what it was made of


class OutputPart(NamedTuple):
    """Answers on one output, without its dimensions: which output of the cube, what it is in words, and its unit."""

    output: str
    what: str
    unit: str
    answers: xr.Dataset


def main_outputs(
    result: xr.Dataset, key: str, over: Collection[str] = (), orders: Collection[int] = (3, 2)
) -> list[OutputPart]:
    """Orders of the thrust, usually the third and second, and the responses of the study; of a function, four outputs.

    Args:
        key: Its answer; parts in which it has no number are left out.
        over: Dimensions of the answer that the output does not have.
        orders: Of the thrust.
    """
    several = [str(name) for name in result["output"].values] if "output" in result.dims else []
    outputs = several or str(result.attrs.get("outputs", _UNNAMED)).split(", ")[:1]
    own = [name for name in str(result.attrs.get(RESPONSES, "")).split(", ") if name in outputs]
    if _AMPLITUDE in outputs:
        outputs = [_AMPLITUDE, *own]
    units: dict[str, str] = json.loads(str(result.attrs.get("output_units", "{}")))
    parts = []
    for output in outputs[: max(_MOST, len(own))]:
        of_output = result.sel(output=output) if several else result
        for order in orders if "order" in result.dims and output not in own else (None,):
            part = of_output if order is None else of_output.sel(order=order)
            part = part.isel(dict.fromkeys((dim for dim in part[key].dims if dim not in over), 0))
            if part[key].notnull().any():
                what = in_words(output) if output in own else _words(output, order)
                parts.append(OutputPart(output, what, unit_text(units.get(output, "1")), part))
    return parts


def _words(output: str, order: int | None) -> str:
    if order is None:
        return output
    return (
        f"the {ORDINALS[order]}"
        if output in (_AMPLITUDE, _UNNAMED)
        else f"the {spoken(output)} of the {ORDINALS[order]}"
    )


def quantile_text(answers: xr.Dataset, unit: str) -> str:
    """Quantiles of a distribution, each with its interval, or with the one end that the points bound, or none."""
    text = []
    for probability in answers["probability"].values:
        at = answers.sel(probability=probability)
        low, value, high = (float(at[key]) for key in ("quantile_low", "quantile", "quantile_high"))
        digits = min(digits_apart(low, high), _MOST_DIGITS) if np.isfinite(low) and np.isfinite(high) else 3
        shown = with_unit(number(value, digits), unit)
        text.append(f"{100 * probability:g} % below {shown} ({_bounds(low, high, digits)})")
    return ", ".join(text)


def _bounds(low: float, high: float, digits: int) -> str:
    """Value and interval of a quantile from the points."""
    if np.isfinite(low) and np.isfinite(high):
        return text_range(number(low, digits), number(high, digits))
    if np.isfinite(low):
        return f"at least {number(low)}"
    return f"at most {number(high)}" if np.isfinite(high) else "too few points for an interval"


def left_points(result: xr.Dataset) -> list[str]:
    """Numbers of missing and remaining points, in a sentence; none where all are there."""
    dropped = int(result.attrs.get("points_dropped", 0))
    if not dropped:
        return []
    verb = "is" if dropped == 1 else "are"
    return [f"{count_of(dropped, 'point')} {verb} missing, {result.attrs['points_used']:,} are used."]
