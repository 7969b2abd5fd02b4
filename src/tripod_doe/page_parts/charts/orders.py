"""Points with error bars, a colour and a marker for each order of the thrust."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.page_parts.charts.chart import INK, MUTED, drawing, legend_above, series
from tripod_doe.page_parts.words import ORDINALS, spoken, unit_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_orders(axes: Axes, data: pd.DataFrame, x: str, y: str, y_error: str, x_error: str | None = None) -> None:
    """Draw a column over another column, with their error columns."""
    for which, (order, own) in enumerate(data.groupby("order")):
        axes.errorbar(
            own[x],
            own[y],
            xerr=own[x_error] if x_error else None,
            yerr=own[y_error].fillna(0),
            elinewidth=0.8,
            label=ORDINALS[int(str(order))],
            **series(which) | {"ls": "none"},
        )


def agreement(data: pd.DataFrame, computed: str, computed_error: str, left_out: pd.DataFrame) -> Figure:
    """Computed amplitudes over the columns `measured` and `measured_error`, with the line of agreement."""
    with drawing(4.7, 3.4) as (figure, axes):
        draw_orders(axes, data, "measured", computed, computed_error, "measured_error")
        if len(left_out):
            axes.plot(left_out["measured"], left_out[computed], "x", color=INK, ms=8, label="left out")
        end = float(np.nanmax(data[["measured", computed]].to_numpy()))
        axes.axline((0, 0), (end, end), color=MUTED, lw=0.8)
        axes.set_xlabel("measured amplitude (N)")
        axes.set_ylabel(f"{computed} amplitude (N)")
        legend_above(axes, 3)
    return figure


def differences(data: pd.DataFrame, parameter: str, difference: str, label: str) -> Figure:
    """Differences, with the column `uncertainty`, over the column of a parameter of the joint."""
    with drawing(4.7, 2.9) as (figure, axes):
        draw_orders(axes, data, parameter, difference, "uncertainty")
        axes.axhline(0, color=MUTED, lw=0.8)
        axes.set_xlabel(f"{spoken(parameter)} ({unit_text(JOINT_PARAMETERS[parameter].unit)})")
        axes.set_ylabel(label)
        legend_above(axes, 3)
    return figure
