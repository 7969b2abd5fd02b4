"""Shares of the mechanisms as signed stacked bars: by definition, or over the operating points."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tripod_doe.report.contributions import DEFINITIONS, Contribution, contributions
from tripod_doe.report.figures.chart import COLOURS, INK, MUTED, Chart, drawing, legend_above
from tripod_doe.report.responses import spoken

__all__ = ["contribution_chart", "contribution_charts"]

FloatArray = NDArray[np.float64]

_MOST_BARS = 12
_READABLE = 0.06  # part of the axis that a segment needs to hold its number
_HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "")


def contribution_charts(inputs: Mapping[str, xr.Dataset]) -> list[Chart]:
    """One chart per order of each contribution analysis that has shares."""
    return [contribution_chart(part) for part in contributions(inputs) if not part.missing]


def contribution_chart(part: Contribution) -> Chart:
    """Stacked bars, negative shares to the left of zero: one bar per definition, or per operating point.

    Parameters
    ----------
    part
        Shares of one order or output.
    """
    bars, told = _bars(part)
    if part.paper is not None:
        bars["paper, 3.5"] = part.paper
    with drawing(5.4, 1.25 + 0.36 * len(bars)) as (figure, axes):
        _draw(axes, bars, [spoken(name) for name in part.mechanisms])
    model = f" with model {part.model}" if part.model else ""
    caption = (
        f"Shares of the mechanisms in {part.what}{model}, {told}. Left of zero: it opposes the sum. The diamond is the "
        "sum of a bar; what it lacks to 100 % or exceeds does not add up."
    )
    return Chart(part.key, caption, figure, _frame(part))


def _bars(part: Contribution) -> tuple[dict[str, FloatArray], str]:
    """The bars by their labels, and a description of them."""
    count = len(part.labels)
    if count == 1:
        return {DEFINITIONS[name]: values[0] for name, values in part.shares.items()}, "by each definition of a share"
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_BARS)).round().astype(int))
    some = f"{chosen.size} of {count} operating points" if chosen.size < count else f"{count} operating points"
    values = part.shares[part.fairest]
    return {part.labels[at]: values[at] for at in chosen}, f"by {DEFINITIONS[part.fairest]}, at {some}"


def _draw(axes: Axes, bars: dict[str, FloatArray], mechanisms: list[str]) -> None:
    rows = np.arange(len(bars))[::-1]
    shares = np.stack(list(bars.values()))
    known = np.nan_to_num(shares)
    low, high = np.minimum(known, 0).sum(axis=1).min(), max(np.maximum(known, 0).sum(axis=1).max(), 100.0)
    ends = np.zeros((2, len(bars)))  # of what is drawn already, left and right of zero
    for which, mechanism in enumerate(mechanisms):
        width = known[:, which]
        side = (width > 0).astype(int)
        left = ends[side, np.arange(len(bars))]
        axes.barh(
            rows, width, 0.62, left=left, color=COLOURS[which % len(COLOURS)], hatch=_HATCHES[which % len(_HATCHES)],
            edgecolor="white", lw=0.6, label=mechanism,
        )  # fmt: skip
        for row, start, size in zip(rows, left, width, strict=True):
            if abs(size) > _READABLE * (high - low):
                axes.text(
                    start + size / 2, row, f"{size:.3g}", ha="center", va="center", fontsize=7.5, color=INK,
                    bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none"},
                )  # fmt: skip
        ends[side, np.arange(len(bars))] += width
    axes.plot(shares.sum(axis=1), rows, "D", color=INK, mfc="white", ms=5, zorder=4, label="sum")
    for row, bar in zip(rows, shares, strict=True):
        if np.isnan(bar).any():
            axes.annotate(
                "incomplete: points are missing", (0, row), (6, 0), textcoords="offset points", va="center", color=MUTED
            )
    axes.axvline(0, color=MUTED, lw=0.8)
    axes.axvline(100, color=MUTED, lw=0.8, ls="--")
    axes.set_xlim(low - 0.03 * (high - low), high + 0.04 * (high - low))
    axes.set_yticks(rows, list(bars))
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("share (%)")
    legend_above(axes, 3)


def _frame(part: Contribution) -> pd.DataFrame:
    """One row per operating point and definition, in full precision."""
    frames = []
    for name, values in part.shares.items():
        columns = dict(zip(part.mechanisms, values.T, strict=True)) | {"sum": values.sum(axis=1)}
        frames.append(part.points.assign(definition=name, **columns))
    return pd.concat(frames, ignore_index=True)
