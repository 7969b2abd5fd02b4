"""Heat maps: a variable over two dimensions, with a fixed range of colours; cells without a number are hatched."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.service.explorer.figures.elements import (
    FAILED_COLOUR,
    NUMBER,
    SEQUENTIAL,
    WAITING_COLOUR,
    Figure,
    axis,
    blank_marks,
    blank_reasons,
    colour_bar,
    edges,
    is_failed,
    label_of,
    packed,
    point_numbers,
    shown,
)

_MOST_CROSSES = 2000
_MOST_NAMED = 4000  # cells; more would need more bytes for tooltips than for numbers


def heat_map(data: xr.Dataset, x: str, y: str, limits: tuple[float, float] | None = None) -> Figure:
    """Draw a variable as colours over two dimensions.

    Args:
        data: The variable first, over `x` and `y`; then the outcome and its detail, which mark cells without a number:
            hatched if the point failed, grey dots if it is still to come.
        limits: Values at both ends of the colours, so that all slices share them; without them, the range of the
            data.

    Returns:
        A figure for Plotly.
    """
    data = data.transpose(..., y, x)
    variable = shown(data)
    low, high = limits or _limits(variable.values)
    places = {name: _places(data[name]) for name in (x, y)}
    cells: dict[str, Any] = {
        "type": "heatmap",
        "x": packed(edges(*places[x])),
        "y": packed(edges(*places[y])),
        "z": packed(variable.values.astype(float)),
        "zmin": low,
        "zmax": high,
        "colorscale": _scale(low, high),
        "hoverongaps": False,
        "colorbar": colour_bar(label_of(variable)),
        "hovertemplate": "%{x:.4~g}, %{y:.4~g}: <b>%{z:.4~g}</b><extra></extra>",
    }
    if variable.size <= _MOST_NAMED:
        cells |= {"hovertemplate": "%{text}: <b>%{z:.4~g}</b><extra></extra>", "text": _names(data, x, y)}
    traces = [cells]
    if NUMBER in data.coords and ("outcome" not in data or set(data["outcome"].dims) == {x, y}):
        cells["customdata"] = packed(point_numbers(data).values)
    if "outcome" in data and set(data["outcome"].dims) == {x, y}:
        traces += _blanks(data, places[x], places[y])
    axes = [axis(data[name]) | _ticks(data[name]) for name in (x, y)]
    return {"data": traces, "layout": {"xaxis": axes[0] | {"showgrid": False}, "yaxis": axes[1] | {"showgrid": False}}}


def _limits(values: NDArray[Any]) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)


def _scale(low: float, high: float) -> list[list[Any]] | str:
    """Shades from dark to light, or two colours that meet at zero if the numbers have both signs."""
    if low < 0 < high:
        middle = -low / (high - low)
        return [
            [0, "#2166ac"],
            [middle / 2, "#8ab8d8"],
            [middle, "#e8e8e6"],
            [(1 + middle) / 2, "#e3a587"],
            [1, "#b2402b"],
        ]
    return [list(stop) for stop in SEQUENTIAL]


def _places(coordinate: xr.DataArray) -> tuple[FloatArray, bool]:
    """Places of the levels along an axis, and whether it is logarithmic; words and unordered numbers get 0, 1, 2."""
    values = coordinate.values
    if not _is_ordered(values):
        return np.arange(values.size, dtype=float), False
    return values.astype(float), axis(coordinate)["type"] == "log"


def _is_ordered(values: NDArray[Any]) -> bool:
    return values.dtype.kind in "fiu" and bool((np.diff(values) > 0).all())


def _ticks(coordinate: xr.DataArray) -> dict[str, Any]:
    """Ticks at the levels if these are words, or few."""
    values = coordinate.values
    if not _is_ordered(values):
        return {"type": "linear", "tickvals": list(range(values.size)), "ticktext": [str(value) for value in values]}
    return {"tickvals": values.tolist()} if values.size <= 8 else {}


def _names(data: xr.Dataset, x: str, y: str) -> list[list[str]]:
    """Tooltips of the cells."""
    labels = {name: label_of(data[name]) for name in (x, y)}
    across, up = ([f"{labels[name]} {_word(value)}" for value in data[name].values.tolist()] for name in (x, y))
    return [[f"{right}, {top}" for right in across] for top in up]


def _word(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _blanks(data: xr.Dataset, x: tuple[FloatArray, bool], y: tuple[FloatArray, bool]) -> list[Any]:
    """Hatching and a mark with the reason for each cell without a number."""
    reasons, failed, numbers = blank_reasons(data), is_failed(data).values, point_numbers(data).values
    kinds = ((failed, "/", FAILED_COLOUR), ((reasons != "") & ~failed, ".", WAITING_COLOUR))
    traces: list[Any] = []
    for rows, shape, colour in kinds:
        if rows.any():
            up, across = np.nonzero(rows)
            few, size = slice(None, _MOST_CROSSES), 5 if up.size > 200 else 8
            reason, number = reasons[rows].tolist()[few], numbers[rows][few]
            marks = blank_marks(x[0][across][few], y[0][up][few], reason, number, shape == "/", size)
            traces += [_hatching(edges(*x), edges(*y), across, up, shape, colour), marks]
    return traces


def _hatching(left: FloatArray, bottom: FloatArray, across: IntArray, up: IntArray, shape: str, colour: str) -> Any:
    """Outlines of cells, each closed and followed by a gap, filled with a pattern."""
    corners = np.full((up.size, 6), np.nan)
    heights = corners.copy()
    corners[:, :5] = left[np.stack([across, across + 1, across + 1, across, across], 1)]
    heights[:, :5] = bottom[np.stack([up, up, up + 1, up + 1, up], 1)]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": packed(corners.ravel()),
        "y": packed(heights.ravel()),
        "fill": "toself",
        "line": {"width": 0, "color": colour},
        "hoverinfo": "skip",
        "showlegend": False,
        "fillpattern": {"shape": shape, "fgcolor": colour, "bgcolor": "rgba(0,0,0,0)", "size": 6, "solidity": 0.25},
        "fillcolor": colour,
    }
