"""A chart: a matplotlib figure in the common style, with its caption, its text alternative and its numbers."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tripod_doe.files.csv_table import csv_cell
from tripod_doe.number_text import levels_apart
from tripod_doe.page_parts.charts.tooltips import add_tooltips, mark_points

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED = "#1d2733", "#5c6875"
ON_LIGHT, ON_DARK = "#1b2430", "#fdfefe"
"""Ink on cells whose shade shows a number: it does not change on a dark page."""
COLOURS = ("#0b5394", "#c4501b", "#2c7a4b", "#7a4a9e", "#8a6d00", "#3d4852")
LINES = ("-", "--", "-.", ":", (0, (6, 2, 1, 2, 1, 2)), (0, (1, 2)))
MARKERS = ("o", "s", "^", "D", "v", "P")
HATCHES = ("", "////", "....", "xxxx")

VARIABLES = {
    INK: "ink",
    "#000000": "ink",
    MUTED: "muted",
    "#ffffff": "paper",
    "#8b96a3": "axis",
    "#e3e8ee": "grid",
    **{colour: f"series-{which + 1}" for which, colour in enumerate(COLOURS)},
    "#b9d0e8": "tint-1",
    "#f6d9c9": "tint-2",
    "#cfe6d8": "tint-3",
    "#cfdeee": "band",
    "#6f9cc6": "band-edge",
    "#eef3f8": "band-faint",
    "#f2c14e": "highlight",
    "#9cc3e6": "cell-best",
    "#d6e6f5": "cell-good",
    "#f2c9ae": "cell-poor",
    "#e58a5c": "cell-wrong",
    "#cfd4da": "cell-refused",
    "#e3e6ea": "cell-empty",
}
"""Colours of the charts as variables of the page's style sheet, which has a light and a dark value for each."""

INTERVALS: dict[str, Any] = {"fmt": "none", "ecolor": INK, "elinewidth": 1.1, "capsize": 2.5}
"""Style of intervals at the ends of bars, as words of `errorbar`."""

WIDE = 6.0
"""Width in inches above which a chart does not share a row of a page with others."""

_DECADES = 30  # ratio of the ends of a logarithmic axis from which powers of ten are ticks enough
_OWN_TICKS = 5
_LABEL_GAP = 4.0  # least distance of two tick labels, in pixels
_MOST_DRAWN = 2_000  # markers or cells above which they are an image in the figure, so that it stays small
_LEGEND_SHARE = 0.86  # part of a figure's width; the rest is for the axis on the left
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "text.color": INK,
    "text.parse_math": False,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.labelsize": 8.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#8b96a3",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
    "grid.color": "#e3e8ee",
    "grid.linewidth": 0.7,
    "xtick.color": "#8b96a3",
    "ytick.color": "#8b96a3",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.6,
    "lines.markersize": 4.5,
    "hatch.linewidth": 0.6,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


@dataclass(frozen=True)
class Chart:
    """One figure of a report."""

    name: str  # file name of its numbers, without ending; unique in a page, since SVG identifiers derive from it
    title: str  # its content in a few words; a page writes it above the figure
    caption: str  # its content and how to read it, in a sentence or two
    figure: Figure  # drawn in the common style
    data: pd.DataFrame  # the numbers that were drawn

    @property
    def wide(self) -> bool:
        """Whether it needs the whole width of a page."""
        return float(self.figure.get_figwidth()) > WIDE

    def svg(self) -> str:
        """The figure as an SVG element with its title and selectable text; equal charts give equal characters."""
        buffer, tooltips = io.StringIO(), mark_points(self.figure)
        with styled(self.name):
            laid_out(self.figure).savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        element, end, content = _inline(add_tooltips(buffer.getvalue(), tooltips)).partition(">")
        return f"{element}{end}<title>{escape(self.title)}</title>{content}"

    def csv(self) -> str:
        """The numbers as CSV, in full precision."""
        words = {name: self.data[name].map(csv_cell) for name in self.data.select_dtypes(exclude="number").columns}
        return self.data.assign(**words).to_csv(index=False)


def series(which: int) -> dict[str, Any]:
    """Style of one of several lines, as words of `plot` and `errorbar`."""
    styles = {"color": COLOURS, "marker": MARKERS, "ls": LINES}
    return {key: values[which % len(values)] for key, values in styles.items()}


def intervals_text(halves: pd.Series, level: float) -> str:
    """What a caption says of intervals: nothing where none is known.

    Args:
        halves: Half widths, NaN where an interval is not known.
        level: Their level in percent.
    """
    return f" with {level:g} % confidence intervals" if halves.notna().any() else ""


def name_rows(axes: Axes, rows: NDArray[np.intp], names: list[str], size: float = 8) -> None:
    """Write a name next to each horizontal bar, in place of an axis."""
    axes.set_yticks(rows, names, fontsize=size)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.spines["left"].set_visible(False)


