"""Distribution of an output by several models, and their gain over the most expensive one alone."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.multifidelity.sentences import multifidelity_parts
from tripod_doe.analyses.tolerance.charts import quantile_chart
from tripod_doe.page_parts.charts.chart import COLOURS, MUTED, Chart, drawing
from tripod_doe.page_parts.main_outputs import OutputPart
from tripod_doe.page_parts.words import spoken


def multifidelity_charts(result: xr.Dataset, name: str) -> list[Chart]:
    """Quantiles of each main output, and the squared errors relative to the squared errors of the truth alone."""
    charts, truth = [], str(result.attrs["truth"])
    for position, part in enumerate(multifidelity_parts(result), 1):
        key = f"{name}-{position}"
        charts.append(quantile_chart(f"{key}-quantiles", name, part))
        if np.isfinite(part.answers["gain"]):
            charts.append(_gain_chart(f"{key}-gain", name, part, truth))
    return charts


def _gain_chart(key: str, name: str, part: OutputPart, truth: str) -> Chart:
    answers = part.answers
    rows = [("mean", float(answers["gain"])), ("variance", float(answers["variance_gain"]))]
    for index in ("S1", "ST"):
        if f"{index}_gain" in answers:
            pairs = zip(answers["factor"].values, answers[f"{index}_gain"].values, strict=True)
            rows += [(f"{index}, {spoken(str(factor))}", float(gain)) for factor, gain in pairs]
    data = pd.DataFrame(rows, columns=["quantity", "gain"]).dropna(ignore_index=True)
    data["squared_error"] = 1 / data["gain"]
    places = np.arange(len(data))[::-1]
    with drawing(5.0, 1.0 + 0.24 * len(data)) as (figure, axes):
        axes.plot(data["squared_error"], places, "o", color=COLOURS[0])
        axes.axvline(1, color=MUTED, lw=1, ls="--")
        axes.set_xscale("log")
        axes.set_yticks(places, data["quantity"])
        axes.set_xlabel(f"squared error relative to {truth} alone")
    caption = (
        f"Squared error of the answers on {part.what}, over the error of {truth} alone at the same price (analysis "
        f"{name}). Left of the dashed line, the cheaper models reduce the error."
    )
    return Chart(key, f"What the cheaper models gain for {part.what}", caption, figure, data)
