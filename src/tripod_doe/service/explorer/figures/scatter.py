"""Scatter plots: one quantity over another, one mark per point, or the density of many points."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.service.explorer.figures.elements import (
    FOOT_AXIS,
    NUMBER,
    SEQUENTIAL,
    Figure,
    axis,
    blank_reasons,
    colour_bar,
    foot_marks,
    is_failed,
    label_of,
    packed,
    point_numbers,
    shown,
)

_MOST = 4000  # points that a browser draws without delay, and a reader can distinguish
_CELLS = 60


def scatter(data: xr.Dataset, x: str, colour: str | None = None) -> Figure:
    """Draw a variable over another quantity, one mark per point.

    Args:
        data: The variable first, over the dimensions of the design; then the outcome and its detail.

    Returns:
        A figure for Plotly; above 4000 points it shows their density.
    """
    variable = shown(data)
    across = data[x].broadcast_like(variable).transpose(*variable.dims)
    places, heights = across.values.ravel(), variable.values.ravel().astype(float)
    known = np.isfinite(heights)
    layout = {
        "xaxis": axis(data[x]),
        "yaxis": {"title": {"text": label_of(variable)}, "automargin": True},
        "yaxis2": FOOT_AXIS,
        "showlegend": False,
    }
    if int(known.sum()) > _MOST and places.dtype.kind in "fiu":
        return {
            "data": [_density(places[known].astype(float), heights[known]), *_crosses(data, places)],
            "layout": layout,
        }
    numbers = np.full(heights.shape, -1)
    if NUMBER in data.coords:
        numbers = point_numbers(data).broadcast_like(variable).transpose(*variable.dims).values.ravel()
    marker: dict[str, Any] = {"size": 7 if known.sum() < 400 else 5, "opacity": 0.85}
    hover = "%{x}: <b>%{y:.4~g}</b>"
    if colour:
        values = data[colour].broadcast_like(variable).transpose(*variable.dims).values.ravel()[known]
        marker |= _colours(values, label_of(data[colour]))
        hover += f"<br>{label_of(data[colour])} %{{text}}"
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": packed(places[known]),
        "y": packed(heights[known]),
        "customdata": packed(numbers[known]),
        "marker": marker,
        "hovertemplate": hover + "<extra></extra>",
    }
    if colour:
        trace["text"] = [f"{value:.6g}" if isinstance(value, float) else str(value) for value in values.tolist()]
    return {"data": [trace, *_crosses(data, places)], "layout": layout}


def _colours(values: NDArray[Any], label: str) -> dict[str, Any]:
    if values.dtype.kind not in "fiub":
        known, which = np.unique(values.astype(str), return_inverse=True)
        ticks = {"tickvals": list(range(known.size)), "ticktext": known.tolist()}
        return _colours(which.astype(float), label) | {"colorbar": colour_bar(label) | ticks}
    return {
        "color": packed(values.astype(float)),
        "colorscale": [list(stop) for stop in SEQUENTIAL],
        "colorbar": colour_bar(label),
        "line": {"width": 0.5, "color": "#8b96a3"},
    }


def _density(places: FloatArray, heights: FloatArray) -> dict[str, Any]:
    counts, right, top = np.histogram2d(places, heights, bins=_CELLS)
    shade = np.where(counts > 0, np.log10(np.maximum(counts, 1)), np.nan).T
    powers = {"tickvals": [0, 1, 2, 3, 4, 5], "ticktext": ["1", "10", "100", "1k", "10k", "100k"]}
    return {
        "type": "heatmap",
        "x": packed(right),
        "y": packed(top),
        "z": packed(shade),
        "text": counts.T.astype(int).tolist(),
        "colorscale": [list(stop) for stop in SEQUENTIAL],
        "hoverongaps": False,
        "hovertemplate": "%{text} points near %{x:.4~g}, %{y:.4~g}<extra></extra>",
        "colorbar": colour_bar("points") | powers,
    }


def _crosses(data: xr.Dataset, places: NDArray[Any]) -> list[dict[str, Any]]:
    """Failed points at the foot of the axes, with their reason."""
    if "outcome" not in data or data["outcome"].size != places.size:
        return []
    failed = is_failed(data).values.ravel()
    if not failed.any():
        return []
    few, numbers = slice(None, _MOST), point_numbers(data).values.ravel()
    reasons = blank_reasons(data).ravel()[failed].tolist()
    return [foot_marks(places[failed][few], reasons[few], numbers[failed][few], failed=True)]
