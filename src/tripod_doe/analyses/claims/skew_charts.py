"""Needle skew: its change during a run, the bearings that keep it, and results over the initial skew."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.claims.rules import RULES
from tripod_doe.number_text import level
from tripod_doe.page_parts.charts.chart import (
    COLOURS,
    HATCHES,
    INK,
    LINES,
    MARKERS,
    MUTED,
    Chart,
    drawing,
    legend_above,
    series,
)
from tripod_doe.page_parts.charts.paper_figures import SKEWS, first_points
from tripod_doe.page_parts.main_results import finished, numeric_factors
from tripod_doe.page_parts.words import axis_label, factor_text

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_KEPT = float(next(rule.high for rule in RULES if rule.name == "skew_stays") or 0)
_SEEN = float(next(rule.low for rule in RULES if rule.name == "beat_visible") or 0)
_MOST_NAMED = 4
_PATTERNS = {"+ - +": (1, -1, 1), "+ + +": (1, 1, 1), "- + -": (-1, 1, -1)}


def skew_chart(cube: xr.Dataset) -> Chart | None:
    """Initial skew and mean, smallest and largest skew of the last revolution per trunnion: the paper's Fig. 11."""
    if "needle_skew_summary_deg" not in cube or any(name not in cube.coords for name in SKEWS):
        return None
    points = first_points(cube)
    rows = []
    with drawing(4.7, 3.0) as (figure, axes):
        for at, point in enumerate(points):
            summary = point["needle_skew_summary_deg"].isel(cycle=-1)
            mean, least, most = (summary.sel(statistic=name).values for name in ("mean", "min", "max"))
            start = np.array([float(point[name]) for name in SKEWS])
            for k in range(3):
                x = at + 0.26 * (k - 1)
                axes.bar(
                    x,
                    mean[k],
                    0.22,
                    color="#b9d0e8",
                    edgecolor=COLOURS[0],
                    hatch=HATCHES[k],
                    lw=0.8,
                    label=f"trunnion {k + 1}" if at == 0 else None,
                )
                axes.vlines(x, least[k], most[k], color=INK, lw=1.2)
                axes.plot(x, start[k], MARKERS[3], color=COLOURS[1], label="initial" if at == k == 0 else None)
                rows.append((at + 1, k + 1, start[k], mean[k], least[k], most[k]))
        axes.axhline(0, color=INK, lw=0.8)
        axes.set_xticks(range(len(points)), ["\n".join(level(float(p[name])) for name in SKEWS) for p in points])
        axes.grid(axis="x", visible=False)
        axes.set_xlabel("initial skew on trunnions 1, 2, 3 (deg)")
        axes.set_ylabel("skew in the last revolution (deg)")
        legend_above(axes, 2)
    caption = (
        "Skew of the most loaded needle: mean (bars), smallest and largest value (lines) of the last revolution, and "
        "initial value (diamonds)."
    )
    columns = ["point", "trunnion", "initial_deg", "mean_deg", "least_deg", "greatest_deg"]
    return Chart("skew", "Needle skew in the last revolution", caption, figure, pd.DataFrame(rows, columns=columns))


def _skew_table(cube: xr.Dataset) -> pd.DataFrame | None:
    """One row per finished point whose initial skews have the same magnitude on all trunnions; None without any.

    Columns: initial_deg, signs, mean_deg (in the last revolution, positive if its sign is unchanged), change_percent
    (the largest of the trunnions), second_n, third_n, beat_percent, and the other factors.
    """
    if "needle_skew_summary_deg" not in cube or "thrust_amplitude" not in cube or any(k not in cube for k in SKEWS):
        return None
    if cube["outcome"].dims != ("point",):
        return None
    good = cube.isel(point=np.flatnonzero(finished(cube).values))
    start = np.stack([good[name].values for name in SKEWS], axis=1)
    alike = (np.ptp(np.abs(start), axis=1) < 1e-9) & (start[:, 0] != 0)
    good, start = good.isel(point=np.flatnonzero(alike)), start[alike]
    if not len(start):
        return None
    summary = good["needle_skew_summary_deg"].isel(cycle=-1).sel(statistic="mean").transpose("point", "trunnion").values
    second, third = (good["thrust_amplitude"].sel(order=order).values for order in (2, 3))
    others = {name: good[name].values for name in numeric_factors(cube) if name not in SKEWS}
    return pd.DataFrame(
        others
        | {
            "initial_deg": np.abs(start[:, 0]),
            "signs": [tuple(int(s) for s in np.sign(row)) for row in start],
            "mean_deg": (summary * np.sign(start)).mean(axis=1),
            "change_percent": 100 * np.abs(summary / start - 1).max(axis=1),
            "second_n": second,
            "third_n": third,
            "beat_percent": 100 * second / third,
        }
    )


