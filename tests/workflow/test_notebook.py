"""A run in a notebook: progress that lives, and a summary that is safe to show."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import pytest

import tripod_doe as td

STUDY = {
    "study": {"name": "<b>angles</b>"},
    "base": {"model": "equilibrium"},
    "factors": {"joint_angle_deg": {"values": [4, 8]}, "roller_width_mm": {"values": [11, 80]}},
    "run": {"block": 1},
}


@pytest.fixture
def cell(monkeypatch):
    """What a cell of a notebook shows, by stand-ins for IPython's three names."""
    shown = []
    outside, display = ModuleType("IPython"), ModuleType("IPython.display")
    outside.get_ipython = lambda: SimpleNamespace(kernel=object())
    display.HTML = lambda text: text
    display.display = lambda text, display_id: shown.append(text) or SimpleNamespace(update=shown.append)
    monkeypatch.setitem(sys.modules, "IPython", outside)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return shown


@pytest.mark.usefixtures("pages_not_made")
def test_a_notebook_shows_the_progress_and_the_summary(cell, tmp_path, capsys):
    summary = td.run(STUDY, tmp_path / "angles", workers=0)
    assert cell[0].startswith('<progress value="0" max="4"')
    assert cell[-1].startswith('<progress value="4" max="4"')
    assert capsys.readouterr().err == ""
    page = summary._repr_html_()
    assert "4 points computed, 0 reused" in page
    assert "<strong>jammed: 2 points</strong>" in page
    assert "angles/report/index.html" in page
    assert "<b>" not in page