@contextmanager
def _in_style() -> Iterator[None]:
    """Draw in the common style, without warnings of missing glyphs, which hold control characters as they are."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph ", UserWarning)
        yield


@contextmanager
def styled(name: str) -> Iterator[None]:
    """Draw in the common style; the same name gives the same identifiers in an SVG."""
    import matplotlib as mpl

    with _in_style(), mpl.rc_context({"svg.hashsalt": name, "pdf.fonttype": 42}):
        yield


def laid_out(figure: Figure) -> Figure:
    """The figure with its final layout; `savefig` would draw it once more to compute this."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    from tripod_doe.page_parts.charts.log_axis_labels import write_powers_plainly

    FigureCanvasSVG(figure)
    write_powers_plainly(figure)
    figure.set_dpi(72)  # as in SVG
    if engine := figure.get_layout_engine():
        engine.execute(figure)
        figure.set_layout_engine(None)
    _draw_many_as_image(figure)
    return figure


def _draw_many_as_image(figure: Figure) -> None:
    """Draw large numbers of markers and cells as an image, and the rest of the figure as lines and text."""
    for axes in figure.axes:
        for line in axes.lines:
            if line.get_marker() not in ("None", "", " ", None):
                line.set_rasterized(np.size(line.get_xdata()) > _MOST_DRAWN)
        for drawn in axes.collections:
            values = drawn.get_array()
            cells = len(drawn.get_paths()) if values is None else np.size(values)
            drawn.set_rasterized(max(cells, np.size(drawn.get_offsets()) // 2) > _MOST_DRAWN)


def _inline(svg: str) -> str:
    """Strip parts that only a separate file needs; the other identifiers are salted with the chart's name."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style type=\"text/css\">.*?</style>", "", svg, flags=re.DOTALL)  # it would style the whole page
    used = set(re.findall(r"#([A-Za-z][\w-]*)", svg))
    svg = re.sub(r' id="([^"]*)"', lambda match: match[0] if match[1] in used else "", svg)
    return re.sub(r"#[0-9a-f]{6}\b(?=[;\"])", _variable, svg.strip())


def _variable(match: re.Match[str]) -> str:
    """A colour variable of the page; a separate file, without style sheet, keeps the light colour."""
    return f"var(--{VARIABLES[match[0]]}, {match[0]})" if match[0] in VARIABLES else match[0]


@contextmanager
def drawing(width: float, height: float) -> Iterator[tuple[Figure, Axes]]:
    """A figure with one pair of axes, drawn on in the common style; width and height in inches."""
    from matplotlib.figure import Figure

    with _in_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure, figure.add_subplot()


@contextmanager
def panels(count: int, columns: int, width: float, height: float) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of several panels that share their axes, in rows; width and height of one panel in inches."""
    from matplotlib.figure import Figure

    rows = -(-count // columns)
    with _in_style():
        figure = Figure(figsize=(columns * width, rows * height), layout="constrained")
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for unused in grid.ravel()[count:]:
            unused.set_axis_off()
        yield figure, list(grid.ravel()[:count])


def factor_ticks(axes: Axes, levels: NDArray[Any], logarithmic: bool = False) -> None:
    """Ticks of a factor along the bottom: its values, ascending, if they are few, else about five round numbers.

    Args:
        logarithmic: Whether the axis is logarithmic; it then has ticks at powers of ten if it spans several.
    """
    if logarithmic:
        axes.set_xscale("log")
    if levels.size <= _OWN_TICKS:
        axes.minorticks_off()
        axes.set_xticks(levels, [texts.replace("-", "\N{MINUS SIGN}") for texts in levels_apart(levels)])
        axes.set_xticks(levels, _labels_apart(axes, levels))
    elif not logarithmic or levels[-1] < _DECADES * levels[0]:
        from matplotlib.ticker import MaxNLocator, NullFormatter, StrMethodFormatter

        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        if logarithmic:
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())


def _labels_apart(axes: Axes, levels: NDArray[Any]) -> list[str]:
    """The tick labels at these levels; a label that would overlap another moves to a lower line."""
    places = axes.transData.transform(np.stack([levels, 0 * levels], axis=1))[:, 0]
    texts, ends = [], list[float]()  # where the next label of each line may start
    for place, label in zip(places, axes.get_xticklabels(), strict=True):
        width = label.get_window_extent().width
        line = next((at for at, end in enumerate(ends) if place - width / 2 >= end), len(ends))
        ends[line : line + 1] = [place + width / 2 + _LABEL_GAP]
        texts.append("\n" * line + label.get_text())
    return texts


def legend_above(axes: Axes, columns: int, title: str | None = None) -> None:
    """Put the legend above the axes, where it hides no data, in fewer columns if they are too wide."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    for fewer in range(columns, 0, -1):
        legend = axes.legend(
            loc="lower left",
            bbox_to_anchor=(0, 1.0),
            ncols=fewer,
            title=title,
            alignment="left",
            borderaxespad=0.3,
            handlelength=2.6,
            columnspacing=1.2,
            title_fontsize=8,
        )
        if legend.get_window_extent().width <= _LEGEND_SHARE * figure.bbox.width:
            break
