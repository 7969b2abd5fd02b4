"""Distribution of an output under manufacturing scatter, and what halving the scatter of each factor gains."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.tolerance.sentences import tolerance_parts
from tripod_doe.number_text import chance_in_percent
from tripod_doe.page_parts.charts.chart import COLOURS, INK, MUTED, Chart, drawing, legend_above
from tripod_doe.page_parts.main_outputs import OutputPart
from tripod_doe.page_parts.words import spoken
from tripod_doe.phases import shorter_way


def tolerance_charts(result: xr.Dataset, name: str) -> list[Chart]:
    """Two charts per main output: gains, and quantiles with the limit."""
    return [
        chart
        for position, part in enumerate(tolerance_parts(result), 1)
        for chart in (
            _gain_chart(f"{name}-{position}-gain", name, part.what, part.answers),
            quantile_chart(f"{name}-{position}", name, part),
        )
    ]


def quantile_chart(key: str, name: str, output: OutputPart) -> Chart:
    """The distribution of one output, quantiles with their intervals, and the limit if set."""
    what, unit, part = output.what, output.unit, output.answers
    columns = ("quantile", "quantile_low", "quantile_high")
    asked = pd.DataFrame({"probability": part["probability"].values} | {key: part[key].values for key in columns})
    limited = "limit" in part and bool(np.isfinite(part["limit"]))
    below, above = asked["quantile"] - asked["quantile_low"], asked["quantile_high"] - asked["quantile"]
    data = _with_curve(asked, part)
    with drawing(5.0, 2.8) as (figure, axes):
        axes.plot(data["quantile"], 100 * data["probability"], color=COLOURS[0], label="stays below")
        axes.errorbar(
            asked["quantile"],
            100 * asked["probability"],
            xerr=[below.fillna(0), above.fillna(0)],
            fmt="o",
            color=COLOURS[0],
            ecolor=INK,
            elinewidth=1.1,
            capsize=2.5,
        )
        if limited:
            limit = shorter_way(part["limit"] - part["mean"]) if output.is_phase else part["limit"]
            axes.axvline(float(limit), color=COLOURS[1], ls="--", label="limit")
        relative = " from its mean" * output.is_phase
        axes.set_xlabel(f"{what.removeprefix('the ')}{relative}{f' ({unit})' if unit else ''}")
        axes.set_ylabel("share of the joints (%)")
        legend_above(axes, 2)
    chance = f" {chance_in_percent(float(part['exceedance']))} % exceed the limit." if limited else ""
    level = f"{100 * float(part.attrs['confidence_level']):g} %"
    text = f"Share of the joints in which {what} stays below a value, with {level} intervals (analysis {name})."
    return Chart(key, f"Distribution of {what}", text + chance, figure, data)


def _with_curve(asked: pd.DataFrame, part: xr.Dataset) -> pd.DataFrame:
    """Further quantiles between the requested quantiles, without intervals, to draw the curve."""
    curve = pd.DataFrame({"probability": part["share"].values, "quantile": part["distribution"].values})
    data = pd.concat([asked, curve[~curve["probability"].isin(asked["probability"])]])
    return data.sort_values("probability", ignore_index=True)


def _gain_chart(key: str, name: str, what: str, part: xr.Dataset) -> Chart:
    columns = ("gain_of_halving", "gain_of_halving_conf")
    data = pd.DataFrame({"factor": part["factor"].values} | {key: part[key].values for key in columns}).dropna()
    data = data.sort_values("gain_of_halving", ascending=False, kind="stable", ignore_index=True)
    rows = np.arange(len(data))[::-1]
    with drawing(5.0, 1.0 + 0.3 * max(len(data), 1)) as (figure, axes):
        axes.barh(rows, 100 * data["gain_of_halving"], 0.6, color="#b9d0e8", edgecolor=COLOURS[0], lw=0.8)
        axes.errorbar(
            100 * data["gain_of_halving"],
            rows,
            xerr=100 * data["gain_of_halving_conf"],
            fmt="none",
            ecolor=INK,
            elinewidth=1.1,
            capsize=2.5,
        )
        axes.set_yticks(rows, [spoken(str(factor)) for factor in data["factor"]])
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel("reduction of the standard deviation (%)")
    level = 100 * float(part.attrs.get("confidence_level", 0.95))
    caption = (
        f"Reduction of the standard deviation of {what} if the scatter of one factor is halved, with {level:g} % "
        f"intervals (analysis {name})."
    )
    return Chart(key, f"Which scatter to halve first, for {what}", caption, figure, data)
