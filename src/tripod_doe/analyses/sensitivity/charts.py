"""Sensitivity of the responses to the factors: indices as bars, Morris' effects as a map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.kinds import is_study, kind_of, of_kind
from tripod_doe.analyses.sensitivity import RANKED
from tripod_doe.analyses.sensitivity.course_charts import convergence_chart, rotation_charts
from tripod_doe.analyses.sensitivity.sentences import sensitivity_parts
from tripod_doe.errors import InputError
from tripod_doe.report.charts.chart import COLOURS, INK, MARKERS, MUTED, Chart, drawing, legend_above
from tripod_doe.report.responses import spoken, unit_text

_SEEN, _UNSEEN = "#b9d0e8", "#e3e6ea"  # cells of interactions above and within their intervals


def indices_of_study(inputs: Mapping[str, xr.Dataset]) -> list[Chart]:
    """The figure of a workflow: one study and its sensitivity analyses."""
    cubes = [data for data in inputs.values() if is_study(data)]
    if len(cubes) != 1:
        raise InputError("the figure indices needs one study and its sensitivity analyses as inputs")
    return index_charts(inputs, cubes[0])


def index_charts(analyses: Mapping[str, xr.Dataset], cube: xr.Dataset) -> list[Chart]:
    """One chart per sensitivity analysis and main response."""
    charts = []
    for name, result in of_kind(analyses, *RANKED).items():
        level = 100 * float(result.attrs.get("confidence_level", 0.95))
        for position, part in enumerate(sensitivity_parts(result)):
            key, indices = f"{name}-{position + 1}", part.answers
            if {"S1", "ST"} <= set(indices):
                charts.append(_sobol_chart(key, name, part.what, indices, level))
                charts.extend(_interaction_charts(key, name, part.what, indices, level))
            elif kind_of(result) != "morris":
                charts.append(_index_chart(key, name, part.what, indices, level, kind_of(result)))
            else:
                attrs = cube[part.output].attrs if part.output in cube else {}
                unit = unit_text(str(attrs.get("units", "1"))) or "-"
                charts.append(_morris_chart(key, name, part.what, indices, level, unit))
            course = convergence_chart(key, name, part.what, indices, kind_of(result))
            charts += [course] if course else []
        charts += rotation_charts(name, result)
    return charts


def _frame(part: xr.Dataset, keys: tuple[str, ...]) -> pd.DataFrame:
    """One row per factor, sorted by the last index, the largest first."""
    frame = pd.DataFrame({"factor": part["factor"].values} | {key: part[key].values for key in keys})
    return frame.sort_values(keys[0], ascending=False, kind="stable", ignore_index=True)


def _sobol_chart(key: str, name: str, what: str, part: xr.Dataset, level: float) -> Chart:
    data = _frame(part, ("ST", "ST_conf", "S1", "S1_conf"))
    rows = np.arange(len(data))[::-1]
    with drawing(5.0, 1.25 + 0.42 * len(data)) as (figure, axes):
        for index, offset, face, hatch in (("ST", 0.19, "#b9d0e8", ""), ("S1", -0.19, "#f6d9c9", "////")):
            edge = COLOURS[0] if index == "ST" else COLOURS[1]
            label = "total index ST" if index == "ST" else "first-order index S1"
            axes.barh(rows + offset, data[index], 0.36, color=face, edgecolor=edge, hatch=hatch, lw=0.8, label=label)
            axes.errorbar(
                data[index],
                rows + offset,
                xerr=data[f"{index}_conf"],
                fmt="none",
                ecolor=INK,
                elinewidth=1.1,
                capsize=2.5,
            )
            for row, value, half in zip(rows, data[index], data[f"{index}_conf"], strict=True):
                text = f"{value:.2f}".replace("-0.00", "0.00")
                axes.annotate(
                    text,
                    (max(value, 0) + np.nan_to_num(half), row + offset),
                    (4, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=7.5,
                    color=MUTED,
                )
        axes.set_yticks(rows, [spoken(str(factor)) for factor in data["factor"]])
        first, total = data["S1_conf"].fillna(0), data["ST_conf"].fillna(0)
        low, high = float((data["S1"] - first).min()), float((data["ST"] + total).max())
        axes.set_xlim(1.2 * min(0.0, low), 1.12 * high)
        axes.spines["left"].set_visible(False)
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel("Sobol' index (part of the variance, -)")
        legend_above(axes, 2)
    known = bool(data["ST_conf"].notna().any())
    sure = f"with {level:g} % confidence intervals" if known else "without intervals, which this method does not know"
    caption = (
        f"Sobol' indices of {what} {sure} (analysis {name}). The total index counts "
        "a factor with all its interactions, the first-order index the factor alone."
    )
    return Chart(key, f"Sobol' indices of {what}", caption, figure, data)


_INDEX_NAMES = {
    "rbd-fast": "first-order Sobol' index (RBD-FAST)",
    "pawn": "PAWN index",
    "delta": "Borgonovo's delta",
    "dgsm": "upper bound of the total Sobol' index",
    "shapley": "Shapley effect (part of the variance)",
}


def _index_chart(key: str, name: str, what: str, part: xr.Dataset, level: float, kind: str) -> Chart:
    """Bars of one index, with the index of a factor without effect where the method knows it."""
    index = RANKED[kind]
    data = _frame(part, (index, f"{index}_conf"))
    rows = np.arange(len(data))[::-1]
    with drawing(5.0, 1.0 + 0.34 * len(data)) as (figure, axes):
        axes.barh(rows, data[index], 0.6, color="#b9d0e8", edgecolor=COLOURS[0], lw=0.8)
        axes.errorbar(
            data[index], rows, xerr=data[f"{index}_conf"], fmt="none", ecolor=INK, elinewidth=1.1, capsize=2.5
        )
        if "chance" in part:
            axes.axvline(float(part["chance"]), color=COLOURS[1], ls="--", lw=1, label="a factor without effect")
            legend_above(axes, 1)
        axes.set_yticks(rows, [spoken(str(factor)) for factor in data["factor"]])
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(_INDEX_NAMES[kind])
    caption = f"{_INDEX_NAMES[kind]} of {what} with {level:g} % confidence intervals (analysis {name})."
    return Chart(key, f"Sensitivity of {what}", caption[0].upper() + caption[1:], figure, data)


def _interaction_charts(key: str, name: str, what: str, part: xr.Dataset, level: float) -> list[Chart]:
    """The second-order indices as a triangle of cells; none where the analysis holds none."""
    if "S2" not in part or not bool(part["S2"].notnull().any()):
        return []
    factors = [str(factor) for factor in part["factor"].values]
    s2, half = (part[index].transpose("factor", "factor_2").values for index in ("S2", "S2_conf"))
    pairs = [(row, column) for row in range(len(factors)) for column in range(row) if np.isfinite(s2[column, row])]
    data = pd.DataFrame(
        [(factors[b], factors[a], s2[b, a], half[b, a]) for a, b in pairs],
        columns=["factor", "factor_2", "S2", "S2_conf"],
    )
    side = len(factors) - 1
    with drawing(2.0 + 0.62 * side, 1.4 + 0.42 * side) as (figure, axes):
        for (row, column), value, error in zip(pairs, data["S2"], data["S2_conf"], strict=True):
            ground, ink = (_SEEN, INK) if abs(value) > error else (_UNSEEN, MUTED)
            axes.fill_between([column - 0.5, column + 0.5], row - 0.5, row + 0.5, fc=ground, ec="white")
            text = f"{value:.2f}\n±{error:.2f}".replace("-0.00", "0.00").replace("-", "\N{MINUS SIGN}")
            axes.text(column, row, text, ha="center", va="center", fontsize=6.5, color=ink)
        axes.set_xlim(-0.5, side - 0.5)
        axes.set_ylim(side + 0.5, 0.5)
        axes.set_xticks(range(side), [spoken(factor) for factor in factors[:-1]], rotation=30, ha="right")
        axes.set_yticks(range(1, side + 1), [spoken(factor) for factor in factors[1:]])
        axes.tick_params(length=0)
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
    caption = (
        f"Second-order Sobol' indices of {what}: part of the variance by each pair of factors, beyond what each "
        f"makes alone, with {level:g} % confidence intervals (analysis {name}). Shaded: larger than its interval."
    )
    return [Chart(f"{key}-interactions", f"Interactions in {what}", caption, figure, data)]


def _morris_chart(key: str, name: str, what: str, part: xr.Dataset, level: float, unit: str) -> Chart:
    data = _frame(part, ("mu_star", "mu_star_conf", "mu", "sigma"))
    with drawing(5.0, 3.6) as (figure, axes):
        top = 1.15 * max(float((data["mu_star"] + data["mu_star_conf"]).max()), float(data["sigma"].max()))
        axes.plot([0, top], [0, top], ":", color=MUTED, lw=1)
        axes.annotate(
            "σ = μ*",
            (0.94 * top, 0.94 * top),
            (-6, -2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=7.5,
            color=MUTED,
        )
        for which, factor in enumerate(data["factor"]):
            row = data.iloc[which]
            axes.errorbar(
                [row["mu_star"]],
                [row["sigma"]],
                xerr=[row["mu_star_conf"]],
                ls="none",
                ms=6,
                elinewidth=1,
                capsize=2.5,
                color=COLOURS[which % len(COLOURS)],
                marker=MARKERS[which % len(MARKERS)],
                label=spoken(str(factor)),
            )
        axes.set_xlim(-0.02 * top, top)
        axes.set_ylim(-0.02 * top, top)
        axes.set_xlabel(f"mean elementary effect μ* ({unit})")
        axes.set_ylabel(f"standard deviation σ ({unit})")
        legend_above(axes, 2)
    caption = (
        f"Morris' elementary effects on {what}, each over the whole range of its factor, with {level:g} % confidence "
        f"intervals (analysis {name}). Far right: large effect. High up: nonlinear, or interaction with other "
        "factors."
    )
    return Chart(key, f"Elementary effects on {what}", caption, figure, data)
