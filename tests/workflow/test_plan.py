"""The price of a workflow before anything runs, and files that are given to the wrong command."""

from __future__ import annotations

import shutil

import pytest
import xarray as xr
from choosing_chain import CHAIN as CHOOSING_CHAIN

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import TooLargeError
from tripod_doe.service.limits import Limits
from tripod_doe.service.requests import plans
from tripod_doe.service.requests.plans import plan_upload
from tripod_doe.study import plan
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.workflow.plan import plan_workflow
from tripod_doe.workflow.workflow import fed_study, load_workflow

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


def test_another_kind_of_design_in_a_step_leaves_keys_of_the_first_one(chain):
    """What grid does not read cannot be taken back by a step."""
    ranges = COAST.replace("values = [3, 11, 19]", "low = 3\nhigh = 19").replace(
        "values", "distribution = 'discrete'\nvalues"
    )
    (chain.parent / "coast.toml").write_text(f"{ranges}[design]\nkind = 'sobol'\nsamples = 8\nscramble = false\n")
    chain.write_text(CHAIN.replace("60 }", "60 }\ndesign = { kind = 'latin-hypercube' }"))
    assert {name: step.points for name, step in plan_workflow(chain, timing=False).steps.items()} == dict.fromkeys(
        ("coast", "drive"), 8
    )


FED = (
    CHAIN
    + """
[steps.effects]
kind = "effects"
inputs = ["coast"]
[steps.of_study]
kind = "study"
study = "two.toml"
inputs = ["coast"]
table = "coast"
[steps.of_analysis]
kind = "study"
study = "two.toml"
inputs = ["effects"]
table = "effects"
"""
)


def test_a_step_with_the_points_of_another_is_counted_by_these(chain):
    """Regression: 3,000 points of a better model were planned as the 2 of the study file."""
    (chain.parent / "two.toml").write_text(COAST.split("[factors.needle_count]")[0].replace("3, 11, 19", "3, 11"))
    chain.write_text(FED)
    steps = plan_workflow(chain, timing=False).steps
    assert {name: step.points for name, step in steps.items() if name != "drive"} == dict.fromkeys(
        ("coast", "of_study", "of_analysis"), 12
    )
    (chain.parent / "alone.toml").write_text(CHAIN.replace("coast.toml", "two.toml"))
    alone = plan_workflow(chain.parent / "alone.toml", timing=False).steps["coast"]
    assert steps["of_study"].cpu_hours == pytest.approx([6 * hours for hours in alone.cpu_hours])
    assert "at most 12 points, all of the step that it names" in steps["of_study"].warnings[-1]


CHOSEN = """
[study]
name = "chosen"
[base]
model = "auto"
[factors.joint_angle_deg]
[factors.torque_n_m]
[design]
kind = "table"
table = "points.csv"
[accuracy]
thrust_amplitude_3 = 0.05
"""


def test_a_choice_lists_the_points_of_the_study_that_it_names(chain):
    """Regression: it was reused after a change of their table, and a step fed by it counted as its pilot's points."""
    folder = chain.parent
    (folder / "pilot.toml").write_text(COAST)
    (folder / "study.toml").write_text(CHOSEN)
    chain.write_text(CHOOSING_CHAIN)
    hashes = set()
    for rows in (["4,50", "5,60", "6,70"], ["7,80", "9,90"]):
        (folder / "points.csv").write_text("\n".join(["joint_angle_deg,torque_n_m", *rows]))
        workflow = load_workflow(chain)
        hashes |= {workflow.steps[name].hash for name in ("choice", "map")}
        assert plan_workflow(chain, timing=False).steps["map"].points == len(rows)
    assert len(hashes) == 4


def test_a_step_with_the_points_of_another_keeps_accuracy_and_constraints(tmp_path):
    """Regression: it dropped both without a word."""
    text = COAST.split("[factors.needle_count]")[0].replace("equilibrium", "kinetostatic")
    limits = '[design]\nconstraints = ["joint_angle_deg < 12"]\n[accuracy]\nthrust_amplitude_3 = 0.001\n'
    (tmp_path / "study.toml").write_text(text + limits)
    study = load_study(tmp_path / "study.toml")
    fed = fed_study(study, xr.Dataset({"joint_angle_deg": ("point", [4.0, 13.0])}), "other")
    assert fed.file.accuracy == study.file.accuracy
    points = make_points(fed)
    assert points.columns["joint_angle_deg"][points.allowed].tolist() == [4.0]


TOLERANCE = """
[study]
name = "spread"
[base]
model = "equilibrium"
[factors.joint_angle_deg]
distribution = "normal"
mean = 8
std = 0.3
[design]
kind = "latin-hypercube"
samples = 16
[analysis.t]
kind = "tolerance"
confirm = 5000
limits = { thrust_amplitude_3 = 13 }
"""


