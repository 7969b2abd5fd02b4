"""Outcomes of the points of a study: a map over a factor with names, such as the model, and a numeric one."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import level, number
from tripod_doe.page_parts.charts.chart import INK, Chart, drawing
from tripod_doe.page_parts.main_results import factor_names, numeric_factors, responses
from tripod_doe.page_parts.words import axis_label, spoken

_COLOURS = {Outcome.FINISHED: "#d6e6f5", Outcome.INACCURATE: "#f2c9ae", Outcome.OUT_OF_RANGE: "#e3e6ea"}
_FAILED = "#8b96a3"


def outcome_charts(cube: xr.Dataset) -> list[Chart]:
    """One chart per numeric factor, the others at their first values; cells show the first response or the outcome."""
    words = [name for name in factor_names(cube) if cube[name].dtype.kind not in "fiu"]
    shown = responses(cube)
    if len(words) != 1 or not shown:
        return []
    table = pd.DataFrame(
        {name: xr.broadcast(cube["outcome"], cube[name])[1].values.ravel() for name in factor_names(cube)}
        | {"outcome": cube["outcome"].values.ravel(), shown[0].key: shown[0].values.values.ravel()}
    )
    numeric = numeric_factors(cube)
    base = table.iloc[0]
    charts = []
    for factor in numeric:
        others = [name for name in numeric if name != factor]
        part = table[np.all([table[name] == base[name] for name in others], axis=0)] if others else table
        charts.append(_chart(cube, part[[words[0], factor, "outcome", shown[0].key]], shown[0].axis))
    return charts


def _chart(cube: xr.Dataset, part: pd.DataFrame, what: str) -> Chart:
    from matplotlib.patches import Patch

    word, factor = part.columns[:2]
    rows, levels = list(dict.fromkeys(part[word])), sorted(part[factor].unique())
    with drawing(1.6 + 0.62 * len(levels), 1.0 + 0.36 * len(rows)) as (figure, axes):
        for name, at, outcome, value in part.itertuples(index=False):
            x, y, ended = levels.index(at), rows.index(name), Outcome(int(outcome))
            axes.fill_between([x - 0.5, x + 0.5], y - 0.5, y + 0.5, fc=_COLOURS.get(ended, _FAILED), ec="white")
            text = number(float(value)) if np.isfinite(value) else ended.label.replace("_", "\n")
            axes.text(x, y, text, ha="center", va="center", fontsize=7 if np.isfinite(value) else 6, color=INK)
        axes.set_xlim(-0.5, len(levels) - 0.5)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xticks(range(len(levels)), [level(float(value)) for value in levels])
        axes.set_yticks(range(len(rows)), rows)
        axes.grid(visible=False)
        axes.set_xlabel(axis_label(cube, factor))
        ends = [Outcome(int(kind)) for kind in np.unique(part["outcome"])]
        handles = [Patch(fc=_COLOURS.get(kind, _FAILED), ec=INK, lw=0.4, label=kind.label) for kind in ends]
        figure.legend(handles=handles, loc="outside upper left", ncols=3, frameon=False)
    caption = f"Results for each {spoken(word)} over the {spoken(factor)}: {what}, or the outcome if it failed."
    return Chart(f"outcome-{factor}", f"Outcomes over the {spoken(factor)}", caption, figure, part)
