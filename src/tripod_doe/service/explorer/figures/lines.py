"""Lines: a variable over one dimension, one line per value of another, with known numerical errors."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.model_interface import ZERO_AT
from tripod_doe.service.explorer.figures.elements import (
    FOOT_AXIS,
    NUMBER,
    Figure,
    axis,
    blank_reasons,
    colour_bar,
    foot_marks,
    is_failed,
    label_of,
    level_texts,
    packed,
    point_numbers,
    ramp,
    shown,
)

_NAMED = 8  # lines that a legend can distinguish; more lines get shades of one scale
_MARKED = 60  # points of a line above which it is drawn without markers
_MOST = 200
_WHOLE_TURN = 360.0


def lines(data: xr.Dataset, x: str, series: str | None = None) -> Figure:
    """Draw a variable over a dimension.

    Args:
        data: The variable first, over `x` and perhaps `series`; then its error as ``VARIABLE_error``, and the outcome
            and its detail, which mark points without a number at the foot of the axes, with their reason.
        x, series: Names of dimensions; one line per value of `series`, at most 200.

    Returns:
        A figure for Plotly.
    """
    variable = shown(data)
    rows = [data] if series is None else [data.isel({series: at}) for at in range(min(data.sizes[series], _MOST))]
    names = [""] if series is None else level_texts(data[series])[:_MOST]
    numeric = series is not None and data[series].dtype.kind in "fiu"
    colours: list[str | None] = list(ramp(len(rows))) if numeric and len(rows) > 3 else [None] * len(rows)
    traces = [_line(row, x, name, colour, len(rows)) for row, name, colour in zip(rows, names, colours, strict=True)]
    traces += _marks(rows, x, names)
    layout: dict[str, Any] = {
        "xaxis": axis(data[x]) | _turns(data[x]),
        "yaxis": {"title": {"text": label_of(variable)}, "automargin": True},
        "yaxis2": FOOT_AXIS,
        "showlegend": 1 < len(rows) <= _NAMED,
        "legend": {"title": {"text": label_of(data[series])} if numeric else {}},
    }
    if numeric and len(rows) > _NAMED:
        traces.append(_scale(data[str(series)]))
    return {"data": traces, "layout": layout}


def _line(data: xr.Dataset, x: str, name: str, colour: str | None, count: int) -> dict[str, Any]:
    variable = shown(data)
    few = data.sizes[x] <= _MARKED
    gap = _known_zero(variable, x)

    def along(values: NDArray[Any]) -> Any:
        return packed(values if gap is None else np.insert(values.astype(float), gap, np.nan, axis=-1))

    trace: dict[str, Any] = {
        "type": "scatter",
        "mode": "lines+markers" if few else "lines",
        "name": name,
        "x": along(data[x].values),
        "y": along(variable.values.astype(float)),
        "hovertemplate": "%{x}: <b>%{y:.4~g}</b>" + (f"<br>{name}" if name else "") + "<extra></extra>",
    }
    if colour:
        trace |= {"line": {"color": colour}, "marker": {"color": colour}}
    if NUMBER in data.coords:
        trace["customdata"] = along(np.broadcast_to(point_numbers(data).values, variable.shape))
    error = f"{variable.name}_error"
    if error in data and few and count <= _NAMED:
        trace["error_y"] = {"type": "data", "array": along(data[error].values), "thickness": 1, "width": 4}
    return trace


def _known_zero(variable: xr.DataArray, x: str) -> int | None:
    """Place of a gap in a line: at a factor's zero, between two computed values, if the variable is zero there."""
    if x not in str(variable.attrs.get(ZERO_AT, "")).split():
        return None
    levels = variable[x].values
    if 0 in levels or not levels.min() < 0 < levels.max() or (np.diff(levels) < 0).any():
        return None
    return int(np.searchsorted(levels, 0))


def _marks(rows: list[xr.Dataset], x: str, names: list[str]) -> list[dict[str, Any]]:
    """Points without a number, at the foot of the axes: crosses for failed points, rings for points still to come.

    Lines that fail at the same place share a mark, which names the first of them.
    """
    if "outcome" not in rows[0] or rows[0]["outcome"].dims != (x,):
        return []
    reasons = np.stack([blank_reasons(row) for row in rows])
    failed = np.stack([is_failed(row).values for row in rows])
    numbers = np.stack([point_numbers(row).values for row in rows])
    marks = []
    for blank, are_failed in ((failed, True), ((reasons != "") & ~failed, False)):
        at = np.flatnonzero(blank.any(axis=0))
        if not at.size:
            continue
        first, count = blank[:, at].argmax(axis=0), blank[:, at].sum(axis=0)
        texts = [
            (f"{names[line]}: " if names[line] else "")
            + reasons[line, place]
            + (f"<br>and {n - 1} more" if n > 1 else "")
            for line, place, n in zip(first.tolist(), at.tolist(), count.tolist(), strict=True)
        ]
        marks.append(foot_marks(rows[0][x].values[at], texts, numbers[first, at], are_failed))
    return marks


def _turns(coordinate: xr.DataArray) -> dict[str, Any]:
    """Ticks at quarter turns along an angle of rotation."""
    values = coordinate.values
    if str(coordinate.attrs.get("units")) != "degree" or values.dtype.kind != "f" or np.ptp(values) < _WHOLE_TURN - 1:
        return {}
    return {"dtick": 90 if np.ptp(values) < 1.5 * _WHOLE_TURN else 180, "tick0": 0}


def _scale(coordinate: xr.DataArray) -> dict[str, Any]:
    """A colour bar in place of a legend too long to read."""
    values = coordinate.values.astype(float)[:_MOST]
    colours = ramp(9)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [None],
        "y": [None],
        "showlegend": False,
        "hoverinfo": "skip",
        "marker": {
            "color": [float(values.min())],
            "cmin": float(values.min()),
            "cmax": float(values.max()),
            "showscale": True,
            "colorscale": [[at / 8, colour] for at, colour in enumerate(colours)],
            "colorbar": colour_bar(label_of(coordinate)),
        },
    }
