from __future__ import annotations

import re

import xarray as xr

from tripod_doe.analyses.kinds import is_study
from tripod_doe.reports import workflow_report as chain
from tripod_doe.reports.workflow_report import StepView, chain_page, step_page

STEPS = [
    StepView("map", "study", (), "reused", 300.0, "52 points", "../steps/map/report/index.html"),
    StepView("waves", "figure", ("map",), "finished", 0.5),
    StepView("friction", "study", (), "failed", 2.0, "2 points ended as <jammed>"),
    StepView("indices", "sobol", ("friction",), "blocked", None, "needs friction"),
    StepView("page", "report", ("map", "waves", "indices"), "blocked"),
]


def test_the_page_links_escapes_and_warns():
    page = chain_page("A <chain>", "", STEPS, notice="Quick run: no results.", text="[workflow]")
    assert 'href="../steps/map/report/index.html">52 points' in page
    assert "2 points ended as &lt;jammed&gt;" in page
    assert '<td class="name">reused</td><td class="value">5 min</td>' in page
    assert "<td>map, waves, indices</td>" in page
    assert "A &lt;chain&gt;" in page
    assert "Quick run: no results." in page
    assert page == chain_page("A <chain>", "", STEPS, notice="Quick run: no results.", text="[workflow]")


def test_analyses_answer_before_studies_and_sections_have_names_of_their_own(monkeypatch):
    """Regression: the travel of two scenes was what a comparison of methods answered, under two equal headings."""
    findings = {
        "steady": ["Steady is told."],
        "turning_back": ["Turning is told."],
        "prices": ["Prices are first. Units are next.", "Ratios are third.", "Failures are not."],
    }
    monkeypatch.setattr(chain, "findings_of", lambda name, _: findings[name])
    study = xr.Dataset(attrs={"title": "needle"})
    assert is_study(study)
    data = {"steady": study, "turning_back": study, "prices": xr.Dataset(attrs={"analysis_kind": "sobol"})}
    page = step_page("Speed", "?", list(data), data, {})
    answer = page[page.index("<h2>Answer</h2>") : page.index("</section>")]
    assert re.findall("<p>(.*?)</p>", answer) == ["Prices are first.", "Units are next.", "Ratios are third."]
    assert re.findall("<h2[^>]*>(needle.*?)<", page) == ["needle: steady", "needle: turning back"]
