"""Findings of a sensitivity analysis: sentences on its strongest factors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from tripod_doe.analysis.kinds import kind_of
from tripod_doe.quantities import interval, rounded_up
from tripod_doe.report.responses import ORDINALS, listed, spoken

__all__ = ["SensitivityPart", "find_in_sensitivity", "sensitivity_parts"]

_MOST_NAMED = 4  # factors that a sentence names
_LARGEST_FIRST = {"sobol": "ST", "morris": "mu_star"}
"""The index by which factors are ranked, by the kind of the analysis."""


def find_in_sensitivity(name: str, result: xr.Dataset) -> list[str]:
    """Sentences on the strongest factors of a Sobol' or Morris analysis.

    Parameters
    ----------
    name
        Name of the analysis.
    result
        Its indices.
    """
    sentence = {"sobol": _sobol_sentence, "morris": _morris_sentence}[kind_of(result)]
    return [sentence(name, part.what, part.indices) for part in sensitivity_parts(result)]


class SensitivityPart(NamedTuple):
    """Indices over ``factor`` alone: of which output of the cube, and what that is in words."""

    output: str
    what: str
    indices: xr.Dataset


def sensitivity_parts(result: xr.Dataset) -> list[SensitivityPart]:
    """The parts of a sensitivity analysis that a reader asks for first.

    The third and second order of the thrust; of a function, its first four outputs. Parts without numbers are left out.
    """
    key = _LARGEST_FIRST[kind_of(result)]
    outputs = [str(name) for name in result["output"].values] if "output" in result.dims else []
    if "thrust_amplitude" in outputs:
        outputs = ["thrust_amplitude"]
    parts = []
    for output in outputs[:4] or [str(result.attrs.get("outputs", "the output"))]:
        of_output = result.sel(output=output) if outputs else result
        for order in (3, 2) if "order" in result.dims else (None,):
            indices = of_output if order is None else of_output.sel(order=order)
            indices = indices.isel(dict.fromkeys((dim for dim in indices[key].dims if dim != "factor"), 0))
            if indices[key].notnull().any():
                parts.append(SensitivityPart(output, output if order is None else f"the {ORDINALS[order]}", indices))
    return parts


def _sobol_sentence(name: str, what: str, part: xr.Dataset) -> str:
    ranked = _ranked(part, "ST")
    shown = [row for row in ranked[:_MOST_NAMED] if row[1] > row[2]] or ranked[:1]
    told = listed([f"{spoken(factor)} {interval(value, half)}" for factor, value, half in shown])
    rest = [value + half for _, value, half in ranked[len(shown) :]]
    others = f"; all others at most {rounded_up(max(rest))}" if rest else ""
    first = {index: part[index].values[np.isfinite(part["S1"].values)] for index in ("S1", "S1_conf")}
    total, half = float(first["S1"].sum()), float(np.sqrt((first["S1_conf"] ** 2).sum()))
    alone = (
        f"the first-order indices add up to {interval(total, half)}: "
        + ("no interaction shows" if total + half >= 1 else "the rest are interactions")
    )  # fmt: skip
    return f"Total Sobol' indices of {what}: {told}{others}; {alone} (analysis {name})."


def _morris_sentence(name: str, what: str, part: xr.Dataset) -> str:
    told = [f"{spoken(factor)} {interval(value, half)}" for factor, value, half in _ranked(part, "mu_star")]
    return (
        f"The largest mean elementary effects on {what}, in its unit over a factor's whole range: "
        f"{listed(told[:_MOST_NAMED])} (analysis {name})."
    )


def _ranked(part: xr.Dataset, key: str) -> list[tuple[str, float, float]]:
    """Factor, index and half width of its interval, the largest first."""
    rows = zip(part["factor"].values, part[key].values, part[f"{key}_conf"].values, strict=True)
    return sorted(((str(f), float(v), float(c)) for f, v, c in rows if np.isfinite(v)), key=lambda row: -row[1])
