"""Findings of a sensitivity analysis: sentences on its strongest factors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from tripod_doe.analysis.kinds import kind_of
from tripod_doe.report.responses import ORDINALS, listed, spoken

__all__ = ["SensitivityPart", "find_in_sensitivity", "sensitivity_parts"]

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
    first, *others = _ranked(part, "ST")
    then = listed([f"{spoken(factor)} ({value:.3g} +- {half:.2g})" for factor, value, half in others[:2]])
    own = 100 * min(max(float(part["S1"].sum()), 0), 1)
    return (
        f"The variance of {what} comes first from {spoken(first[0])} (total Sobol' index {first[1]:.3g} +- "
        f"{first[2]:.2g}){f', then {then}' if then else ''}; {own:.0f} % of it is the factors' own, the rest their "
        f"interactions (analysis {name})."
    )


def _morris_sentence(name: str, what: str, part: xr.Dataset) -> str:
    told = [f"{spoken(factor)} {value:.3g} +- {half:.2g}" for factor, value, half in _ranked(part, "mu_star")[:3]]
    return (
        f"The largest mean elementary effects on {what}, in its unit over a factor's whole range: {listed(told)} "
        f"(analysis {name})."
    )


def _ranked(part: xr.Dataset, key: str) -> list[tuple[str, float, float]]:
    """Factor, index and half width of its interval, the largest first."""
    rows = zip(part["factor"].values, part[key].values, part[f"{key}_conf"].values, strict=True)
    return sorted(((str(f), float(v), float(c)) for f, v, c in rows if np.isfinite(v)), key=lambda row: -row[1])
