"""Numbers of a drawn point or bar that a browser shows under the pointer: SVG titles."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from tripod_doe.number_text import number

if TYPE_CHECKING:  # matplotlib is imported when something is drawn
    from matplotlib.artist import Artist
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_MOST = 400  # points and bars of a figure; with more, tooltips would only make the page larger
_MARK = "tips"


def mark_points(figure: Figure) -> dict[str, list[str]]:
    """Give the markers and bars of a figure identifiers, before it is drawn.

    Args:
        figure: With numeric axes; lines without markers have no points.

    Returns:
        By identifier, the text of each point in the order in which it is drawn.
    """
    texts: dict[str, list[str]] = {}

    def mark(artist: Artist, titles: list[str]) -> None:
        artist.set_gid(f"{_MARK}-{len(texts)}")
        texts[f"{_MARK}-{len(texts)}"] = titles

    for axes in figure.axes:
        scales = [_Scale(axes.xaxis), _Scale(axes.yaxis)]
        for line in axes.lines:
            if line.get_marker() not in ("None", "", " ", None):
                places = [place for place in np.asarray(line.get_xydata(), float).tolist() if math.isfinite(sum(place))]
                mark(line, [_tooltip(scales, line.get_label(), place) for place in places])
        for bars in axes.containers:
            across = getattr(bars, "orientation", "") == "horizontal"
            for bar in getattr(bars, "patches", ()):
                x, y = bar.get_x() + bar.get_width() / 2, bar.get_y() + bar.get_height() / 2
                place = [bar.get_width(), round(y)] if across else [round(x), bar.get_height()]
                mark(bar, [_tooltip(scales, bars.get_label(), place)])
    return texts if sum(map(len, texts.values())) <= _MOST else {}


class _Scale:
    """Label of an axis, and the names at its ticks where it has names."""

    def __init__(self, axis: Axis) -> None:
        self.label = axis.get_label_text()
        named = "Fixed" in type(axis.get_major_formatter()).__name__
        ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False) if named else ()
        self.names = {float(place): text.get_text() for place, text in ticks}

    def text(self, value: float) -> str:
        """A value with the label of the axis."""
        text = self.names.get(float(value)) or number(float(value))
        return f"{self.label}: {text}" if self.label else text


def _tooltip(scales: list[_Scale], series: object, place: list[float]) -> str:
    """Both coordinates, after the name of the series if it has one."""
    name = [] if str(series).startswith("_") else [str(series)]
    return "; ".join(name + [scale.text(value) for scale, value in zip(scales, place, strict=True)])


def add_tooltips(svg: str, texts: dict[str, list[str]]) -> str:
    """Put the texts into the drawn SVG; a line or bar with points that are not drawn gets no texts."""
    for name, titles in texts.items():
        start = svg.find(f'<g id="{name}"')
        end = svg.find("<g id=", start + 1)
        if 0 <= start < end:
            defined, mark, drawn = svg[start:end].rpartition("</defs>")  # markers are defined once and used
            drawn = _titled(drawn, titles, "use" if mark else "path")
            svg = svg[:start] + defined + mark + drawn + svg[end:]
    return svg


def _titled(drawn: str, titles: list[str], shape: str) -> str:
    """Give each of these shapes its text, if there are as many of both."""
    if len(re.findall(f"<{shape} [^>]*/>", drawn)) != len(titles):
        return drawn
    left: Iterator[str] = iter(titles)
    return re.sub(
        f"<{shape} ([^>]*)/>", lambda match: f"<{shape} {match[1]}><title>{escape(next(left))}</title></{shape}>", drawn
    )
