"""What the mechanisms contribute: shares by every definition as tables and sentences, beside those of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analysis.contribution import PAPER_SHARES
from tripod_doe.analysis.kinds import of_kind
from tripod_doe.joint.parameters import JOINT_PARAMETERS, MECHANISMS
from tripod_doe.quantities import level, number, with_unit
from tripod_doe.report.responses import ORDINALS, factor_label, factor_unit, spoken, unit_text

__all__ = [
    "DEFINITIONS",
    "Contribution",
    "contribution_findings",
    "contribution_notes",
    "contributions",
    "find_in_contribution",
    "share_rows",
    "span",
]

FloatArray = NDArray[np.float64]

DEFINITIONS = {
    "share_off": "switching off",
    "share_on": "on alone",
    "share_shapley": "Shapley value",
    "share_direct": "direct decomposition",
}
"""Definitions of a share by the variables that hold them."""

_PAPER_POINT = {name: JOINT_PARAMETERS[name].default for name in ("joint_angle_deg", "torque_n_m", "speed_rpm")}
_PRINTED = 0.05  # percent that still shows in the one digit after the point
_AGREE = 4.0  # percentage points within which two shares count as agreeing
_ALL_OF_IT = 0.5  # percent within which a share by switching off counts as the whole


@dataclass(frozen=True)
class Contribution:
    """The shares of one order, or of one output, at all operating points.

    Attributes
    ----------
    analysis, key
        Name of the analysis, and of this part of it in file names.
    what
        What is shared out, in words.
    model
        The model of all points; empty where they have none, or several.
    mechanisms
        Names of the mechanisms.
    points
        Factors of the operating points, a row each; without columns where there is one point only.
    labels
        The operating points in words.
    shares
        Percent by definition, each of shape (operating point, mechanism); NaN where not known.
    closure, none, interaction
        Percent: 100 less the sum of the shares by switching off, P(none) and the strongest interaction.
    pairs
        The pairs with that interaction.
    amplitude
        With all mechanisms on, as text with its unit.
    paper
        The paper's shares of it, for each mechanism; None where it gives none.
    like_paper
        Which operating points are the paper's in joint angle, torque and speed, as far as these vary.
    missing
        Why there are no shares at all; empty where there are some.
    """

    analysis: str
    key: str
    what: str
    model: str
    mechanisms: list[str]
    points: pd.DataFrame
    labels: list[str]
    shares: dict[str, FloatArray]
    closure: FloatArray
    none: FloatArray
    interaction: FloatArray
    pairs: list[str]
    amplitude: str
    paper: FloatArray | None
    like_paper: NDArray[np.bool_]
    missing: str

    @property
    def fairest(self) -> str:
        """The definition that sentences and charts of many operating points show."""
        known = [name for name, values in self.shares.items() if np.isfinite(values).all()]
        return next((name for name in ("share_shapley", "share_off", "share_on") if name in known), "share_off")

    def differences(self) -> dict[str, float]:
        """Largest difference from the four printed shares at the paper's operating point, in percentage points."""
        if self.paper is None:
            return {}
        printed = [self.mechanisms.index(name) for name in PAPER_SHARES]
        there = {name: values[self.like_paper][:, printed] for name, values in self.shares.items()}
        known = {name: values for name, values in there.items() if np.isfinite(values).all()}
        return {name: float(np.abs(values - self.paper[printed]).max()) for name, values in known.items()}


def contributions(analyses: Mapping[str, xr.Dataset]) -> list[Contribution]:
    """The third and the second order of every contribution analysis, or its output where that has no orders."""
    return [
        _contribution(name, result, order)
        for name, result in of_kind(analyses, "contribution").items()
        for order in ((3, 2) if "order" in result.dims else (None,))
        if order is None or order in result["order"].values
    ]


def _contribution(name: str, result: xr.Dataset, order: int | None) -> Contribution:
    output, dims = str(result.attrs.get("outputs", "")), str(result.attrs.get("operating_dims", "")).split()
    points = result.stack(at=dims, create_index=False) if dims else result.expand_dims("at")
    points = points if order is None else points.sel(order=order)
    what = output if order is None else f"the {ORDINALS[order]}"
    for dim in points["share_off"].dims:
        if dim not in ("at", "mechanism"):  # the first groove stands for all
            what += f" ({dim} {points[dim].values[0]})" if dim in points.coords else f" ({dim} 1)"
            points = points.isel({dim: 0})
    factors = [str(c) for c in points.coords if points[c].dims == ("at",) and "source" in points[c].attrs]
    mechanisms = [str(each) for each in points["mechanism"].values]
    amplitude = points["amplitude"].values
    of_paper = order == 3 and output.startswith("thrust_") and set(mechanisms) == set(MECHANISMS)
    like_paper = np.ones(points.sizes["at"], bool)
    for factor in set(factors) & set(_PAPER_POINT):
        like_paper &= points[factor].values == _PAPER_POINT[factor]
    rest = 100 - sum(PAPER_SHARES.values())
    nothing = np.full(points.sizes["at"], np.nan)
    return Contribution(
        analysis=name,
        key=name if order is None else f"{name}-order-{order}",
        what=what,
        model=str(result.attrs.get("model", "")),
        mechanisms=mechanisms,
        points=pd.DataFrame({factor: points[factor].values for factor in factors}, index=range(points.sizes["at"])),
        labels=_labels(points, factors),
        shares={key: points[key].transpose("at", "mechanism").values for key in DEFINITIONS if key in points},
        closure=points["closure"].values,
        none=points["share_none"].values,
        interaction=points["strongest_interaction"].values if "interaction" in points else nothing,
        pairs=[str(pair) for pair in points["strongest_pair"].values] if "interaction" in points else [],
        amplitude=_amplitude(amplitude, unit_text(str(points["amplitude"].attrs.get("units", "1")))),
        paper=np.array([PAPER_SHARES.get(each, rest) for each in mechanisms])
        if of_paper and like_paper.any()
        else None,
        like_paper=like_paper,
        missing=_why_missing(points),
    )


