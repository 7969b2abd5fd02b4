"""Shares of the mechanisms: signed stacked bars by definition, and how they are spread over operating points."""

from __future__ import annotations

import textwrap
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.contribution.share_tables import DEFINITIONS, Contribution, contributions, percent
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import count_of, levels_apart
from tripod_doe.page_parts.charts.chart import COLOURS, INK, MUTED, Chart, drawing, legend_above, panels
from tripod_doe.page_parts.words import spoken, with_brackets

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis


_READABLE = 0.06  # least part of the axis for a segment that shows its number
_HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "")
_FENCE = 1.5  # distances of the quartiles, beyond them, within which shares decide the scale (Tukey's box plot)
_PANEL = 2.1  # inches
_LETTERS = 34  # of a line next to a bar
_MOST_CELLS = 7  # cells along a side of a map; up to this number each cell has a label


def contribution_figures(result: xr.Dataset, name: str) -> list[Chart]:
    """The charts of each order that has shares."""
    return [chart for part in contributions({name: result}) if not part.missing for chart in contribution_charts(part)]


def contribution_charts(part: Contribution) -> list[Chart]:
    """Stacked bars for up to three operating points; for many their distribution, and maps over two factors."""
    if not part.many:
        return [_bar_chart(part)]
    return [_distribution_chart(part), *_maps(part)]


def _distribution_chart(part: Contribution) -> Chart:
    """Median, quartiles and usual range of each mechanism's share; shares beyond the axis are marked at its edge."""
    values, names = part.counted_shares, [spoken(name) for name in part.mechanisms]
    count = int(np.isfinite(values).any(axis=1).sum())
    most = "up to " * bool(np.isfinite(values).sum() < count * len(names))  # no point has all of them
    usual = [_without_outliers(column) for column in values.T]
    ends = min(0.0, *(part.min() for part in usual)), max(0.0, *(part.max() for part in usual))
    margin = 0.06 * (ends[1] - ends[0]) or 1.0
    low, high = float(ends[0] - margin), float(ends[1] + margin)
    with drawing(5.4, 1.1 + 0.36 * len(names)) as (figure, axes):
        for row, column in zip(range(len(names))[::-1], values.T, strict=True):
            known = column[np.isfinite(column)]
            if known.size:
                _draw_spread(axes, row, known, low, high)
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.set_xlim(low, high)
        axes.set_yticks(range(len(names))[::-1], names)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
        axes.spines["left"].set_visible(False)
        axes.set_xlabel("share (%)")
        if axes.get_legend_handles_labels()[0]:
            legend_above(axes, 3)
    model = f" with model {part.model}" if part.model else ""
    caption = (
        f"Shares of the mechanisms in {part.what}{model} by {DEFINITIONS[part.fairest]} at {most}{count:,} "
        f"operating points: median (line), quartiles (bar), points that are no outliers (thin line)."
        f"{_left_out(part, low, high)}"
    )
    return Chart(part.key, f"Shares of the mechanisms in {part.what}", caption, figure, _frame(part))


def _without_outliers(shares: FloatArray) -> FloatArray:
    """The shares without outliers; zero if no share is known."""
    known = shares[np.isfinite(shares)]
    if known.size == 0:
        return np.zeros(1)
    lower, upper = np.quantile(known, (0.25, 0.75))
    reach = _FENCE * (upper - lower)
    return known[(known >= lower - reach) & (known <= upper + reach)]


def _draw_spread(axes: Axes, row: int, known: FloatArray, low: float, high: float) -> None:
    """One mechanism; the first one drawn carries the words of the legend."""
    first = not axes.patches
    lower, middle, upper = np.quantile(known, (0.25, 0.5, 0.75))
    usual = _without_outliers(known)
    axes.plot([usual.min(), usual.max()], [row, row], color=INK, lw=0.9, label="usual range" if first else None)
    axes.barh(
        row,
        upper - lower,
        0.5,
        left=lower,
        color="#b9d0e8",
        edgecolor=COLOURS[0],
        lw=0.8,
        label="quartiles" if first else None,
    )
    axes.plot([middle] * 2, [row - 0.3, row + 0.3], color=COLOURS[1], lw=2, label="median" if first else None)
    for edge, marker, beyond in ((low, "<", known < low), (high, ">", known > high)):
        if beyond.any():
            axes.plot(edge, row, marker, color=COLOURS[1], ms=6, clip_on=False)


def _left_out(part: Contribution, low: float, high: float) -> str:
    """Number of shares that the axis leaves out, and the most extreme one with its operating point."""
    values = part.counted_shares
    outside = np.isfinite(values) & ((values < low) | (values > high))
    if not outside.any():
        return ""
    away = np.where(outside, np.maximum(low - values, values - high), -np.inf)
    at, which = np.unravel_index(int(away.argmax()), away.shape)
    return (
        f" Beyond the axis (triangles): {count_of(int(outside.sum()), 'share')}, the most extreme is "
        f"{spoken(part.mechanisms[which])} at {part.labels[at]} with {percent(values[at : at + 1, which])}."
    )


def _places(axis: Axis, levels: pd.Index[Any]) -> FloatArray:
    """Places of the cells of a map: few levels are evenly spaced and labelled, many levels are placed to scale."""
    if len(levels) > _MOST_CELLS:
        return levels.to_numpy(float)
    axis.set_ticks(range(len(levels)), levels_apart(levels.tolist()))
    return np.arange(len(levels), dtype=float)


