"""Stability maps: every run of a study over method, step and a factor, with measured and predicted borders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.stability.stability import RunKind, map_of, maps
from tripod_doe.array_types import IntArray
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import level, with_unit
from tripod_doe.page_parts.charts.chart import COLOURS, INK, Chart, panels
from tripod_doe.page_parts.words import spoken, unit_text

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes

_COLUMNS = 3
_EXACT, _GOOD, _REFUSED, _DIVERGED, _WRONG, _UNKNOWN = range(6)
_CLASSES = {
    _EXACT: ("#9cc3e6", "", "right to a tenth of the limit"),
    _GOOD: ("#d6e6f5", "", "right within the limit"),
    _REFUSED: ("#cfd4da", "", "rejected as inaccurate"),
    _DIVERGED: ("#8b96a3", "", "failed: did not reach its end"),
    _WRONG: ("#e58a5c", "////", "finished with a wrong result"),
    _UNKNOWN: ("#ffffff", "....", "no reference"),
}
"""Colour, hatch and meaning of each class of runs."""


def stability_charts(borders: xr.Dataset, name: str = "") -> list[Chart]:
    """One chart per factor: one panel per method, with step or tolerance over the values of the factor."""
    return [_chart(borders, factor) for factor in maps(borders)]


def _chart(borders: xr.Dataset, factor: str) -> Chart:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    whole = map_of(borders, factor)
    uniform = _of_one_class(whole)
    part = (
        whole.isel(method=~np.isin(whole["method"].values, list(uniform)))
        if len(uniform) < whole.sizes["method"]
        else whole
    )
    methods = [str(name) for name in part["method"].values]
    tried = (_classes(part) >= 0).any(axis=(0, 1))
    part = part.isel(numerics=tried)
    classes = _classes(part)
    columns = min(_COLUMNS, len(methods))
    with panels(len(methods), columns, 2.9 if columns > 1 else 4.6, 2.5) as (figure, axes):
        for m, (name, panel) in enumerate(zip(methods, axes, strict=True)):
            _draw(panel, part.isel(method=m), classes[m])
            panel.set_title(name)
        _label(axes[0], part, factor)
        figure.supxlabel(with_unit(spoken(factor), _bracketed(part[factor].attrs.get("units", "1"))), fontsize=8.5)
        figure.supylabel("tolerance" if borders.attrs["numerics"] != "step_s" else "step (s)", fontsize=8.5)
        shown = np.unique(classes)
        handles = [Patch(fc=c, hatch=h, ec=INK, lw=0.4, label=t) for k, (c, h, t) in _CLASSES.items() if k in shown]
        lines = [
            Line2D([], [], color=INK, lw=2, label="measured limit"),
            Line2D([], [], color=COLOURS[3], ls="--", marker="D", ms=4, label="predicted limit"),
        ]
        figure.legend(
            handles=handles + lines, loc="outside upper left", ncols=min(3, columns + 1), frameon=False, fontsize=8
        )
    left_out = {name: meaning for name, meaning in uniform.items() if name not in methods}
    title = f"Runs over the {spoken(factor)}"
    return Chart(factor, title, _caption(borders, factor, left_out), figure, _numbers(whole, factor))


def _of_one_class(part: xr.Dataset) -> dict[str, str]:
    """Methods all of whose runs are of one class, with its meaning: their panels would be of one colour."""
    uniform = {}
    for name, classes in zip(part["method"].values.tolist(), _classes(part), strict=True):
        seen = {_GOOD if kind == _EXACT else kind for kind in classes[classes >= 0].tolist()}
        if len(seen) < 2:
            uniform[name] = f"all runs {_CLASSES[seen.pop()][2]}" if seen else "no runs"
    return uniform


def _bracketed(unit: object) -> str:
    text = unit_text(str(unit))
    return f"({text})" if text else ""


def _classes(part: xr.Dataset) -> IntArray:
    """Class of every run, shape (method, case, numerics); -1 if there is no run."""
    kind, error = part["run_kind"].values, part["error"].values
    classes = np.full(kind.shape, -1)
    classes[kind == RunKind.GOOD] = _GOOD
    classes[(kind == RunKind.GOOD) & (error <= 0.1 * part.attrs["limit"])] = _EXACT
    classes[kind == RunKind.REFUSED] = _DIVERGED
    classes[(part["run_outcome"].values == Outcome.INACCURATE)] = _REFUSED
    classes[kind == RunKind.WRONG] = _WRONG
    classes[kind == RunKind.UNKNOWN] = _UNKNOWN
    return classes


def _draw(panel: Axes, part: xr.Dataset, classes: IntArray) -> None:
    """The runs of one method as cells, and its borders."""
    up = np.log10(part["numerics"].values)
    middle = (up[1:] + up[:-1]) / 2
    edges = np.array([2 * up[0] - middle[0], *middle, 2 * up[-1] - middle[-1]]) if up.size > 1 else up[0] + [-0.5, 0.5]
    for c in range(classes.shape[0]):
        for s in np.flatnonzero(classes[c] >= 0):
            colour, hatch, _ = _CLASSES[int(classes[c, s])]
            panel.fill_between([c - 0.5, c + 0.5], *edges[s : s + 2], fc=colour, hatch=hatch, ec="white", lw=0.5)
    low, high = np.log10(part["border_low"].values), np.log10(part["border_high"].values)
    for c, (below, above) in enumerate(zip(low, high, strict=True)):
        if np.isfinite(above):
            at = (below + above) / 2 if np.isfinite(below) else edges[0]
            panel.plot([c - 0.5, c + 0.5], [at, at], color=INK, lw=2, solid_capstyle="butt")
    predicted = np.log10(part["border_predicted"].values)
    shown = np.where((predicted >= edges[0]) & (predicted <= edges[-1]), predicted, np.nan)
    panel.plot(np.arange(shown.size), shown, color=COLOURS[3], lw=1.6, ls="--", marker="D", ms=4)
    if not np.isfinite(shown).any():
        beyond = "no limit" if np.isinf(predicted).all() else "limit beyond" if np.isfinite(predicted).any() else ""
        text = f"predicted: {beyond}" if beyond else "no prediction"
        panel.text(0.97, 0.95, text, transform=panel.transAxes, ha="right", va="top", fontsize=7.5, color=COLOURS[3])
    panel.set_ylim(edges[0], edges[-1])
    panel.grid(visible=False)


def _label(panel: Axes, part: xr.Dataset, factor: str) -> None:
    """Ticks that all panels share."""
    values = part[factor].values
    panel.set_xlim(-0.5, values.size - 0.5)
    panel.set_xticks(range(values.size), [level(float(value)) for value in values])
    panel.yaxis.set_major_formatter(lambda value, _: f"{10**value:.2g}")


def _caption(borders: xr.Dataset, factor: str, left_out: dict[str, str]) -> str:
    what = "tolerance" if borders.attrs["numerics"] != "step_s" else "step"
    alike = {meaning: [name for name in left_out if left_out[name] == meaning] for meaning in left_out.values()}
    return (
        f"Runs over {what} and {spoken(factor)}: right within {100 * borders.attrs['limit']:g} % of the reference, "
        f"rejected, or wrong and undetected; the measured stability limit, and the limit of the linearised scene."
        + "".join(f" Not drawn, {meaning}: {', '.join(names)}." for meaning, names in alike.items())
    )


def _numbers(part: xr.Dataset, factor: str) -> pd.DataFrame:
    """The borders, one row per method and value."""
    columns = ["border_low", "border_high", "border_predicted", "ratio", "wrong_runs"]
    table = part[columns].to_dataframe().reset_index()
    return table[["method", factor, *columns]]