def test_the_price_of_a_pilot_is_told_as_such(tmp_path, monkeypatch):
    """Regression: nothing in the plan of the service said that the samples of the split come on top.

    Models were judged at all points that a split may have, for ten seconds, and nobody saw the verdict.
    """
    records, judged = plan.model_records, []
    monkeypatch.setattr(plan, "model_records", lambda *asked: judged.append(int(asked[2].sum())) or records(*asked))
    design = '[design]\nkind = "multifidelity"\nsamples = 24\nseed = 1\n[factors.model]\nvalues = ["equilibrium", "kinetostatic"]\n[keep]\noutputs = ["thrust_amplitude"]'
    text = TOLERANCE.partition("[design]")[0].replace('model = "equilibrium"', "torque_n_m = 50") + design
    (tmp_path / "study.toml").write_text(text)
    planned = plan_upload(tmp_path, "study", Limits(), timing=False)
    assert (
        f"this is the price of the pilot: at most {planned['most_points']:,} points run in all" in planned["warnings"]
    )
    assert any(line.startswith("in all       CPU time at most about") for line in planned["choice"])
    assert max(judged) <= planned["points"] < planned["most_points"]


def test_a_cube_beyond_the_limit_is_refused_before_its_points_are_judged(tmp_path, monkeypatch):
    """Regression: a plan of many points that no model can run took 21 s to be refused."""
    (tmp_path / "study.toml").write_text(TOLERANCE)
    monkeypatch.setattr(plans, "plan_points", None)
    with pytest.raises(TooLargeError, match="bytes in its cubes; at most 1,000"):
        plan_upload(tmp_path, "study", Limits(cube_bytes=1000), timing=False)


def test_the_plan_of_an_upload_makes_its_points_once(tmp_path, monkeypatch):
    (tmp_path / "study.toml").write_text(TOLERANCE)
    monkeypatch.setattr("tripod_doe.study.plan.make_points", None)
    assert plan_upload(tmp_path, "study", Limits(), timing=False)["points"] == 16


def test_a_workflow_whose_pilot_may_take_all_points_says_what_to_set(tmp_path):
    """Regression: a chain of any study and one of several models was refused without a remedy."""
    several = """
        [study]
        name = "two models"
        [factors.joint_angle_deg]
        low = 5
        high = 12
        [factors.model]
        values = ["equilibrium", "kinetostatic"]
        [design]
        kind = "multifidelity"
        samples = 20
        [keep]
        outputs = ["thrust_amplitude"]
        """
    (tmp_path / "coast.toml").write_text(COAST)
    (tmp_path / "two.toml").write_text(several)
    steps = CHAIN.partition("[steps.page]")[0] + '[steps.two]\nkind = "study"\nstudy = "two.toml"\n'
    (tmp_path / "workflow.toml").write_text(steps)
    with pytest.raises(TooLargeError, match=r"allowed here: set most_points in \[design\] of two$"):
        plan_upload(tmp_path, "workflow", Limits(), timing=False)
    (tmp_path / "two.toml").write_text(several.replace("samples = 20", "samples = 20\n        most_points = 5000"))
    assert plan_upload(tmp_path, "workflow", Limits(), timing=False)["points"] == 24 + 120


def test_points_that_confirm_a_tolerance_are_counted(tmp_path, capsys):
    """Regression: neither the plan of a workflow nor the limits of the service knew of them."""
    (tmp_path / "study.toml").write_text(TOLERANCE)
    (tmp_path / "chain.toml").write_text(CHAIN.partition("[steps.drive]")[0].replace("coast.toml", "study.toml"))
    assert main(["plan", str(tmp_path / "chain.toml"), "--no-timing"]) == 0
    assert "coast: at most 5,000 points beyond these confirm proposals" in capsys.readouterr().out
    shutil.copy(tmp_path / "chain.toml", tmp_path / "workflow.toml")
    for kind, points in (("study", "most_points"), ("workflow", "points")):
        planned = plan_upload(tmp_path, kind, Limits(points=5016), timing=False)
        assert planned[points] == {"most_points": 5016, "points": 16}[points]
        assert "at most 5,000 points beyond these" in planned["warnings"][-1]
        with pytest.raises(TooLargeError, match="5,016 points; at most 5,015 are allowed here"):
            plan_upload(tmp_path, kind, Limits(points=5015), timing=False)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("thrust_amplitude_3 =", "thrust_amplitude_33 ="), "limits: 'thrust_amplitude_33' is no output or order of"),
        (("thrust_amplitude_3 =", "thrust_amplitud ="), "limits: 'thrust_amplitud' .* did you mean 'thrust_amplitude'"),
        (("confirm = 5000", "costs = { torque_n_m = 1 }"), "costs: 'torque_n_m' is no factor"),
        (("confirm = 5000", "costs = { joint_angle_deg = 0 }"), "costs.joint_angle_deg = 0: must be above 0"),
        (("confirm = 5000", "outputs = ['thrust_rms']"), "limits: 'thrust_amplitude_3' is no output or order of one"),
    ],
)
def test_a_limit_of_nothing_is_refused_before_any_point_runs(tmp_path, change, message):
    """Regression: the analysis failed when all points had been computed."""
    assert change[0] in TOLERANCE
    (tmp_path / "study.toml").write_text(TOLERANCE.replace(*change))
    with pytest.raises(td.InputError, match=message):
        plan_upload(tmp_path, "study", Limits(), timing=False)


def test_limits_of_responses_and_of_functions_stay_as_they_are(tmp_path):
    peak = TOLERANCE.replace("thrust_amplitude_3 = 13", "peak = 13, thrust_amplitude_2 = 3, thrust_amplitude = 9")
    (tmp_path / "study.toml").write_text(peak + '[responses.peak]\nformula = "max(abs(thrust))"\n')
    assert plan_upload(tmp_path, "study", Limits(), timing=False)["points"] == 16


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
