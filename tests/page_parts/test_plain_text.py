"""Texts of a study in charts: drawn as they are written, never read as formulas (regression: it ended the run)."""

from __future__ import annotations

import pandas as pd
import pytest

from tripod_doe.page_parts.charts.chart import Chart, drawing
from tripod_doe.page_parts.charts.files import Paragraph, pdf_page, png_file, svg_file

HOSTILE = r"$\frac{$ x^{ $"


@pytest.fixture
def chart():
    with drawing(4, 3) as (figure, axes):
        axes.plot([1, 2], [1e-4, 2e3], label=HOSTILE)
        axes.set_yscale("log")
        axes.set_xscale("log", base=2)
        axes.set_xlabel(HOSTILE)
        axes.set_title(HOSTILE)
        axes.text(1, 1, HOSTILE)
        axes.legend()
    return Chart("one", HOSTILE, "caption", figure, pd.DataFrame())


def test_dollars_are_dollars(chart):
    assert chart.svg().count("frac{$") >= 4
    assert svg_file(chart).decode().count("frac{$") >= 4
    assert png_file(chart).startswith(b"\x89PNG")
    assert pdf_page([Paragraph(HOSTILE)], chart, [], HOSTILE).startswith(b"%PDF-")


def test_powers_are_plain_text(chart):
    """Exact: 10 to the -3 and 2 to the 1."""
    text = chart.svg()
    assert "10⁻³" in text
    assert "2¹" in text
    assert "mathdefault" not in text
