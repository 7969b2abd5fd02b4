"""A run in a notebook: progress, and a summary that is safe to show."""

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


@pytest.mark.usefixtures("pages_not_made")
def test_a_notebook_shows_the_progress_and_the_summary(monkeypatch, tmp_path, capsys):
    outside = ModuleType("IPython")  # a stand-in
    outside.get_ipython = lambda: SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", outside)
    summary = td.run(STUDY, tmp_path / "angles", workers=0)
    assert "4/4" in capsys.readouterr().err
    page = summary._repr_html_()
    assert "4 points computed, 0 reused" in page
    assert "<strong>jammed: 2 points</strong>" in page
    assert "angles/report/index.html" in page
    assert "<b>" not in page
