"""Figures of one point: its quantities over the rotation, its spectrum, and the shares of its mechanisms."""

from typing import Any

import xarray as xr

from tripod_doe.service.explorer.figures.elements import Figure, axis, label_of, packed, plain
from tripod_doe.service.explorer.figures.lines import lines

_SHARED = 4  # most curves in one pair of axes


def point_figures(point: xr.Dataset) -> dict[str, Figure]:
    """All figures of one point.

    Args:
        point: The variables of a cube at one point; only the dimensions of the outputs are left.

    Returns:
        Figures for Plotly by the name of their variable: lines over measured dimensions, such as the rotation angle,
        and bars over counted dimensions, such as orders or mechanisms.
    """
    figures = {}
    for name, variable in point.data_vars.items():
        if variable.dtype.kind != "f" or not variable.dims or not bool(variable.notnull().any()):
            continue
        *others, along = variable.dims
        if str(name).endswith(("_error", "_scatter")) or len(others) > 1:
            continue
        companions = [str(name), *(other for other in (f"{name}_error",) if other in point)]
        data = point[companions]
        if data[along].dtype.kind == "f":
            figures[str(name)] = lines(data, str(along), str(others[0]) if others else None)
        elif not others or data.sizes[others[0]] <= _SHARED:
            figures[str(name)] = bars(data, str(along), str(others[0]) if others else None)
        else:
            figures[str(name)] = bars(
                data.transpose(along, others[0]), str(others[0]), None if not others else str(along)
            )
    return {name: plain(figure) for name, figure in figures.items()}


def bars(data: xr.Dataset, x: str, series: str | None = None) -> Figure:
    """Draw a variable as bars over a counted dimension, with its error ``VARIABLE_error`` if known."""
    variable = data[next(iter(data.data_vars))]
    rows = [data] if series is None else [data.isel({series: at}) for at in range(min(data.sizes[series], 13))]
    traces = []
    for row in rows:
        drawn = row[str(variable.name)]
        name = (
            ""
            if series is None
            else str(row[series].item())
            if row[series].dtype.kind == "U"
            else f"{series} {row[series].item()}"
        )
        trace: dict[str, Any] = {
            "type": "bar",
            "name": name,
            "x": packed(data[x].values),
            "y": packed(drawn.values.astype(float)),
            "hovertemplate": f"{x} %{{x}}: <b>%{{y:.4~g}}</b><extra>{name}</extra>",
        }
        if f"{variable.name}_error" in row:
            error = packed(row[f"{variable.name}_error"].values)
            trace["error_y"] = {"type": "data", "array": error, "thickness": 1, "width": 3}
        traces.append(trace)
    labels = [str(value).replace("_", " ") for value in data[x].values.tolist()]
    ticks = {"tickvals": data[x].values.tolist(), "ticktext": labels} if len(labels) <= 16 else {}
    return {
        "data": traces,
        "layout": {
            "xaxis": axis(data[x]) | ticks,
            "yaxis": {"title": {"text": label_of(variable)}, "automargin": True},
            "barmode": "group",
            "showlegend": len(traces) > 1,
        },
    }
