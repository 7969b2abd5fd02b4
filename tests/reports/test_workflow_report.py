from __future__ import annotations

import re

import xarray as xr

from tripod_doe.analyses.kinds import is_study
from tripod_doe.reports import workflow_report as chain
from tripod_doe.reports.workflow_chart import StepView, _arrows, _places, chain_chart
from tripod_doe.reports.workflow_report import chain_page, step_page

STEPS = [
    StepView("map", "study", (), "reused", 300.0, "52 points", "../steps/map/report/index.html"),
    StepView("waves", "figure", ("map",), "finished", 0.5),
    StepView("friction", "study", (), "failed", 2.0, "2 points ended as <jammed>"),
    StepView("indices", "sobol", ("friction",), "blocked", None, "needs friction"),
    StepView("page", "report", ("map", "waves", "indices"), "blocked"),
]


def test_every_step_is_right_of_what_it_needs_and_boxes_do_not_overlap():
    place = _places(STEPS)
    assert len(set(place.values())) == len(STEPS)
    assert all(place[needed][0] < place[step.name][0] for step in STEPS for needed in step.inputs)


def test_arrows_that_follow_from_others_are_left_out():
    assert _arrows(STEPS) == [("map", "waves"), ("friction", "indices"), ("waves", "page"), ("indices", "page")]


def test_the_picture_names_steps_states_and_times():
    chart = chain_chart(STEPS)
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", chart.svg())
    assert {"map", "study · reused · 5 min", "figure · finished · 0.5 s", "sobol · blocked"} <= set(texts)
    assert "Failed: friction" in chart.caption
    assert chart.data["state"].tolist() == [step.state for step in STEPS]


def test_the_page_links_escapes_and_warns():
    page = chain_page("A <chain>", "", STEPS, notice="Quick run: no results.", text="[workflow]")
    assert 'href="../steps/map/report/index.html">52 points' in page
    assert "2 points ended as &lt;jammed&gt;" in page
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
