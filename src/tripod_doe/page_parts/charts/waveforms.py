"""The thrust force over the rotation angle, and its orders, at a few chosen points of a cube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.number_text import capital, count_of, number
from tripod_doe.page_parts.charts.chart import COLOURS, HATCHES, INK, LINES, Chart, drawing, legend_above
from tripod_doe.page_parts.main_results import finished, point_text

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_FLOOR = 1e-4  # bars of a spectrum end at this part of the largest one
_TINTS = ("#0b5394", "#f6d9c9", "#cfe6d8")
_FEW = 3  # up to this number, all finished points are shown


@dataclass(frozen=True)
class Chosen:
    """A point that is shown in full."""

    title: str  # why it was chosen, for instance ``largest third order``
    text: str  # its factors in words
    data: xr.Dataset  # its part of the cube


def chosen_points(cube: xr.Dataset) -> list[Chosen]:
    """The finished points with the smallest, the median and the largest third order."""
    if "thrust_amplitude" in cube:
        measure, what = cube["thrust_amplitude"].sel(order=3, drop=True), "third order"
    elif "thrust" in cube:
        measure, what = cube["thrust"].max("rotation_deg") - cube["thrust"].min("rotation_deg"), "peak to peak"
    else:
        return []
    values = measure.values.ravel()
    ranked = np.argsort(values, kind="stable")[: int(finished(cube).sum())]  # NaN sorts last
    ranked = ranked[np.isfinite(values[ranked])]
    if ranked.size == 0:
        return []
    picks = {"smallest": ranked[0], "median": ranked[(ranked.size - 1) // 2], "largest": ranked[-1]}
    if ranked.size == 1:
        picks = {"only": ranked[0]}
    elif ranked.size < _FEW:
        del picks["median"]
    chosen = []
    for rank, at in picks.items():
        index = np.unravel_index(int(at), measure.shape)
        point = cube.isel({str(dim): int(i) for dim, i in zip(measure.dims, index, strict=True)})
        chosen.append(Chosen(f"{rank} {what}: {number(float(values[at]))} N", point_text(cube, point), point))
    return chosen


def waveform_charts(cube: xr.Dataset) -> list[Chart]:
    """Thrust over the rotation angle at the chosen points: the sum and its part in each groove."""
    if "thrust" not in cube:
        return []
    charts = []
    for rank, chosen in enumerate(chosen_points(cube)):
        data = pd.DataFrame(
            {"rotation_deg": chosen.data["rotation_deg"].values, "thrust_n": chosen.data["thrust"].values}
        )
        if "groove_thrust" in chosen.data:
            for groove in chosen.data["groove"].values:
                data[f"groove_{groove}_thrust_n"] = chosen.data["groove_thrust"].sel(groove=groove).values
        with drawing(3.5, 2.9) as (figure, axes):
            _draw_waveform(axes, data)
        caption = f"At {chosen.text}." if chosen.text else "The only point of the study."
        charts.append(Chart(f"waveform-{rank + 1}", capital(chosen.title), caption, figure, data))
    return charts


def _draw_waveform(axes: Axes, data: pd.DataFrame) -> None:
    angle = data["rotation_deg"]
    for groove, column in enumerate(data.columns[2:]):
        axes.plot(
            angle, data[column], LINES[groove + 1], color=COLOURS[groove + 1], lw=1.1, label=f"groove {groove + 1}"
        )
    axes.plot(angle, data["thrust_n"], color=INK, lw=2.2, label="sum")
    axes.set_xlim(0, 720)
    axes.set_xticks(range(0, 721, 180))
    axes.set_xlabel("rotation angle of the housing (deg)")
    axes.set_ylabel("thrust force (N)")
    legend_above(axes, 2)


def spectrum_chart(cube: xr.Dataset) -> Chart | None:
    """Amplitudes of the orders 0 to 12: at the chosen points if waveforms are kept, else mean, smallest and largest."""
    if "thrust_amplitude" not in cube or not bool(finished(cube).any()):
        return None
    order = cube["order"].values
    if "thrust" in cube:
        points = chosen_points(cube)
        bars = {chosen.title: chosen.data["thrust_amplitude"].values for chosen in points}
        data = pd.DataFrame({"order": order} | {f"amplitude_n_{t.split()[0]}": v for t, v in bars.items()})
        spread = None
        caption = "Amplitudes of the rotating orders at the points shown above"
    else:
        amplitude = cube["thrust_amplitude"]
        design = [dim for dim in amplitude.dims if dim != "order"]
        mean, least, most = (getattr(amplitude, how)(design).values for how in ("mean", "min", "max"))
        bars, spread = {"mean over the study": mean}, (least, most)
        data = pd.DataFrame({"order": order, "mean_n": mean, "min_n": least, "max_n": most})
        count = count_of(int(finished(cube).sum()), "point")
        caption = f"Amplitudes of the rotating orders: mean (bars), smallest and largest (whiskers) of {count}"
    largest = max(float(values.max()) for values in bars.values())
    with drawing(4.7, 3.0) as (figure, axes):
        _draw_spectrum(axes, order, bars, spread, largest)
    caption += ". The axis is logarithmic and ends at 1/10,000 of the largest bar; smaller ones are not drawn."
    return Chart("spectrum", "Orders of the thrust force", caption, figure, data)


def _draw_spectrum(
    axes: Axes,
    order: IntArray,
    bars: dict[str, FloatArray],
    spread: tuple[FloatArray, FloatArray] | None,
    largest: float,
) -> None:
    width = 0.8 / len(bars)
    for which, (label, values) in enumerate(bars.items()):
        at = order + (which - (len(bars) - 1) / 2) * width
        axes.bar(
            at,
            values,
            width,
            label=label,
            color=_TINTS[which % 3] if spread is None else "#b9d0e8",
            edgecolor=COLOURS[which],
            hatch=HATCHES[which],
            lw=0.8,
        )
        if spread is not None:
            seen = spread[1] > 0
            low, high = np.maximum(spread[0][seen], 0), spread[1][seen]
            axes.vlines(at[seen], np.maximum(low, 1e-300), high, color=INK, lw=1.2, label="least to most")
            for end in (low, high):
                axes.scatter(at[seen], end, marker="_", color=INK, s=28, linewidths=1.2)
    axes.grid(axis="x", visible=False)
    if largest > 0:
        axes.set_yscale("log")
        top = largest if spread is None else float(spread[1].max())
        axes.set_ylim(_FLOOR * largest, 2 * top)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xticks(order)
    axes.set_xlabel("rotating order (-)")
    axes.set_ylabel("amplitude of the thrust force (N)")
    legend_above(axes, 2)
