"""Charts as separate files, and a printable page with one chart and text, drawn by matplotlib without a browser."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tripod_doe.page_parts.charts.chart import INK, MUTED, Chart, drawing, laid_out, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DOTS = 200  # per inch of a PNG
_PAGE = (8.27, 11.69)  # A4, inches
_MARGIN = 0.8
_LETTER = 0.55  # mean width of a letter of the font over its size
_POINT = 1 / 72  # inches
_LEADING = 1.4


@dataclass(frozen=True)
class Paragraph:
    """Some text of a page for print."""

    text: str
    size: float = 10.5  # points
    bold: bool = False
    quiet: bool = False
    gap: float = 0.12  # inches above it


def svg_file(chart: Chart) -> bytes:
    """A chart as an SVG file, with plain colours and selectable text."""
    buffer = io.BytesIO()
    with styled(chart.name):
        metadata = {"Date": None, "Creator": None, "Title": chart.title}
        laid_out(chart.figure).savefig(buffer, format="svg", metadata=metadata)
    return buffer.getvalue()


def png_file(chart: Chart) -> bytes:
    """A chart as a PNG file on white."""
    buffer = io.BytesIO()
    with styled(chart.name):
        laid_out(chart.figure).savefig(buffer, format="png", dpi=_DOTS, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def pdf_page(above: Sequence[Paragraph], chart: Chart | None, below: Sequence[Paragraph], title: str) -> bytes:
    """An A4 page with text, a chart and text; scales everything down if it does not fit.

    The page is built around the chart's figure, which thus stays vectors and text.
    """
    if chart is None:
        with drawing(_PAGE[0] - 2 * _MARGIN, 0.01) as (figure, axes):
            axes.set_axis_off()
        figure.set_layout_engine(None)  # there is nothing to lay out, of which matplotlib would warn
    else:
        figure = chart.figure
    with styled(title):
        laid_out(figure)
        width, height = figure.get_size_inches()
        scale = max(1.0, width / (_PAGE[0] - 2 * _MARGIN))
        while (needed := _height(above, scale) + _height(below, scale) + height) > scale * (_PAGE[1] - 2 * _MARGIN):
            scale *= max(1.02, needed / (scale * (_PAGE[1] - 2 * _MARGIN)))
        page, margin = (scale * _PAGE[0], scale * _PAGE[1]), scale * _MARGIN
        bottom = page[1] - margin - _height(above, scale) - height  # of the figure on the page
        texts = _write(figure, above, page[1] - margin - bottom, scale) + _write(figure, below, 0.0, scale)
        return _saved(figure, (-margin, -bottom, page[0] - margin, page[1] - bottom), texts, title)


def _saved(figure: Figure, box: tuple[float, float, float, float], texts: Sequence[Any], title: str) -> bytes:
    from matplotlib.transforms import Bbox

    buffer = io.BytesIO()
    try:
        metadata = {"Title": title, "Creator": None, "Producer": None, "CreationDate": None}
        figure.savefig(buffer, format="pdf", bbox_inches=Bbox.from_extents(*box), metadata=metadata)
    finally:
        for text in texts:
            text.remove()
    return buffer.getvalue()


def _lines(paragraph: Paragraph) -> list[str]:
    room = _PAGE[0] - 2 * _MARGIN
    letters = int(room / (_LETTER * (1.1 if paragraph.bold else 1.0) * paragraph.size * _POINT))
    return [line for part in paragraph.text.splitlines() for line in textwrap.wrap(part, letters) or [""]]


def _height(paragraphs: Sequence[Paragraph], scale: float) -> float:
    return scale * sum(p.gap + len(_lines(p)) * p.size * _LEADING * _POINT for p in paragraphs)


def _write(figure: Figure, paragraphs: Sequence[Paragraph], top: float, scale: float) -> list[Any]:
    """Write paragraphs from a height down, in inches above the lower edge of the figure."""
    height = figure.get_figheight()
    texts = []
    for paragraph in paragraphs:
        top -= scale * paragraph.gap
        for line in _lines(paragraph):
            texts.append(
                figure.text(
                    0,
                    top / height,
                    line,
                    va="top",
                    size=scale * paragraph.size,
                    weight="bold" if paragraph.bold else "normal",
                    color=MUTED if paragraph.quiet else INK,
                    clip_on=False,
                )
            )
            top -= scale * paragraph.size * _LEADING * _POINT
    return texts