def _maps(part: Contribution) -> list[Chart]:
    """One map per mechanism over the two factors of the operating points, if they fill a grid."""
    varying = [str(name) for name in part.points if part.points[str(name)].nunique() > 1]
    if len(varying) != 2 or not all(part.points[name].dtype.kind in "fiu" for name in varying):
        return []
    across, up = sorted(varying, key=lambda name: part.points[name].nunique())
    if part.points[across].nunique() * part.points[up].nunique() != len(part.points):  # of a sample, tables are huge
        return []
    from matplotlib.colors import CenteredNorm

    values = part.shares[part.fairest]
    tables = [part.points.assign(share=column).pivot_table("share", up, across, dropna=False) for column in values.T]
    shown = [which for which, table in enumerate(tables) if bool(table.notna().any(axis=None))]
    with panels(len(shown), min(len(shown), 3), _PANEL, _PANEL) as (figure, grid):
        for panel, which in zip(grid, shown, strict=True):
            table, name = tables[which], spoken(part.mechanisms[which])
            middle = float(np.nanmedian(table))
            usual = _without_outliers(table.to_numpy(float).ravel())
            norm = CenteredNorm(middle, max(float(np.abs(usual - middle).max()), 0.5))
            places = _places(panel.xaxis, table.columns), _places(panel.yaxis, table.index)
            image = panel.pcolormesh(*places, np.ma.masked_invalid(table), norm=norm, cmap="PuOr")
            figure.colorbar(image, ax=panel, extend="both", shrink=0.9).ax.tick_params(labelsize=7)
            panel.set_title(f"{name} (%)", fontsize=8)
        figure.supxlabel(with_brackets(spoken(across), part.units.get(across, "")), fontsize=8.5)
        figure.supylabel(with_brackets(spoken(up), part.units.get(up, "")), fontsize=8.5)
    caption = (
        f"Shares in {part.what} by {DEFINITIONS[part.fairest]} over {spoken(across)} and {spoken(up)}; white is the "
        "median of a mechanism, the ends of its scale leave out outliers."
    )
    return [Chart(f"{part.key}-map", f"Shares in {part.what} over the operating points", caption, figure, _frame(part))]


def _bar_chart(part: Contribution) -> Chart:
    """Stacked bars, negative shares to the left of zero: one bar per definition, or per operating point."""
    if len(part.labels) == 1:
        bars = {DEFINITIONS[name]: values[0] for name, values in part.shares.items()}
        text = "by each definition of a share"
    else:
        bars = dict(zip(part.labels, part.shares[part.fairest], strict=True))
        text = f"by {DEFINITIONS[part.fairest]}, at {len(bars)} operating points"
    if part.paper is not None:
        bars["paper, 3.5"] = part.paper
    zero = {label for label, is_zero in zip(part.labels, part.zero, strict=True) if is_zero}
    lines = max(len(textwrap.wrap(name, _LETTERS)) for name in bars)
    with drawing(5.4, 1.25 + (0.24 + 0.12 * lines) * len(bars)) as (figure, axes):
        _draw(axes, bars, [spoken(name) for name in part.mechanisms], zero)
    model = f" with model {part.model}" if part.model else ""
    caption = (
        f"Shares of the mechanisms in {part.what}{model}, {text}. Left of zero, a mechanism opposes the sum. The "
        "diamond is the sum of a bar; its distance from 100 % is what does not add up."
    )
    return Chart(part.key, f"Shares of the mechanisms in {part.what}", caption, figure, _frame(part))


def _draw(axes: Axes, bars: dict[str, FloatArray], mechanisms: list[str], zero: Collection[str]) -> None:
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
            rows,
            width,
            0.62,
            left=left,
            color=COLOURS[which % len(COLOURS)],
            hatch=_HATCHES[which % len(_HATCHES)],
            edgecolor="white",
            lw=0.6,
            label=mechanism,
        )
        for row, start, size in zip(rows, left, width, strict=True):
            if abs(size) > _READABLE * (high - low):
                axes.text(
                    start + size / 2,
                    row,
                    f"{size:.0f}",  # whole percents: longer numbers cover the narrow parts next to them
                    ha="center",
                    va="center",
                    fontsize=7.5,
                    color=INK,
                    bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none"},
                )
        ends[side, np.arange(len(bars))] += width
    axes.plot(shares.sum(axis=1), rows, "D", color=INK, mfc="white", ms=5, zorder=4, label="sum")
    for row, (name, bar) in zip(rows, bars.items(), strict=True):
        if np.isnan(bar).any():
            why = "no shares: it is zero" if name in zero else "incomplete: points are missing"
            axes.annotate(why, (0, row), (6, 0), textcoords="offset points", va="center", color=MUTED)
    axes.axvline(0, color=MUTED, lw=0.8)
    axes.axvline(100, color=MUTED, lw=0.8, ls="--")
    axes.set_xlim(low - 0.03 * (high - low), high + 0.04 * (high - low))
    names = [textwrap.fill(name, _LETTERS) for name in bars]
    axes.set_yticks(rows, names)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("share (%)")
    legend_above(axes, 2 if "\n" in "".join(names) else 3)  # long names leave less room


def _frame(part: Contribution) -> pd.DataFrame:
    """One row per operating point and definition, in full precision."""
    frames = []
    for name, values in part.shares.items():
        columns = dict(zip(part.mechanisms, values.T, strict=True)) | {"sum": values.sum(axis=1)}
        frames.append(part.points.assign(definition=name, **columns))
    return pd.concat(frames, ignore_index=True)
