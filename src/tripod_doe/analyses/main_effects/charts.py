"""Responses against factors: lines and a map for a grid, mean and quartiles for any other design."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import capital, level, levels_apart, number, with_unit
from tripod_doe.page_parts.charts.chart import (
    COLOURS,
    ON_DARK,
    ON_LIGHT,
    Chart,
    drawing,
    factor_ticks,
    legend_above,
    series,
)
from tripod_doe.page_parts.main_results import (
    Effect,
    Response,
    factor_names,
    logarithmic_factors,
    main_effect,
    numeric_factors,
    responses,
    zero_between,
)
from tripod_doe.page_parts.words import axis_label, factor_label, factor_text, factor_unit

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap


_MOST_LINES = len(COLOURS)
_MOST_CELLS = (18, 8)  # rows and columns of a map whose cells still hold a readable number
_MOST_MAPS = 4  # levels of a third factor
_LOG_AXIS = "; logarithmic axis"
_SHADES = ("#f4f7fb", "#9dbfdf", "#3f7fb8", "#0b3f73")  # of a map, from low to high


@dataclass(frozen=True)
class ResponseCharts:
    """All charts of one response."""

    response: Response
    charts: list[Chart]

    @property
    def strongest(self) -> Chart:
        """The map if there is one, else the chart whose first line rises the most."""
        first_lines = [chart.data.iloc[:, 1].dropna() for chart in self.charts]
        rises = [float(line.max() - line.min()) if len(line) else 0.0 for line in first_lines]
        at = next((k for k, chart in enumerate(self.charts) if "-map" in chart.name), int(np.argmax(rises)))
        return self.charts[at]


def effect_charts(cube: xr.Dataset) -> list[ResponseCharts]:
    """Charts of each response that varies, over each numeric factor."""
    groups = []
    for response in responses(cube):
        if not bool(response.values.notnull().any()):
            continue
        grid = cube["outcome"].dims != ("point",)
        charts = _grid_charts(response, cube) if grid else _point_charts(response, cube)
        if charts:
            groups.append(ResponseCharts(response, charts))
    return groups


def all_effect_charts(cube: xr.Dataset) -> list[Chart]:
    """The charts of all responses, as a figure."""
    return [chart for group in effect_charts(cube) for chart in group.charts]


def _grid_charts(response: Response, cube: xr.Dataset) -> list[Chart]:
    factors = [name for name in factor_names(cube) if cube.sizes[name] > 1]
    numeric = [name for name in numeric_factors(cube) if name in factors]
    charts = []
    for name in numeric:
        others = [other for other in factors if other != name]
        charts.append(_line_chart(response, cube, name, others))
    return charts + _maps(response, cube, factors, numeric)


def _maps(response: Response, cube: xr.Dataset, factors: list[str], numeric: list[str]) -> list[Chart]:
    """Maps over the two numeric factors of most levels, one for each level of a third factor with few."""
    axes = sorted(numeric, key=lambda name: -cube.sizes[name])[:2]
    others = [name for name in factors if name not in axes]
    if len(axes) < 2 or cube.sizes[axes[1]] <= 2 or len(others) > 1:
        return []
    if not others:
        return [_map_chart(response, cube, numeric)]
    third, count = others[0], cube.sizes[others[0]]
    if count > _MOST_MAPS:
        return []
    shown = [name for name in numeric if name in axes]
    return [_map_chart(response, cube, shown, {third: place}) for place in range(count)]


def _line_chart(response: Response, cube: xr.Dataset, factor: str, others: list[str]) -> Chart:
    """One line per level of the second factor, averaged over any further ones."""
    second = min(others, key=lambda name: (cube.sizes[name] > _MOST_LINES, others.index(name))) if others else None
    averaged = [name for name in others if name != second]
    along = np.argsort(cube[factor].values, kind="stable")
    levels = cube[factor].values[along]
    values = response.values.squeeze(drop=True).mean(averaged).transpose(factor, ...).values[along]
    columns, zero = {factor: levels}, zero_between(cube, response, factor, levels)
    with drawing(3.7, 3.0) as (figure, axes):
        for which, (text, column) in enumerate(_columns(cube, second, values)):
            label = with_unit(text, factor_unit(cube, second)) if second else response.label
            columns[f"{response.key}[{second}={text}]" if second else response.key] = column
            at, drawn, marked = _with_zero(levels, column, zero)
            axes.plot(at, drawn, markevery=marked, mfc="white" if which % 2 else None, **series(which), label=label)
        factor_ticks(axes, levels, log := factor in logarithmic_factors(cube))
        axes.set_xlabel(axis_label(cube, factor))
        axes.set_ylabel(response.axis)
        drawn = np.concatenate([*list(columns.values())[1:], [0.0 if zero == 0 else np.nan]])
        axes.set_ylim(*_limits(float(np.nanmin(drawn)), float(np.nanmax(drawn))))
        if second is not None:
            legend_above(axes, 3, factor_label(cube, second))
    caption = f"{_capital(response)} against {factor_label(cube, factor)}"
    if second is not None:
        count, shown = cube.sizes[second], len(columns) - 1
        some = f" at {shown} of its {count} values" if shown < count else ""
        caption += f", one line per {factor_label(cube, second)}{some}"
    if averaged:
        some = " (finished points only)" if bool(response.values.isnull().any()) else ""
        caption += f"; mean over {', '.join(factor_label(cube, name) for name in averaged)}{some}"
    title = f"{_capital(response)} over {factor_label(cube, factor)}"
    caption += _LOG_AXIS * log + _zero_text(response, cube, factor, zero)
    return Chart(f"{response.key}-{factor}", title, caption + ".", figure, pd.DataFrame(columns))


def _with_zero(
    levels: FloatArray, column: FloatArray, zero: float | None
) -> tuple[FloatArray, FloatArray, list[int] | None]:
    """A line with what is known at the zero between two levels, and which of its places were computed (None: all)."""
    if zero is None:
        return levels, column, None
    place = int(np.searchsorted(levels, 0.0))
    marked = [at + (at >= place) for at in range(levels.size)]
    return np.insert(levels, place, 0.0), np.insert(column, place, zero), marked


def _zero_text(response: Response, cube: xr.Dataset, factor: str, zero: float | None) -> str:
    """The note on a line without a marker at zero."""
    if zero is None:
        return ""
    at = with_unit("0", factor_unit(cube, factor))
    return f"; at {at} it is zero, not computed" if zero == 0 else f"; no line across {at}, where it may jump"


def _columns(cube: xr.Dataset, second: str | None, values: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """At most five levels of the second factor at which points finished, with the values there."""
    if second is None:
        yield "", values
        return
    usable = np.flatnonzero(np.isfinite(values).any(axis=0))
    chosen = np.unique(np.linspace(0, usable.size - 1, min(usable.size, _MOST_LINES)).round().astype(int))
    shown = cube[second].values[usable[chosen]]
    texts = levels_apart(shown) if cube[second].dtype.kind in "fiu" else map(str, shown)
    yield from zip(texts, values.T[usable[chosen]], strict=True)


def _capital(response: Response) -> str:
    return response.label if response.label == response.key else capital(response.label)


def _map_chart(
    response: Response, cube: xr.Dataset, factors: list[str], held: Mapping[str, int] | None = None
) -> Chart:
    """Numbers in shaded cells, or labelled contours if there are too many cells to read.

    Args:
        held: Another factor, and the place of its level; all its maps have the same shades.
    """
    held, every = held or {}, response.values.values
    shades = float(np.nanmin(every)), float(np.nanmax(every))
    at = "".join(f", {factor_text(cube, name, cube[name][place].item())}" for name, place in held.items())
    response, cube = replace(response, values=response.values.isel(held, drop=True)), cube.isel(held)
    across, up = sorted(factors, key=lambda name: cube.sizes[name])
    response = replace(response, values=response.values.sortby([across, up]))
    cube = cube.sortby([across, up])
    values = response.values.squeeze(drop=True).transpose(up, across).values
    rows, columns = values.shape
    cells = rows <= _MOST_CELLS[0] and columns <= _MOST_CELLS[1]
    with drawing(3.7, max(3.0, 0.7 + 0.22 * rows) if cells else 3.2) as (figure, axes):
        if cells:
            _draw_cells(axes, cube[across].values, cube[up].values, values, shades)
        else:
            _draw_contours(axes, *_map_with_zeros(response, cube, across, up, values))
        axes.set_xlabel(axis_label(cube, across))
        axes.set_ylabel(axis_label(cube, up))
    data = pd.DataFrame(values, columns=[f"{response.key}[{across}={float(v):.8g}]" for v in cube[across].values])
    data.insert(0, up, cube[up].values)
    unit = with_unit("", response.unit).strip()
    caption = (
        f"{_capital(response)}{f' ({unit})' if unit else ''} over {factor_label(cube, across)} and "
        f"{factor_label(cube, up)}{'; darker is larger' if cells else ' as labelled contours'}"
        f"{'; empty cells have no result' if np.isnan(values).any() else ''}{at}."
    )
    title = f"{_capital(response)} over {factor_label(cube, across)} and {factor_label(cube, up)}{at}"
    name = "-".join([f"{response.key}-map", *(str(place + 1) for place in held.values())])
    return Chart(name, title, caption, figure, data)


def _draw_cells(
    axes: Axes, across: FloatArray, up: FloatArray, values: FloatArray, shades: tuple[float, float]
) -> None:
    low, high = shades
    axes.imshow(
        np.ma.masked_invalid(values),
        cmap=_shades(),
        vmin=low,
        vmax=high,
        aspect="auto",
        origin="lower",
        interpolation="nearest",
    )
    for row, column in np.ndindex(*values.shape):
        value = values[row, column]
        if np.isfinite(value):
            dark = (value - low) > 0.55 * (high - low)
            axes.text(
                column,
                row,
                _cell_text(float(value)),
                ha="center",
                va="center",
                fontsize=7.5,
                color=ON_DARK if dark else ON_LIGHT,
            )
    axes.set_xticks(range(across.size), [level(float(v)) for v in across])
    axes.set_yticks(range(up.size), [level(float(v)) for v in up])
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _cell_text(value: float) -> str:
    """A number of three digits, so that cells line up, but no power of ten."""
    return f"{value:#.3g}".rstrip(".") if 1e-3 < abs(value) < 999.5 else number(value, 3)


def _shades() -> Colormap:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("thrust", _SHADES)


def _map_with_zeros(
    response: Response, cube: xr.Dataset, across: str, up: str, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The levels of both axes and the values, with a row and a column of what is known at a zero between levels."""
    levels = []
    for axis, name in ((1, across), (0, up)):
        own = cube[name].values.astype(float)
        zero = zero_between(cube, response, name, own)
        if zero is not None:
            place = int(np.searchsorted(own, 0.0))
            own, values = np.insert(own, place, 0.0), np.insert(values, place, zero, axis=axis)
        levels.append(own)
    return levels[0], levels[1], values