def kept_skew_charts(cube: xr.Dataset) -> list[Chart]:
    """Skew in the last revolution and second order over a factor of the bearing, two charts per initial skew.

    Of at most three other factors the one with the most levels is the horizontal axis, the next sets the colour, the
    last the line. The caption names the bearings that keep the skew and show the beat, by the limits of the claims.
    """
    table = _skew_table(cube)
    if table is None:
        return []
    others = [name for name in numeric_factors(cube) if name not in SKEWS]
    if not 1 <= len(others) <= 3:
        return []
    along = max(others, key=lambda name: table[name].nunique())
    rest = [name for name in others if name != along]
    kept = table.groupby(others)["change_percent"].max() <= _KEPT
    names = [
        _bearing(cube, table[others].drop_duplicates().set_index(others, drop=False).loc[key])
        for key in kept[kept].index
    ]
    always = f" Bearings that keep every initial skew: {'; '.join(names) or 'none'}."
    charts = []
    for rank, (_, part) in enumerate(table.groupby("initial_deg")):
        text = _those_that_keep(cube, part, others) + always
        charts.append(_kept_chart(cube, part, (along, rest), ("mean_deg", f"kept-{rank + 1}"), text))
        text = "Second order over the third; dashed: limit of the claim above which a beat is visible."
        charts.append(_kept_chart(cube, part, (along, rest), ("beat_percent", f"beat-{rank + 1}"), text))
    return charts


def _bearing(cube: xr.Dataset, row: pd.Series) -> str:
    """The factors of a bearing as text."""
    return ", ".join(factor_text(cube, str(name), value) for name, value in row.items())


def _those_that_keep(cube: xr.Dataset, part: pd.DataFrame, others: list[str]) -> str:
    """Caption: how many bearings keep the skew, how many show a beat, and which do both."""
    kept, seen = part["change_percent"] <= _KEPT, part["beat_percent"] >= _SEEN
    both = part[kept & seen].sort_values("change_percent")
    named = [
        f"{_bearing(cube, row[others])} ({row['mean_deg']:.2f} deg, {row['beat_percent']:.1f} %)"
        for _, row in both.head(_MOST_NAMED).iterrows()
    ]
    more = f" and {len(both) - _MOST_NAMED} more" if len(both) > _MOST_NAMED else ""
    return (
        f"Skew in the last revolution; initial skew {part['initial_deg'].iloc[0]:g} deg (dashed; band: +-{_KEPT:g} "
        f"%). Of {len(part)} bearings {int(kept.sum())} keep it within {_KEPT:g} % and {int(seen.sum())} have a second "
        f"order of at least {_SEEN:g} % of the third; both: {'; '.join(named) + more if named else 'none'}."
    )


def _kept_chart(
    cube: xr.Dataset, part: pd.DataFrame, factors: tuple[str, list[str]], shown: tuple[str, str], caption: str
) -> Chart:
    along, rest = factors
    column, name = shown
    levels = [sorted(part[factor].unique()) for factor in rest]
    with drawing(4.9, 3.6) as (figure, axes):
        for key in product(*levels):
            ranks = [level.index(value) for level, value in zip(levels, key, strict=True)]
            colour, dash = (*ranks, 0, 0)[:2]
            line = part[(part[rest] == list(key)).all(axis=1)].sort_values(along)
            axes.plot(
                line[along],
                line[column],
                mfc="white",
                label=", ".join(level(value) for value in key),
                **series(dash) | {"color": COLOURS[colour % len(COLOURS)]},
            )
        if column == "mean_deg":
            start = float(part["initial_deg"].iloc[0])
            axes.axhspan(start * (1 - _KEPT / 100), start * (1 + _KEPT / 100), color="#eef3f8", lw=0)
            axes.axhline(start, color=MUTED, lw=1, ls="--")
            axes.set_ylabel("needle skew in the last revolution (deg)")
        else:
            axes.axhline(_SEEN, color=MUTED, lw=1, ls="--")
            axes.set_ylabel("second over third order (%)")
        axes.set_ylim(0, None)
        axes.set_xlabel(axis_label(cube, along))
        if rest:
            legend_above(axes, 3, ", ".join(axis_label(cube, factor) for factor in rest))
    title = "Skew that is left" if column == "mean_deg" else "Second over third order"
    return Chart(name, title, caption, figure, part.drop(columns="signs"))