def _why_missing(points: xr.Dataset) -> str:
    if any(bool(points[key].notnull().any()) for key in DEFINITIONS if key in points):
        return ""
    zero = bool((points["share_off_flag"] == 1).all())
    return "its amplitude is zero within its error" if zero else "points that they need did not finish"


def _labels(points: xr.Dataset, factors: list[str]) -> list[str]:
    """Operating points in words, by the factors that vary."""
    columns = []
    for name in factors:
        values = points[name].values.tolist()
        if len(set(values)) > 1:
            texts = [level(value) if isinstance(value, int | float) else str(value) for value in values]
            unit = factor_unit(points, name)
            columns.append(
                [with_unit(text, unit) if unit else f"{factor_label(points, name)} {text}" for text in texts]
            )
    return [", ".join(parts) for parts in zip(*columns, strict=True)] if columns else [""] * points.sizes["at"]


def _amplitude(values: FloatArray, unit: str) -> str:
    values = values[np.isfinite(values)]
    if values.size == 0:
        return ""
    low, high = number(float(values.min())), number(float(values.max()))
    return with_unit(low if low == high else f"{low} to {high}", unit)


def _percent(values: FloatArray) -> str:
    return f"{span(values)} %" if span(values) else "not known"


def span(values: FloatArray) -> str:
    """Percent as text: one number, or the smallest and the largest of several; empty if none is known."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return ""
    low, high = (f"{value:.1f}".replace("-0.0", "0.0") for value in (known.min(), known.max()))
    return low if low == high else f"{low} to {high}"


def share_rows(part: Contribution) -> tuple[list[str], list[list[str]], list[list[str]]]:
    """The table of one contribution: heads, one row per mechanism, and rows of sums and remainders.

    Parameters
    ----------
    part
        Shares of one order or output; of several operating points the least and the most are given.
    """
    heads = ["Mechanism", *(DEFINITIONS[name] for name in part.shares)]
    rows = [
        [spoken(mechanism), *(span(values[:, at]) or "not known" for values in part.shares.values())]
        for at, mechanism in enumerate(part.mechanisms)
    ]
    sums = [values.sum(axis=1) for values in part.shares.values()]
    below = [
        ["sum", *(span(total) or "not known" for total in sums)],
        ["closure: 100 - sum", *(span(100 - total) or "not known" for total in sums)],
        ["all off, P(none)", *([span(part.none) or "not known"] + [""] * (len(sums) - 1))],
    ]
    if part.paper is not None:
        heads.append("paper, 3.5")
        for row, mechanism, share in zip(rows, part.mechanisms, part.paper, strict=True):
            row.append(f"{share:.0f}" if mechanism in PAPER_SHARES else f"{share:.0f} (rest)")
        differences = part.differences()
        below.append(
            [
                "largest gap to the paper",
                *(f"{differences[k]:.1f}" if k in differences else "" for k in part.shares),
            ]
        )
        below = [[*row, "100" if row[0] == "sum" else ""] for row in below]
    return heads, rows, below


def find_in_contribution(name: str, result: xr.Dataset) -> list[str]:
    """Sentences on a contribution analysis: the shares of the third and the second order."""
    return [sentence for part in contributions({name: result}) for sentence in contribution_findings(part)]


def contribution_findings(part: Contribution) -> list[str]:
    """State the shares, the mechanisms that oppose the sum, and the definition closest to the paper's shares."""
    if part.missing:
        return [f"{_start(part.what)} has no shares: {part.missing} (analysis {part.analysis})."]
    return [_who_makes_it(part), *_nearest_to_paper(part)]


def contribution_notes(part: Contribution) -> list[str]:
    """Notes on the shares: mechanisms on which all of the amplitude depends, and the strongest interaction."""
    if part.missing:
        return contribution_findings(part)
    return _all_passes(part) + _strongest_interaction(part) + _agreement(part)