def _draw_contours(axes: Axes, across: FloatArray, up: FloatArray, values: FloatArray) -> None:
    masked = np.ma.masked_invalid(values)
    if float(masked.max()) > float(masked.min()):
        axes.contourf(across, up, masked, levels=12, cmap=_shades())
        lines = axes.contour(across, up, masked, levels=6, colors=ON_LIGHT, linewidths=0.8)
        axes.clabel(lines, fontsize=7.5)


def _point_charts(response: Response, cube: xr.Dataset) -> list[Chart]:
    """One chart a factor, all on the same vertical scale, so that their effects can be compared by eye."""
    logs = logarithmic_factors(cube)
    effects = {name: main_effect(response, cube, name, name in logs) for name in numeric_factors(cube)}
    effects = {name: effect for name, effect in effects.items() if effect.mean.size > 1}
    if not effects:
        return []
    low = min(float(np.minimum(e.lower, e.mean).min()) for e in effects.values())
    high = max(float(np.maximum(e.upper, e.mean).max()) for e in effects.values())
    if any(zero_between(cube, response, name, effect.level) == 0 for name, effect in effects.items()):
        low = min(low, 0.0)
    limits = _limits(low, high)
    return [_band_chart(response, cube, name, effect, limits, name in logs) for name, effect in effects.items()]