def findings_over_skew_charts(cube: xr.Dataset) -> list[Chart]:
    """Orders 2 and 3, and the skew in the last revolution, over the initial skew, one line per pattern of signs."""
    table = _skew_table(cube)
    others = [name for name in numeric_factors(cube) if name not in SKEWS]
    if table is None or others or table["initial_deg"].nunique() < 2:
        return []
    lines = {name: table[[row == signs for row in table["signs"]]] for name, signs in _PATTERNS.items()}
    lines = {name: line.sort_values("initial_deg") for name, line in lines.items() if len(line)}
    ends = {name: (line.iloc[0], line.iloc[-1]) for name, line in lines.items()}
    orders = "; ".join(
        f"{name}: second order {low['second_n']:.2g} N at {low['initial_deg']:g} deg, {high['second_n']:.2g} N at "
        f"{high['initial_deg']:g} deg"
        for name, (low, high) in ends.items()
    )
    kept = "; ".join(
        f"{name}: {low['initial_deg']:g} to {abs(low['mean_deg']):.2f} deg, {high['initial_deg']:g} to "
        f"{abs(high['mean_deg']):.2f} deg"
        for name, (low, high) in ends.items()
    )
    orders = f"Third and second order over the initial skew of all trunnions, logarithmic axes. {orders}."
    kept = f"Skew in the last revolution, mean of the trunnions, over the initial skew; dotted: no change. {kept}."
    return [
        _over_skew("orders", "Orders over the initial skew", lines, _amplitudes, orders),
        _over_skew("skews", "Skew that is left", lines, _skews, kept),
    ]


def _amplitudes(axes: Axes, which: int, name: str, line: pd.DataFrame) -> None:
    for order, colour in (("third", COLOURS[0]), ("second", COLOURS[1])):
        axes.plot(
            line["initial_deg"],
            line[f"{order}_n"],
            mfc="white",
            label=f"{order} order, {name}",
            **series(which) | {"color": colour},
        )
    axes.set_ylabel("amplitude of the thrust force (N)")


def _skews(axes: Axes, which: int, name: str, line: pd.DataFrame) -> None:
    start, unchanged = line["initial_deg"], "no change" if which == 0 else None
    axes.plot(start, line["mean_deg"].abs(), mfc="white", label=name, **series(which))
    axes.plot(start, start, ls=LINES[3], color=INK, lw=1, label=unchanged)
    axes.set_ylabel("skew in the last revolution (deg)")


def _over_skew(
    name: str,
    title: str,
    lines: dict[str, pd.DataFrame],
    draw: Callable[[Axes, int, str, pd.DataFrame], None],
    caption: str,
) -> Chart:
    with drawing(4.7, 3.6) as (figure, axes):
        for which, (label, line) in enumerate(lines.items()):
            draw(axes, which, label, line)
        every = pd.concat(lines.values())
        axes.set_xscale("log")
        if name == "orders":  # they differ by a hundred
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xticks(np.unique(every["initial_deg"]), [f"{v:g}" for v in np.unique(every["initial_deg"])])
        axes.minorticks_off()
        axes.set_xlabel("initial skew (deg)")
        legend_above(axes, 2)
    frame = pd.concat(lines.values(), keys=lines.keys(), names=["pattern", None]).reset_index("pattern")
    return Chart(name, title, caption, figure, frame.drop(columns="signs"))
