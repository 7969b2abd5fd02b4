"""Studies with model = "auto": pilot, frozen choice, study; and the same as a chain of steps."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from choosing_chain import CHAIN
from few import FEW
from wave_bench import STUDY, WAVE, Bench

import tripod_doe as td
from started import Process
from tripod_doe.analyses.model_choice.growing_pilot import first_candidates
from tripod_doe.analyses.model_choice.pilot import pilot_points, pilot_results, pilot_study
from tripod_doe.analyses.model_choice.study_choice import describe_choice
from tripod_doe.cli import main
from tripod_doe.model_interface import WORK, BlockResult, Values
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.journal import PILOT, FinishedBlock, Journal
from tripod_doe.study.study_points import StudyPoints

pytestmark = pytest.mark.usefixtures("pages_not_made")

JOINT = """
[study]
name = "joint"
[base]
model = "auto"
[factors]
joint_angle_deg = {low = 5, high = 12, count = 20}
[keep]
outputs = ["thrust", "thrust_amplitude"]
[accuracy]
thrust_amplitude_3 = 0.04
confidence = 0.75
"""


@pytest.fixture
def wave(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    return Bench(tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("charts_not_drawn")
def test_a_study_runs_on_the_candidates_that_its_pilot_chose(wave):
    """Exact: which points ran on which candidate and how often; again, grown, and with other demands."""
    first = wave.run(STUDY)
    assert first.good
    assert "The model was chosen for each point" in td.write_report(wave.folder / "out").read_text()
    cube, choice = td.open_cube(wave.folder / "out"), xr.open_dataset(wave.folder / "out" / "choice.nc").load()
    assert cube["y"].dims == ("x", "z")
    exact = 10 + cube["x"]
    assert float((abs(cube["y"] - exact) <= 0.03 * exact).mean()) >= 0.9
    assert set(np.unique(cube["model_used"])) == {0, 1}  # the substitute paid, the full model was not needed
    assert np.array_equal(cube["model_used"].values.ravel(), choice["model"].values)
    assert (cube["accuracy_met"] == 1).all()
    assert (cube["y_error_estimate"] <= 0.03).all()
    assert "model" not in cube.attrs["fixed_parameters"]
    log = wave.calls()
    assert len(log) == 33 + 9 * 2  # three candidates at nine pilot points, one of which the study takes over
    assert len(set(log)) == len(log)  # nothing ran twice
    assert (first.computed, first.reused) == (24, 9)
    assert int(cube["from_pilot"].sum()) == choice.attrs["points_from_pilot"] == 9
    alone = cube["y"] / exact - 1  # what the function says of every point with the model that the cube says it used
    steep = 0.002 + 0.2 * (cube["x"] > 0.5)
    np.testing.assert_allclose(alone, xr.where(cube["model_used"] == 0, steep, 0.01), atol=1e-12)
    own = choice["price"].values[choice["candidate"].values][cube["from_pilot"].values.ravel() == 0]
    assert choice.attrs["price_study_s"] == pytest.approx(own.sum())

    again = wave.run(STUDY)
    assert (again.computed, again.reused) == (0, 33)
    assert wave.calls() == log

    grown = wave.run(STUDY.replace("[0, 1, 2]", "[0, 1, 2, 3]"))
    assert (grown.computed, grown.reused) == (11, 33)
    assert len(wave.calls()) == len(log) + 11  # no further pilot
    old = td.open_cube(wave.folder / "out").sel(z=[0, 1, 2])
    xr.testing.assert_equal(old["model_used"], cube["model_used"])

    before = (wave.folder / "out" / "choice.nc").read_bytes()
    for change, message in (
        (("y = 0.03", "y = 0.02"), r"accuracy\.y: 0\.03 -> 0\.02"),
        (('model = "auto"', 'model = "auto"\nslow = 0.001'), r"base\.slow: not set -> 0\.001"),
    ):
        with pytest.raises(td.InputError, match=message):
            wave.run(STUDY.replace("[0, 1, 2]", "[0, 1, 2, 3]").replace(*change))
    assert (wave.folder / "out" / "choice.nc").read_bytes() == before


@pytest.mark.slow
def test_the_pilot_takes_a_finer_tolerance_where_the_full_model_is_not_accurate_enough(wave):
    """Model 2 is 2 % off by its own estimate: not enough for 1 %, so model 3 is the reference."""
    text = STUDY.replace("y = 0.03", "y = 0.012")
    assert [
        candidate.values["model"] for candidate in first_candidates(td.load_study(wave.write(text)).auto_model)
    ] == [0, 2]
    assert wave.run(text).good
    choice = xr.open_dataset(wave.folder / "out" / "choice.nc").load()
    assert choice["candidate_label"].values[-1] == "model = 3"
    assert (choice["accuracy_met"] == 1).all()


@pytest.mark.slow
def test_a_finer_tolerance_is_tried_only_where_the_full_model_is_not_accurate_enough(wave):
    """Model 2 knows itself to 2 % on the right and to 0.1 % on the left: there it is its own reference."""
    path = wave.folder / f"{wave.module}.py"
    path.write_text(WAVE.replace("if model == 2 else", "if model == 2 and x > 0.5 else"))
    assert wave.run(STUDY.replace("y = 0.03", "y = 0.012")).good
    calls = [[float(word) for word in line.split()] for line in wave.calls()]
    finest, piloted = ([x for x, _, used in calls if used == model] for model in (3, 2))
    assert 0 < len(finest) == sum(x > 0.5 for x in piloted) < len(piloted)
    assert min(finest) > 0.5
    choice = xr.open_dataset(wave.folder / "out" / "choice.nc").load()
    assert choice["candidate_label"].values[-1] == "model = 3"
    assert choice.attrs["price_pilot_s"] == pytest.approx(len(piloted) * (1 + 1e-3 + 1e-6) + 3 * len(finest), rel=1e-3)
    cube = td.open_cube(wave.folder / "out")
    exact = 10 + cube["x"]
    assert (abs(cube["y"] - exact) <= 0.012 * exact).all()


@pytest.mark.slow
def test_a_kill_in_the_pilot_loses_nothing_and_changes_nothing(wave):
    """kill -9 in the pilot: only what was at work runs twice; choice and cube are those of an undisturbed run."""
    text = STUDY.replace('model = "auto"', 'model = "auto"\nslow = 0.1') + "[run]\nblock = 1\n"
    out = wave.folder / "killed"
    command = ["-m", "tripod_doe.cli", "run", str(wave.write(text)), "--out", str(out), "--workers", "0"]
    process = Process(command, os.environ | {"PACE": "1"}, quiet=True)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and len(wave.calls()) < 8:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert len(wave.calls()) >= 8
    assert not (out / "choice.nc").exists()
    assert wave.run(text, "killed").good
    assert len(wave.calls()) <= 33 + 2 * 9 + 1  # lost: what was at work
    assert wave.run(text, "whole").good
    killed, whole = (
        td.open_cube(wave.folder / name)[["y", "model_used", "from_pilot"]] for name in ("killed", "whole")
    )
    xr.testing.assert_equal(killed, whole)


def test_points_of_the_pilot_bring_their_retries_and_only_what_the_study_keeps(wave):
    """The outputs of a user function are known only from its answer, so the pilot holds more than the study asks for."""
    kept = STUDY + '[keep]\noutputs = ["y"]\n[run]\nretry = [{slow = 0.001}]\n'
    assert wave.run(kept).good
    cube = td.open_cube(wave.folder / "out")
    assert "y" in cube
    assert "y_error" not in cube
    assert (cube["attempt"] == 0).all()
    assert (cube["first_outcome"] == td.Outcome.FINISHED).all()
    assert (cube["slow_used"] == 0).all()
    assert set(np.unique(cube["model_used"])) == {0, 1}
    assert len(set(wave.calls())) == len(wave.calls())


def test_points_of_the_pilot_bring_their_own_counts(wave, tmp_path):
    """Exact: every array of a block is cut to the rows that the study lacks, in their order."""
    study = td.load_study(wave.write(STUDY))
    asked = StudyPoints(study, replace(make_points(study), chosen={"model": np.zeros(33)}))
    keys = asked.keys
    counts = np.arange(5)
    outcome = np.array([0, 0, td.Outcome.ERROR, 0, 0], np.int8)
    names = [f"detail {i}" for i in counts]
    y = {"y": Values((), counts * 1.0)}
    result = BlockResult(outcome=outcome, detail=names, outputs=y, **dict.fromkeys(WORK, counts))
    with Journal(tmp_path) as journal:
        journal.commit(FinishedBlock(keys[counts], result, 5.0, 10.0, "0"))
    (block,) = pilot_results(asked, np.array([7, 4, 2, 1]), tmp_path)
    taken = [1, 4]  # 2 failed, and 7 is not in the pilot
    assert block.keys.tolist() == keys[taken].tolist()
    assert all(getattr(block.result, name).tolist() == taken for name in WORK)
    assert block.result.outputs["y"].data.tolist() == taken
    assert block.result.detail == [names[i] for i in taken]
    assert (block.cpu_seconds, block.wall_seconds, block.worker) == (2, 4, PILOT)


@pytest.mark.slow
def test_a_point_that_failed_in_the_pilot_is_run_by_the_study(wave):
    """The full model dies at x = 1, where nothing cheaper is enough; the study, not its pilot, has a retry that helps."""
    path = wave.folder / f"{wave.module}.py"
    dying = "    if x == 1 and model >= 2 and not slow:\n        1 / 0"
    text = "\n".join(dying if "time.sleep" in line else line for line in WAVE.splitlines())
    assert dying in text
    path.write_text(text)
    text = STUDY.replace("y = 0.03", "y = 0.0015") + "[run]\nretry = [{slow = 0.001}]\n"
    assert wave.run(text).good
    cube = td.open_cube(wave.folder / "out")
    assert (cube["outcome"] == td.Outcome.FINISHED).all()
    assert (cube["attempt"].sel(x=1) == 1).all()
    assert (cube["from_pilot"].sel(x=1) == 0).all()
    assert (cube["from_pilot"].sel(x=0) == 1).any()


def test_pilot_points_are_the_same_each_time_and_reach_the_edges(wave):
    study = td.load_study(wave.write(STUDY))
    points = make_points(study)
    chosen = pilot_points(study, points)
    assert np.array_equal(chosen, pilot_points(study, points))
    places = {(float(points.columns["x"][i]), float(points.columns["z"][i])) for i in chosen}
    assert {(0, 0), (0, 2), (1, 0), (1, 2), (0.5, 1)} <= places
    cheap, substitute, *_ = study.auto_model.candidates
    pilot = pilot_study(study, points, [(cheap, chosen), (substitute, chosen[:2])])
    assert make_points(pilot).count == chosen.size + 2


def test_a_pilot_leaves_out_halved_frictions_that_only_an_ablation_has():
    """Regression: the middle of such a design has a switch of 0.5, and the pilot was refused for it."""
    design = (
        '[factors]\njoint_angle_deg = { low = 4, high = 12, count = 6 }\n[design]\nkind = "ablation"\nhalved = true'
    )
    study = td.load_study(
        tomllib.loads(f'[study]\nname = "h"\n[base]\nmodel = "auto"\n[accuracy]\nthrust_amplitude_3 = 0.1\n{design}\n')
    )
    points = make_points(study)
    chosen = pilot_points(study, points)
    assert chosen.size
    assert make_points(pilot_study(study, points, [(study.auto_model.candidates[0], chosen)])).count == chosen.size


@pytest.mark.slow
def test_plan_tells_the_price_before_and_the_choice_after(wave, capsys):
    study = wave.write(STUDY)
    assert main(["plan", str(study), "--no-timing", "--out", str(wave.folder / "out")]) == 0
    before = capsys.readouterr().out
    assert "9 points on 2 candidates, CPU time about 9 s" in before
    assert "price        known after the choice" in before
    wave.run(STUDY)
    assert main(["plan", str(study), "--out", str(wave.folder / "out")]) == 0
    after = capsys.readouterr().out
    assert "from 9 pilot points" in after
    assert "model = 1" in after
    assert "99 with the last candidate" not in before
    assert describe_choice(td.load_study(study), wave.folder / "out") in after


@pytest.mark.slow
def test_a_budget_that_is_too_small_stops_before_the_study(wave):
    with pytest.raises(td.InputError, match=r"budget_cpu_s = 5: the pilot alone would take about 9"):
        wave.run(STUDY + "budget_cpu_s = 5\n")
    assert wave.calls() == []
    with pytest.raises(td.InputError, match=r"budget_cpu_s = 50: pilot and study would take about 57 s of CPU"):
        wave.run(STUDY.replace("y = 0.03", "y = 0.0015") + "budget_cpu_s = 50\n")
    assert not (wave.folder / "out" / "choice.nc").exists()


def test_a_pilot_counts_the_points_that_it_can_take():
    """Regression: "too few points for a pilot, 68 of at least 58", of which 20 had a friction halved."""
    ablated = JOINT.replace("count = 20", "count = 4") + '[design]\nkind = "ablation"\n'
    studies = [parse_study(text) for text in (ablated + 'combinations = "single"\nhalved = true\n', JOINT)]
    few, none = (describe_choice(study, None) for study in studies)
    assert re.search(r"48 of at least \d+ \(without repeated ones and those with a friction halved\)", few)
    assert "too few" not in none


def test_a_study_of_few_points_runs_the_full_model_without_a_pilot(wave):
    """Regression: "from 0 pilot points; ...: in cross-validation 0 of these points miss the accuracy"."""
    few = STUDY.replace("count = 11", "count = 3")
    before = describe_choice(td.load_study(wave.write(few)), None)
    assert re.search(r"too few points for a pilot, \d+ of at least 18: model = 2 everywhere, CPU time about", before)
    assert wave.run(few).good
    after = describe_choice(td.load_study(wave.write(few)), wave.folder / "out")
    assert after.startswith("choice       too few points for a pilot: model = 2 at all ")
    assert "cross-validation" not in after
    cube = td.open_cube(wave.folder / "out")
    assert (cube["model_used"] == 2).all()
    assert (cube["accuracy_met"] == -1).all()
    assert not (wave.folder / "out" / "pilot").exists()


def test_what_a_study_sets_itself_is_not_chosen(write_study):
    own = td.load_study(
        write_study(JOINT.replace("[factors]", "needle_count = 19\nrelative_tolerance = 1e-3\n[factors]"))
    )
    assert own.auto_model.parameters == ("model",)
    assert [candidate.label for candidate in own.auto_model.candidates] == [
        f"model = {name}" for name in ("equilibrium", "kinetostatic", "rollers", "needles")
    ]
    assert own.auto_model.candidates[-1].full


@pytest.mark.slow
def test_the_joint_chooses_its_cheapest_model_where_that_is_enough(write_study, tmp_path):
    """4 % on the third order: the balance of forces is within 3 % of the full model from 5 to 12 deg, nine needles or 27.

    What runs is the whole way of the joint: a pilot on four models at five points, the choice, the study.
    """
    few = FEW | {"cycles": 3, "torque_n_m": 150}
    base = "".join(f"{name} = {value}\n" for name, value in few.items())
    study = write_study(JOINT.replace("[factors]", base + "[factors]"))
    assert td.run(study, tmp_path / "out", workers=0, progress=False).good
    cube = td.open_cube(tmp_path / "out")
    words = dict(zip(cube["model_used"].flag_values, cube["model_used"].flag_meanings.split(), strict=True))
    used = [words[flag] for flag in cube["model_used"].values]
    assert used.count("equilibrium") >= 15
    piloted = cube["from_pilot"].values == 1
    assert 0 < piloted.sum() < 20
    for at in (used.index("equilibrium"), int(np.flatnonzero(piloted & (np.array(used) == "equilibrium"))[0])):
        alone = td.simulate(model="equilibrium", joint_angle_deg=float(cube["joint_angle_deg"][at]), **few)
        assert np.array_equal(cube["thrust_amplitude"].values[at], alone["thrust_amplitude"].values)
        assert np.array_equal(cube["thrust"].values[at], alone["thrust"].values)  # no demand of the accuracy


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "thrust_amplitude_3 =",
            "thrust_amplitud_3 =",
            r"\[accuracy\]: thrust_amplitud_3.*did you mean 'thrust_amplitude_3'",
        ),
        (
            "thrust_amplitude_3 =",
            "energy_residual =",
            r"\[accuracy\]: energy_residual: not a quantity with a known numerical error",
        ),
        ("= 0.04", "= 4", r"thrust_amplitude_3 = 4: a relative error lies between 0 and 1"),
        ("= 0.04", '= "small"', r"\[accuracy\]: thrust_amplitude_3 = 'small'"),
        ("thrust_amplitude_3 = 0.04\n", "", r"\[accuracy\]: name what must be accurate"),
        ('model = "auto"', 'model = "rollers"', r'confidence: used with model = "auto" only'),
        ("confidence = 0.75", "confidence = 1.5", r"\[accuracy\]: confidence = 1.5"),
        ('model = "auto"', 'model = "autos"', r"model = 'autos'"),
        (
            'name = "joint"',
            'name = "plates"\nscene = "needle-between-plates"',
            r'model = "auto": needle-between-plates: it has one model; name the model',
        ),
    ],
)
def test_bad_requests_are_refused_before_anything_runs(write_study, old, new, message):
    text = JOINT.replace(old, new).replace("joint_angle_deg", "load_n" if "plates" in new else "joint_angle_deg")
    text = text.replace(
        'outputs = ["thrust", "thrust_amplitude"]', "" if "plates" in new else 'outputs = ["thrust_amplitude"]'
    )
    with pytest.raises(td.InputError, match=message):
        td.load_study(write_study(text))


PILOT_STUDY = """
[study]
name = "pilot"
function = "wave:wave"
[factors]
x = {low = 0, high = 1, count = 9}
z = {values = [0, 2]}
model = {values = [0, 1, 2]}
"""


@pytest.mark.slow
def test_a_chain_chooses_from_a_pilot_of_its_own(wave):
    wave.write(STUDY)
    wave.write(PILOT_STUDY, "pilot.toml")
    chain = wave.write(CHAIN, "chain.toml")
    done = td.run_workflow(chain, wave.folder / "out", workers=0, progress=False)
    assert done.good, done.steps
    cube = td.open_cube(wave.folder / "out" / "steps" / "map")
    assert set(np.unique(cube["model"])) == {0, 1}
    assert cube.sizes["point"] == 33
    assert [step.state for step in td.run_workflow(chain, wave.folder / "out", workers=0, progress=False).steps] == [
        "reused"
    ] * 3
    with pytest.raises(td.InputError, match=r"\[steps\.map\]: table = 'pilots': not one of its inputs"):
        td.run_workflow(
            wave.write(CHAIN.replace('table = "choice"', 'table = "pilots"'), "bad.toml"), wave.folder / "out"
        )
    lame = CHAIN.replace('settings = { study = "study.toml" }', 'settings = { study = "pilot.toml" }')
    bad = td.run_workflow(wave.write(lame, "lame.toml"), wave.folder / "lame", workers=0, progress=False)
    assert [step.state for step in bad.steps] == ["finished", "failed", "blocked"]
    assert "the study names its model" in bad.steps[1].detail