def _agreement(part: Contribution) -> list[str]:
    """State where the direct decomposition agrees with the ablation, and why it may differ."""
    direct = part.shares.get("share_direct")
    if direct is None or not np.isfinite(direct).all():
        return []
    told = [
        f"{meaning} {_compared(part.mechanisms, direct, part.shares[name])}"
        for name, meaning in DEFINITIONS.items()
        if name != "share_direct" and name in part.shares and np.isfinite(part.shares[name]).all()
    ]
    return [
        f"Direct decomposition of {part.what}: what each mechanism's force adds at the grooves while all are on. "
        f"Within {_AGREE:.0f} percentage points {'; '.join(told)}. They need not agree: with a mechanism off, the "
        "motion and the directions of the friction forces change; the decomposition takes the motion as it is. It "
        f"leaves {span(100 - direct.sum(axis=1))} % to inertia, numerical error and mechanisms that are "
        "not switched here."
    ]


def _compared(mechanisms: list[str], direct: FloatArray, values: FloatArray) -> str:
    """For which mechanisms another definition gives the share by direct decomposition."""
    gaps = np.abs(values - direct).max(axis=0)
    same = [spoken(mechanism) for mechanism, gap in zip(mechanisms, gaps, strict=True) if gap <= _AGREE]
    apart = [
        f"{spoken(mechanisms[at])} (direct {span(direct[:, at])} %, there {span(values[:, at])} %)"
        for at in np.flatnonzero(gaps > _AGREE)
    ]
    if not apart:
        return "agrees for all"
    return f"agrees for {', '.join(same) or 'none'}, but not for {', '.join(apart)}"


def _strongest_interaction(part: Contribution) -> list[str]:
    if not np.isfinite(part.interaction).any():
        return []
    strongest = int(np.nanargmax(np.abs(part.interaction)))
    pair = " and ".join(spoken(name) for name in part.pairs[strongest].split(" + "))
    size = float(part.interaction[strongest])
    at = f", at {part.labels[strongest]}" if part.labels[strongest] else ""
    they = "produce only together" if size > 0 else "each produce alone, but not twice when both are on"
    return [
        f"The strongest interaction in {part.what} is of {pair}: {abs(size):.1f} % of it they {they} (Shapley "
        f"interaction index{at})."
    ]


def _start(text: str) -> str:
    return text[0].upper() + text[1:] if text.startswith("the ") else text


def _who_makes_it(part: Contribution) -> str:
    values = part.shares[part.fairest]
    means = np.nansum(values, axis=0) / np.maximum(np.isfinite(values).sum(axis=0), 1)
    ranked = np.argsort(-means, kind="stable")
    told = [f"{spoken(part.mechanisms[at])} {_percent(values[:, at])}" for at in ranked if means[at] >= -_PRINTED]
    against = [f"{spoken(part.mechanisms[at])} ({span(values[:, at])} %)" for at in ranked if means[at] < -_PRINTED]
    opposed = f"; {', '.join(against)} oppose{'s' if len(against) == 1 else ''} the sum" if against else ""
    closure = f"; the shares by switching off leave a closure of {span(part.closure)} %" if span(part.closure) else ""
    return (
        f"Of {part.what}{f' ({part.amplitude})' if part.amplitude else ''}, by {DEFINITIONS[part.fairest]}: "
        f"{', '.join(told)}{opposed}{closure} (analysis {part.analysis})."
    )


def _nearest_to_paper(part: Contribution) -> list[str]:
    differences = part.differences()
    if not differences:
        return []
    nearest = min(differences, key=lambda name: differences[name])
    others = [f"{DEFINITIONS[name]}: {value:.1f}" for name, value in differences.items() if name != nearest]
    told = f" ({', '.join(others)})" if others else ""
    at = [label for label, is_there in zip(part.labels, part.like_paper, strict=True) if is_there]
    where = f", at {'; '.join(at)}," if any(at) else ""
    printed = ", ".join(f"{spoken(name)} {share:.0f} %" for name, share in PAPER_SHARES.items())
    return [
        f"The paper's shares of {part.what} ({printed}) are{where} closest to those by {DEFINITIONS[nearest]}: the "
        f"largest difference is {differences[nearest]:.1f} percentage points{told}."
    ]


def _all_passes(part: Contribution) -> list[str]:
    """A note if the amplitude vanishes without one mechanism: the consequence for each definition."""
    whole = np.nan_to_num(np.abs(part.shares["share_off"] - 100), nan=np.inf).max(axis=0) < _ALL_OF_IT
    needed = [spoken(name) for name, is_whole in zip(part.mechanisms, whole, strict=True) if is_whole]
    if len(needed) == 1:
        return [
            f"All of {part.what} depends on {needed[0]}: without it the amplitude is zero. The Shapley value divides "
            "what another mechanism adds equally between the two, so that one gets about half of its share by "
            "switching off."
        ]
    if needed:
        return [
            f"{_start(part.what)} needs {' and '.join(needed)} together: switching off either takes all of it away, "
            "each alone makes nothing, and the Shapley value shares it equally among them."
        ]
    return []
