"""The price of a workflow before anything runs, and files that are given to the wrong command."""

from __future__ import annotations

import pytest

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.workflow.plan import plan_workflow

CHAIN = """
[workflow]
name = "coast"
[steps.coast]
kind = "study"
study = "coast.toml"
[steps.drive]
kind = "study"
study = "coast.toml"
base = { torque_n_m = 60 }
[steps.page]
kind = "report"
title = "both"
inputs = ["coast", "drive"]
[quick.drive]
factors = { joint_angle_deg = { values = [3] } }
"""
COAST = """
[study]
name = "coast"
[base]
model = "equilibrium"
torque_n_m = -60
[factors.joint_angle_deg]
values = [3, 11, 19]
[factors.needle_count]
values = [20, 27]
[factors.needle_diameter_mm]
values = [2, 3]
"""


@pytest.fixture
def chain(tmp_path):
    (tmp_path / "coast.toml").write_text(COAST)
    path = tmp_path / "chain.toml"
    path.write_text(CHAIN)
    return path


def test_a_workflow_costs_what_its_studies_cost(chain):
    whole, quick = (plan_workflow(chain, quick, timing=False) for quick in (False, True))
    assert {name: step.points for name, step in whole.steps.items()} == {"coast": 12, "drive": 12}
    assert {name: step.points for name, step in quick.steps.items()} == {"coast": 12, "drive": 4}
    prices = [step.cpu_hours for step in whole.steps.values()]
    assert whole.cpu_hours == pytest.approx([sum(ends) for ends in zip(*prices, strict=True)])
    assert quick.cpu_hours[1] < whole.cpu_hours[1]


def test_the_command_tells_the_sum_and_what_cannot_run(chain, capsys):
    assert main(["plan", str(chain), "--quick", "--workers", "3"]) == 0
    message = capsys.readouterr().out
    assert "16 points" in message
    assert "on 3 workers" in message
    assert "coast: 6 of 12 points jammed" in message  # needles of 3 mm
    assert not list(chain.parent.glob("*/"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["run", "chain.toml", "--out", "o"],
            "chain.toml: this is a workflow, not a study: `tripod-doe workflow` runs it",
        ),
        (
            ["workflow", "coast.toml", "--out", "o"],
            "coast.toml: this is a study, not a workflow: `tripod-doe run` runs it",
        ),
        (["plan", "coast.toml", "--quick"], "coast.toml is a study; only workflows have a [quick]"),
        (
            ["plan", "chain.toml", "--out", "o"],
            "chain.toml is a workflow, and only a study has models chosen by a pilot",
        ),
    ],
)
def test_a_file_given_to_the_wrong_command(chain, arguments, message, monkeypatch, capsys):
    monkeypatch.chdir(chain.parent)
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
    assert not (chain.parent / "o").exists()


def test_a_workflow_without_studies_is_refused_with_its_reason(tmp_path):
    path = tmp_path / "w.toml"
    path.write_text("[workflow]\nname = 'w'\n[steps.page]\nkind = 'report'\ntitle = 'p'\ninputs = ['none']\n")
    with pytest.raises(td.InputError, match="no step 'none'"):
        plan_workflow(path)
