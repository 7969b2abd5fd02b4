"""Sensitivity of the responses to the factors: indices as bars, their convergence, Morris' effects as a map."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.sensitivity import RANKED
from tripod_doe.analyses.sensitivity.sentences import sensitivity_parts
from tripod_doe.page_parts.charts.chart import (
    COLOURS,
    INK,
    INTERVALS,
    LINES,
    MUTED,
    Chart,
    drawing,
    intervals_text,
    legend_above,
    name_rows,
    series,
)
from tripod_doe.page_parts.words import listed, spoken

_SEEN, _UNSEEN = "#b9d0e8", "#e3e6ea"  # cells of interactions above and within their intervals


def index_charts(result: xr.Dataset, name: str) -> list[Chart]:
    """The charts of each main output of a sensitivity analysis: indices, their interactions and their convergence."""
    charts, kind = [], kind_of(result)
    level = 100 * float(result.attrs.get("confidence_level", 0.95))
    for position, part in enumerate(sensitivity_parts(result), 1):
        key, what, indices = f"{name}-{position}", part.what, part.answers
        if {"S1", "ST"} <= set(indices):
            charts.append(_sobol_chart(key, name, what, indices, level))
            charts.extend(_interaction_charts(key, name, what, indices, level))
        elif kind == "morris":
            charts.append(_morris_chart(key, name, what, indices, level, part.unit or "-"))
        else:
            charts.append(_index_chart(key, name, what, indices, level, kind))
        course = convergence_chart(key, name, what, indices, kind)
        charts += [course] if course else []
    return charts + rotation_charts(name, result)


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
            axes.errorbar(data[index], rows + offset, xerr=data[f"{index}_conf"], **INTERVALS)
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
        name_rows(axes, rows, [spoken(str(factor)) for factor in data["factor"]])
        first, total = data["S1_conf"].fillna(0), data["ST_conf"].fillna(0)
        low, high = float((data["S1"] - first).min()), float((data["ST"] + total).max())
        axes.set_xlim(1.2 * min(0.0, low), 1.12 * high)
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.set_xlabel("Sobol' index (part of the variance, -)")
        legend_above(axes, 2)
    known = bool(data["ST_conf"].notna().any())
    sure = f"with {level:g} % confidence intervals" if known else "without intervals"
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
    """Bars of one index, with the index of a factor without effect if the method gives it."""
    index = RANKED[kind]
    data = _frame(part, (index, f"{index}_conf"))
    rows = np.arange(len(data))[::-1]
    with drawing(5.0, 1.0 + 0.34 * len(data)) as (figure, axes):
        axes.barh(rows, data[index], 0.6, color="#b9d0e8", edgecolor=COLOURS[0], lw=0.8)
        axes.errorbar(data[index], rows, xerr=data[f"{index}_conf"], **INTERVALS)
        if "chance" in part:
            axes.axvline(
                float(part["chance"]), color=COLOURS[1], ls="--", lw=1, label="factors without effect, by chance"
            )
            legend_above(axes, 1)
        name_rows(axes, rows, [spoken(str(factor)) for factor in data["factor"]])
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.set_xlabel(_INDEX_NAMES[kind])
    caption = f"{_INDEX_NAMES[kind]} of {what}{intervals_text(data[f'{index}_conf'], level)} (analysis {name})."
    return Chart(key, f"Sensitivity of {what}", caption[0].upper() + caption[1:], figure, data)


def _interaction_charts(key: str, name: str, what: str, part: xr.Dataset, level: float) -> list[Chart]:
    """The second-order indices as a triangle of cells; no chart if the analysis has none."""
    if "S2" not in part or not bool(part["S2"].notnull().any()):
        return []
    factors = [str(factor) for factor in part["factor"].values]
    s2, conf = (part[index].transpose("factor", "factor_2").values for index in ("S2", "S2_conf"))
    pairs = [(row, column) for row in range(len(factors)) for column in range(row) if np.isfinite(s2[column, row])]
    data = pd.DataFrame(
        [(factors[b], factors[a], s2[b, a], conf[b, a]) for a, b in pairs],
        columns=["factor", "factor_2", "S2", "S2_conf"],
    )
    side = len(factors) - 1
    with drawing(2.0 + 0.62 * side, 1.4 + 0.42 * side) as (figure, axes):
        for (row, column), value, error in zip(pairs, data["S2"], data["S2_conf"], strict=True):
            ground, ink = (_SEEN, INK) if abs(value) > error else (_UNSEEN, MUTED)
            axes.fill_between([column - 0.5, column + 0.5], row - 0.5, row + 0.5, fc=ground, ec="white")
            beside = f"\n±{error:.2f}" if np.isfinite(error) else ""
            text = f"{value:.2f}{beside}".replace("-0.00", "0.00").replace("-", "\N{MINUS SIGN}")
            axes.text(column, row, text, ha="center", va="center", fontsize=6.5, color=ink)
        axes.set_xlim(-0.5, side - 0.5)
        axes.set_ylim(side + 0.5, 0.5)
        axes.set_xticks(range(side), [spoken(factor) for factor in factors[:-1]], rotation=30, ha="right")
        axes.set_yticks(range(1, side + 1), [spoken(factor) for factor in factors[1:]])
        axes.tick_params(length=0)
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
    sure = intervals_text(data["S2_conf"], level)
    caption = (
        f"Second-order Sobol' indices of {what}: part of the variance by each pair of factors, beyond what each "
        f"makes alone{',' * bool(sure)}{sure} (analysis {name}).{' Shaded: larger than its interval.' * bool(sure)}"
    )
    return [Chart(f"{key}-interactions", f"Interactions in {what}", caption, figure, data)]


def _morris_chart(key: str, name: str, what: str, part: xr.Dataset, level: float, unit: str) -> Chart:
    data = _frame(part, ("mu_star", "mu_star_conf", "mu", "sigma"))
    with drawing(5.0, 3.6) as (figure, axes):
        ends = data["mu_star"] + data["mu_star_conf"].fillna(0.0)  # without an interval the value itself
        top = 1.15 * max(float(ends.max()), float(data["sigma"].max()))
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
                ms=6,
                elinewidth=1,
                capsize=2.5,
                label=spoken(str(factor)),
                **series(which) | {"ls": "none"},
            )
        axes.set_xlim(-0.02 * top, top)
        axes.set_ylim(-0.02 * top, top)
        axes.set_xlabel(f"mean elementary effect μ* ({unit})")
        axes.set_ylabel(f"standard deviation σ ({unit})")
        legend_above(axes, 2)
    caption = (
        f"Morris' elementary effects on {what}, each over the whole range of its factor"
        f"{intervals_text(data['mu_star_conf'], level)} (analysis {name}). Far right: large effect. High up: "
        "nonlinear, or interaction with other factors."
    )
    return Chart(key, f"Elementary effects on {what}", caption, figure, data)


_SHOWN = 6  # factors in one picture


def convergence_chart(key: str, name: str, what: str, part: xr.Dataset, kind: str) -> Chart | None:
    """The index of the strongest factors over nested subsamples; None if there is only one size.

    Args:
        part: Indices of one output, as `sensitivity_parts` gives them, with dimension ``samples``.
    """
    index = RANKED[kind]
    over = f"{index}_over_samples"
    if over not in part or part.sizes.get("samples", 1) < 2:
        return None
    order = np.argsort(-np.nan_to_num(part[index].values))[:_SHOWN]
    counts = part["samples"].values
    rows = []
    with drawing(5.0, 3.2) as (figure, axes):
        for rank, at in enumerate(order):
            factor = str(part["factor"].values[at])
            values = part[over].isel(factor=int(at)).values
            half = part[f"{over}_conf"].isel(factor=int(at)).values
            shift = 2.0 ** (0.06 * (rank - len(order) / 2))  # next to each other, not on top
            style = series(rank) | {"elinewidth": 1, "capsize": 2.5}
            axes.errorbar(counts * shift, values, yerr=half, label=spoken(factor), **style)
            rows += [(factor, n, v, h) for n, v, h in zip(counts, values, half, strict=True)]
        axes.set_xscale("log", base=2)
        axes.set_xticks(counts, [f"{count:,}" for count in counts])
        axes.minorticks_off()
        axes.set_xlabel("samples used")
        axes.set_ylabel(f"index {index}")
        legend_above(axes, 2)
    data = pd.DataFrame(rows, columns=["factor", "samples", index, f"{index}_conf"])
    intervals = intervals_text(data[f"{index}_conf"], 100 * float(part.attrs.get("confidence_level", 0.95)))
    caption = (
        f"The index {index} of {what} from the first {listed([f'{count:,}' for count in counts])} samples{intervals} "
        f"(analysis {name}). The samples suffice where lines are level"
        f"{' and intervals short' if intervals else ''}."
    )
    return Chart(f"{key}-convergence", f"Convergence for {what}", caption, figure, data)


def rotation_charts(name: str, result: xr.Dataset) -> list[Chart]:
    """The index of each factor over the rotation angle, one chart for each waveform that has no further dimension."""
    index = RANKED[kind_of(result)]
    charts = []
    for key, values in result.data_vars.items():
        own = str(key) == index or str(key).endswith(f"_{index}")
        if not own or set(values.dims) != {"factor", "rotation_deg"} or not values.notnull().any():
            continue
        waveform = str(key).removesuffix(index).rstrip("_") or str(result.attrs["outputs"])
        charts.append(_rotation_chart(name, waveform, index, values.transpose("factor", "rotation_deg")))
    return charts


def _rotation_chart(name: str, waveform: str, index: str, values: xr.DataArray) -> Chart:
    order = np.argsort(-np.nan_to_num(values.mean("rotation_deg").values))[:_SHOWN]
    angle = values["rotation_deg"].values
    with drawing(6.0, 3.0) as (figure, axes):
        for rank, at in enumerate(order):
            label = spoken(str(values["factor"].values[at]))
            axes.plot(angle, values.values[at], color=COLOURS[rank], ls=LINES[rank], label=label)
        axes.set_xlabel("rotation angle (deg)")
        axes.set_ylabel(f"index {index}")
        axes.set_xlim(angle[0], angle[-1])
        legend_above(axes, 3)
    names = [str(factor) for factor in values["factor"].values[order]]
    data = pd.DataFrame({"rotation_deg": angle} | dict(zip(names, values.values[order], strict=True)))
    caption = f"The index {index} of {spoken(waveform)} at each rotation angle (analysis {name})."
    return Chart(
        f"{name}-{waveform}-rotation", f"Indices of {spoken(waveform)} over a revolution", caption, figure, data
    )
