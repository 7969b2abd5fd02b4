"""The workflow of the paper: its file is sound, quick or not, and a tiny one with the same steps runs to its claims."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import tripod_doe as td
from tripod_doe.analyses.claims.rules import RULES
from tripod_doe.workflow.workflow import load_workflow

ROOT = Path(__file__).parents[2]

TINY = """
[workflow]
name = "Tiny"
[steps.cases]
kind = "study"
study = "{studies}/paper_cases.toml"
base = {{ model = "equilibrium", relative_tolerance = 1e-9 }}
[steps.joint_angle]
kind = "study"
study = "{studies}/joint_angle.toml"
[steps.joint_angle.factors]
model = {{ values = ["equilibrium"] }}
initial_skew_1_deg = {{ values = [0.2, 0.4] }}
initial_skew_2_deg = {{ values = [-0.2, -0.4] }}
initial_skew_3_deg = {{ values = [0.2, 0.4] }}
[steps.ablation]
kind = "study"
study = "{studies}/contribution.toml"
base = {{ model = "equilibrium" }}
[steps.friction]
kind = "study"
study = "{studies}/friction_law.toml"
[steps.shares]
kind = "contribution"
inputs = ["ablation"]
[steps.claims]
kind = "claims"
inputs = ["friction", "cases", "joint_angle", "ablation"]
settings = {{ model = "equilibrium" }}
[steps.waves]
kind = "figure"
figure = "waveforms-of-all"
inputs = ["cases"]
[steps.local]
kind = "figure"
figure = "local-orders"
inputs = ["cases"]
[steps.angle]
kind = "figure"
figure = "orders-over-angle"
inputs = ["joint_angle"]
[steps.bars]
kind = "figure"
figure = "contribution"
inputs = ["shares"]
[steps.law]
kind = "figure"
figure = "friction-law"
title = "Fig. 4: friction"
inputs = ["friction"]
[steps.spectrum]
kind = "figure"
figure = "spectrum-of-all"
title = "Fig. 13: orders"
inputs = ["cases"]
[steps.over_skew]
kind = "claims-over-skew"
inputs = ["cases"]
settings = {{ model = "equilibrium", skews_deg = [0.4, 0.8] }}
[steps.page]
kind = "report"
inputs = ["claims", "law", "waves", "spectrum", "local", "angle", "bars", "shares", "over_skew"]
[quick.joint_angle]
factors = {{ joint_angle_deg = {{ values = [4, 9, 14] }} }}
"""


@pytest.mark.parametrize("quick", [False, True])
def test_the_papers_workflow_is_sound(quick):
    workflow = load_workflow(ROOT / "workflows" / "paper.toml", quick)
    studies = {name: step.study for name, step in workflow.steps.items() if step.study}
    assert studies["cases"].base.get("needle_count", 27) == (19 if quick else 27)
    assert set(workflow.steps["claims"].inputs) <= set(studies)
    assert "claims" in workflow.steps["page"].inputs


def test_one_joint_decides_all_claims_of_the_paper():  # regression: each study has the same joint, each claim its points
    workflow = load_workflow(ROOT / "workflows" / "paper_joint.toml", quick=False)
    studies = {name: step.study for name, step in workflow.steps.items() if step.study}
    assert set(workflow.steps["claims"].inputs) == set(studies)
    of_joint = [study.base for study in studies.values() if study.simulator.name == "joint"]
    names = [name for name in of_joint[0] if name.startswith(("needle_", "bearing_", "groove_rolling", "pitch_"))]
    assert len(names) == 8
    assert all(base[name] == of_joint[0][name] for base in of_joint for name in names)


@pytest.mark.slow
@pytest.mark.usefixtures("charts_not_drawn")
def test_a_tiny_workflow_decides_its_claims_and_shows_them(tmp_path):
    """Claims that this model can decide are decided, the others stay open, and every figure stands on the page."""
    path = tmp_path / "tiny.toml"
    path.write_text(TINY.format(studies=(ROOT / "studies").as_posix()))
    summary = td.run_workflow(path, tmp_path / "out", quick=True, workers=0, progress=False)
    assert {step.name: step.detail for step in summary.steps if step.state != "finished"} == {}
    assert summary.reports == (tmp_path / "out" / "quick" / "page" / "index.html",)
    table = tmp_path / "out" / "quick" / "claims.json"
    claims = {record["claim"]: record for record in json.loads(table.read_text())["claims"]}
    assert list(claims) == [rule.name for rule in RULES]
    for name in (
        "friction_from_rest",
        "third_order_dominant",
        "third_linear_in_angle",
        "beat_turned",
        "share_groove_rolling",
    ):
        assert claims[name]["holds"] is True, claims[name]
    assert claims["third_independent_of_speed"]["holds"] is None
    assert claims["skew_stays"]["holds"] is None  # this model has no needles whose skew could change
    for page in (summary.page, tmp_path / "out" / "quick" / "page" / "index.html"):
        text = page.read_text()
        assert "The third order is clearly visible" in text
        assert "not decided" in text
    section = text[text.index('<section id="spectrum">') :]
    section = section[: section.index("</section>")]
    assert "Fig. 13: orders" in section
    assert "more visible than the fourth" in section  # the claim stands beside the figure that shows it
    assert "straight line" not in section
    table.unlink()  # a table that went missing is made again
    again = td.run_workflow(path, tmp_path / "out", quick=True, workers=0, progress=False)
    assert {step.name for step in again.steps if step.state == "finished"} >= {"claims"}
    assert table.exists()
    assert {step.state for step in again.steps if step.name == "cases"} == {"reused"}


HALVED = """
[workflow]
name = "Halved"
[steps.frictions]
kind = "study"
study = "frictions.toml"
[steps.torques]
kind = "study"
study = "torques.toml"
[steps.claims]
kind = "claims"
inputs = ["frictions", "torques"]
settings = { model = "equilibrium" }
"""

CASE_2 = """
[study]
name = "t"
[base]
model = "equilibrium"
initial_skew_1_deg = 0.4
initial_skew_2_deg = -0.4
initial_skew_3_deg = 0.4
[factors]
"""


@pytest.mark.slow
def test_a_study_with_failed_points_leaves_its_claims_open_and_no_others(tmp_path):
    """29 needles do not fit on their pitch circle: that study fails, and what it would decide stays open."""
    (tmp_path / "halved.toml").write_text(HALVED)
    (tmp_path / "frictions.toml").write_text(CASE_2 + "groove_sliding_friction = { values = [0.025, 0.05, 0.1] }\n")
    torques = CASE_2 + "torque_n_m = { values = [25, 50, 100] }\n"
    (tmp_path / "torques.toml").write_text(torques.replace("[factors]", "needle_count = 29\n[factors]"))
    summary = td.run_workflow(tmp_path / "halved.toml", tmp_path / "out", workers=0, progress=False)
    assert {step.name: step.state for step in summary.steps} == {
        "frictions": "finished",
        "torques": "failed",
        "claims": "finished",
    }
    assert not summary.good
    claims = {
        record["claim"]: record for record in json.loads((tmp_path / "out" / "claims.json").read_text())["claims"]
    }
    assert claims["third_follows_groove_friction"]["holds"] is True
    assert claims["third_proportional_to_torque"]["holds"] is None
    assert "jammed" in claims["third_proportional_to_torque"]["reason"]
    (tmp_path / "torques.toml").write_text(torques.replace("[factors]", "needle_count = 30\n[factors]"))
    again = td.run_workflow(tmp_path / "halved.toml", tmp_path / "out", workers=0, progress=False)
    assert {step.name: step.state for step in again.steps}["claims"] == "blocked"  # that cube is of another study
    assert not (tmp_path / "out" / "claims.json").exists()  # it was of the study before
