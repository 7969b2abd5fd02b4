"""The claims of the paper: how far each number lies inside or outside the limit that decides its claim."""

import math

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.claims.verdicts import Verdict
from tripod_doe.page_parts.charts.chart import COLOURS, INK, MUTED, Chart, drawing, name_rows
from tripod_doe.page_parts.words import spoken

_BARS = {Verdict.HOLDS: COLOURS[0], Verdict.DOES_NOT_HOLD: COLOURS[1]}


def claims_charts(claims: xr.Dataset, name: str = "") -> list[Chart]:
    """The only chart of the claims, as a figure."""
    return [claims_chart(claims)]


def claims_chart(claims: xr.Dataset) -> Chart:
    """One bar per claim, to the right where it holds and to the left where it does not; cut off at 100 %."""
    from matplotlib.patches import Patch

    verdicts = [Verdict(int(code)) for code in claims["verdict"].values]
    numbers = zip(*(claims[name].values.tolist() for name in ("value", "low", "high")), strict=True)
    margin = np.array([_margin(*row) for row in numbers])
    data = pd.DataFrame(
        {
            "claim": claims["claim"].values,
            "verdict": [verdict.label for verdict in verdicts],
            "margin_percent": 100 * margin,
        }
    )
    rows = np.arange(len(data))[::-1]
    with drawing(5.8, 0.75 + 0.165 * len(data)) as (figure, axes):
        for row, verdict, size in zip(rows, verdicts, np.clip(100 * margin, -100, 100), strict=True):
            if verdict in _BARS:
                axes.barh(row, size, 0.62, color=_BARS[verdict])
            else:
                axes.text(0, row, " not decided", va="center", fontsize=6.5, color=MUTED)
        axes.axvline(0, color=INK, lw=1)
        axes.set_xlim(-104, 104)
        axes.set_ylim(-0.7, len(data) - 0.3)
        name_rows(axes, rows, [spoken(str(name)) for name in data["claim"]], 7.5)
        axes.set_xlabel("distance from the limit (%)")
        handles = [Patch(color=colour, label=verdict.label) for verdict, colour in _BARS.items()]
        figure.legend(handles=handles, loc="outside upper right", ncols=2)
    caption = (
        "Right: the claim holds. Distance of its number from the nearest limit in percent of that limit, or of half "
        "the distance between two limits; cut off at 100 %."
    )
    return Chart("claims", "Each claim against its limit", caption, figure, data)


def _margin(value: float, low: float, high: float) -> float:
    """Distance inside the nearest limit, negative outside, relative to the limit or to half the allowed range."""
    if not math.isfinite(value):
        return math.nan
    if math.isfinite(low) and math.isfinite(high):
        inside, scale = min(value - low, high - value), (high - low) / 2
    else:
        inside, scale = (value - low, abs(low)) if math.isfinite(low) else (high - value, abs(high))
    return inside / scale if scale > 0 else math.copysign(1.0, inside)
