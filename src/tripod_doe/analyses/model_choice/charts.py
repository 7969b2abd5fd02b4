"""Which model answers where in a study whose models a pilot chose, and the error that it estimates there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd
import xarray as xr

from tripod_doe.page_parts.charts.chart import COLOURS, INK, MARKERS, Chart, legend_above, panels
from tripod_doe.page_parts.chosen_models import chosen_models, estimated_errors, is_chosen
from tripod_doe.page_parts.main_results import asked, numeric_factors
from tripod_doe.page_parts.words import axis_label, spoken

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ERRORS = "estimated error over the allowed one (%)"


def model_choice_chart(cube: xr.Dataset) -> Chart | None:
    """Models and estimated errors over the first two numeric factors; None without a pilot or a varying factor."""
    factors = numeric_factors(cube)[:2]
    if not is_chosen(cube) or not factors:
        return None
    inside = asked(cube).values.ravel()
    places = {name: xr.broadcast(cube["outcome"], cube[name])[1].values.ravel()[inside] for name in factors}
    data = pd.DataFrame(places | {"model": chosen_models(cube).ravel()[inside]})
    share = 100 * estimated_errors(cube).ravel()[inside]
    data["estimated_error_percent_of_allowed"] = share
    if len(factors) == 1:
        figure = _over_one(data, axis_label(cube, factors[0]))
    else:
        figure = _over_two(data, axis_label(cube, factors[0]), axis_label(cube, factors[1]))
    more = "; points that differ in other factors lie on each other" if len(numeric_factors(cube)) > 2 else ""
    return Chart(
        "model-choice",
        "Which model answers where",
        f"Model that answers at each point, and the largest error that the pilot estimates for what was asked, over "
        f"{' and '.join(spoken(name) for name in factors)}{more}. Above 100 % the accuracy is not expected to be met.",
        figure,
        data,
    )


def _over_one(data: pd.DataFrame, across: str) -> Figure:
    """One panel: estimated error over the only factor, a marker per model."""
    with panels(1, 1, 4.7, 3.0) as (figure, (axes,)):
        shown = data["estimated_error_percent_of_allowed"].fillna(0.0)
        _draw_models(axes, data, shown)
        axes.axhline(100, color=INK, lw=0.8, ls="--")
        axes.set_xlabel(across)
        axes.set_ylabel(_ERRORS)
        axes.set_ylim(bottom=0)
    return figure


def _over_two(data: pd.DataFrame, across: str, up: str) -> Figure:
    """Two panels over two factors: markers of the models, and shades of the estimated error."""
    with panels(2, 2, 3.7, 3.0) as (figure, (models, errors)):
        _draw_models(models, data, data.iloc[:, 1])
        known = data[data["estimated_error_percent_of_allowed"].notna()]
        shades = errors.scatter(
            known.iloc[:, 0], known.iloc[:, 1], c=known["estimated_error_percent_of_allowed"], s=14, cmap="cividis_r"
        )
        if len(known):
            figure.colorbar(shades, ax=errors, label=_ERRORS)
        models.set_ylabel(up)
        for axes in (models, errors):
            axes.set_xlabel(across)
    return figure


def _draw_models(axes: Axes, data: pd.DataFrame, heights: pd.Series[float]) -> None:
    for which, (model, rows) in enumerate(data.groupby("model", sort=False)):
        axes.scatter(
            rows.iloc[:, 0],
            heights[rows.index],
            marker=MARKERS[which % len(MARKERS)],
            s=14,
            color=COLOURS[which % len(COLOURS)],
            label=f"{model} ({len(rows):,})",
        )
    legend_above(axes, 2)
