"""Courses of the main outputs over each factor by a surrogate, with its bands."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.surrogate.what_if_page import WhatIfPage, what_if_pages
from tripod_doe.page_parts.charts.chart import COLOURS, LINES, Chart, drawing, legend_above
from tripod_doe.page_parts.words import spoken

_SHOWN = 6  # factors in one picture


def surrogate_charts(result: xr.Dataset, name: str) -> list[Chart]:
    """One chart for each quantity of which a surrogate predicts most of the variance."""
    return [
        _course_chart(f"{page.name}-course-{position + 1}", page, position)
        for page in what_if_pages({name: result})
        for position, quantity in enumerate(page.quantities)
        if quantity.known
    ]


def _course_chart(key: str, page: WhatIfPage, position: int) -> Chart:
    quantity = page.quantities[position]
    numeric = [name for name, factor in page.surrogate.factors.items() if "words" not in factor]
    courses = {name: page.along(name) for name in numeric}
    spans = sorted(
        numeric,
        key=lambda name: -float(np.nanmax(courses[name][1][:, position]) - np.nanmin(courses[name][1][:, position])),
    )[:_SHOWN]
    rows = []
    half = page.at(**page.start)[position][1]
    with drawing(5.0, 3.2) as (figure, axes):
        for rank, name in enumerate(spans):
            values, course = courses[name][0], courses[name][1][:, position]
            place, levels = 100 * (values - values[0]) / (np.ptp(values) or 1), page.surrogate.factors[name]["levels"]
            style = {"marker": "o", "ls": ""} if levels else {"ls": LINES[rank]}  # nothing is known between them
            axes.plot(place, course, color=COLOURS[rank], label=spoken(name), **style)
            rows += [(name, value, answer) for value, answer in zip(values, course, strict=True) if np.isfinite(answer)]
        axes.axhspan(*(page.at(**page.start)[position][0] + half * np.array([-1, 1])), color="#cfdeee", lw=0)
        axes.set_xlabel("factor, from the least (0) to the largest (100 %) of the points")
        axes.set_ylabel(f"{quantity.label}{f' ({quantity.unit})' if quantity.unit else ''}")
        legend_above(axes, 2)
    data = pd.DataFrame(rows, columns=["factor", "value", quantity.label.replace(" ", "_")])
    caption = (
        f"By a surrogate of {page.points:,} computed points, not by a model (analysis {page.name}): {quantity.label} "
        f"over each factor alone, {page.held}. Shaded: its band there."
    )
    what = quantity.label
    return Chart(key, f"{what[0].upper()}{what[1:]} by the surrogate", caption, figure, data)