def _limits(low: float, high: float) -> tuple[float, float]:
    """Ends of a vertical axis; it includes zero if little of its length is lost by that."""
    margin = 0.06 * (high - low) or 0.05 * abs(high) or 1.0
    return (0.0 if 0 <= low < 0.4 * high else low - margin), high + margin


def _band_chart(
    response: Response, cube: xr.Dataset, factor: str, effect: Effect, limits: tuple[float, float], log: bool
) -> Chart:
    spread, zero = bool((effect.upper > effect.lower).any()), zero_between(cube, response, factor, effect.level)
    with drawing(3.5, 2.6) as (figure, axes):
        levels, lower, marked = _with_zero(effect.level, effect.lower, zero)
        upper, mean = (_with_zero(effect.level, column, zero)[1] for column in (effect.upper, effect.mean))
        if spread:
            axes.fill_between(levels, lower, upper, color="#cfdeee", lw=0)
            for edge in (lower, upper):
                axes.plot(levels, edge, color="#6f9cc6", lw=0.8, ls="--")
        axes.plot(levels, mean, color=COLOURS[0], marker="o", markevery=marked)
        axes.set_ylim(*limits)
        factor_ticks(axes, effect.level, log)
        axes.set_xlabel(axis_label(cube, factor))
        axes.set_ylabel(response.axis.replace(" of the thrust force", ""))
    data = pd.DataFrame(
        {
            factor: effect.level,
            f"{response.key}_mean": effect.mean,
            f"{response.key}_lower_quartile": effect.lower,
            f"{response.key}_upper_quartile": effect.upper,
            "points": effect.count,
        }
    )
    label = f"{_capital(response)} against {factor_label(cube, factor)}: "
    if "varied" in cube.coords:
        caption = label + "all other factors at their base values."
    else:
        groups = f"{effect.mean.size} classes of neighbouring points" if effect.sampled else "the points of each value"
        caption = f"{label}mean{' and quartiles (band)' if spread else ''} of {groups}."
    caption = caption.removesuffix(".") + _LOG_AXIS * log + _zero_text(response, cube, factor, zero) + "."
    title = f"{_capital(response)} over {factor_label(cube, factor)}"
    return Chart(f"{response.key}-{factor}", title, caption, figure, data)
