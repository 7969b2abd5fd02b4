"""Retries: followed in order, recorded per point, its work counted, the same however the study runs."""

from __future__ import annotations

import os
import signal
import sys
import time

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from started import Process
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task, run_task
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import FinishedBlock

pytestmark = pytest.mark.usefixtures("pages_not_made")

FRAGILE = """
import os, time
calls = []
def fragile(x, step_s=0.8, method=0, slow=0.0):
    with open(os.environ.get("RETRY_LOG", os.devnull), "a") as log:
        log.write(f"{x} {step_s} {method}\\n")
    time.sleep(slow)
    if step_s > x and method != 1:
        raise ValueError(f"step {step_s} above {x}")
    return {"y": 100 * method + step_s}
"""
STUDY = """
[study]
name = "fragile"
function = "fragile:fragile"
[factors.x]
values = [1.0, 0.5, 0.3, 0.1]
[run]
retry = ["smaller-step", "smaller-step", { method = 1 }]
"""
JOINT = """
[study]
name = "steep"
[base]
model = "rollers"
relative_tolerance = 4e-3
samples_per_revolution = 60
[factors]
joint_angle_deg = {values = [10, 40]}
[keep]
outputs = ["thrust_amplitude", "thrust_amplitude_error"]
[run]
retry = ["smaller-step", {model = "equilibrium"}]
"""


@pytest.fixture
def fragile(tmp_path, monkeypatch):
    (tmp_path / "fragile.py").write_text(FRAGILE)
    monkeypatch.setenv("RETRY_LOG", str(tmp_path / "log"))
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    sys.modules.pop("fragile", None)


def cube_of(text, folder=None, blocks=1):
    study = parse_study(text, folder=StudyFolder(folder))
    points = make_points(study)
    keys = point_keys(study, points)
    finished = []
    for chosen in np.array_split(np.arange(points.count), blocks):
        result, cpu, wall = run_task(make_task(study, points, chosen))
        finished.append(FinishedBlock(keys[chosen], result, cpu, wall, "0"))
    return build_cube(study, points, keys, iter(finished))


def test_changes_are_made_in_order_each_on_top_of_those_before(fragile):
    cube, cost = cube_of(STUDY, fragile)
    assert cube["attempt"].values.tolist() == [0, 1, 2, 3]
    assert cube["step_s_used"].values.tolist() == [0.8, 0.4, 0.2, 0.2]
    assert cube["y"].values.tolist() == [0.8, 0.4, 0.2, 100.2]
    assert (cube["outcome"] == td.Outcome.FINISHED).all()
    assert cube["first_outcome"].values.tolist() == [0, 11, 11, 11]
    assert "step 0.8 above 0.5" in str(cube["first_outcome_detail"].values[1])
    assert cube["outcome_detail"].values.tolist() == [""] * 4
    assert cost["force_evaluations"].values.tolist() == [1, 2, 3, 4]  # one call an attempt
    flags = dict(zip(cube["attempt"].flag_meanings.split(), cube["attempt"].flag_values, strict=True))
    assert flags == {"not_run": -1, "first": 0, "1_smaller-step": 1, "2_smaller-step": 2, "3_method_1": 3}


def test_a_point_that_no_change_helps_keeps_its_first_outcome_and_tells_all(fragile):
    cube, _ = cube_of(STUDY.replace(", { method = 1 }", ""), fragile)
    last = cube.isel(x=3)
    assert int(last["outcome"]) == td.Outcome.ERROR
    assert int(last["attempt"]) == 2
    detail = str(last["outcome_detail"].values)
    assert (
        detail.index("step 0.8") < detail.index("smaller-step: error ValueError: step 0.4") < detail.index("step 0.2")
    )
    assert float(last["step_s_used"]) == 0.8
    assert np.isnan(last["y"])


def test_blocks_do_not_matter_to_retries(fragile):
    xr.testing.assert_identical(cube_of(STUDY, fragile)[0], cube_of(STUDY, fragile, blocks=4)[0])


def test_expected_outcomes_are_not_retried(fragile):
    cube, cost = cube_of(STUDY + 'expected_outcomes = ["error"]\n', fragile)
    assert cube["attempt"].values.tolist() == [0] * 4
    assert cost["force_evaluations"].values.tolist() == [1] * 4


@pytest.mark.slow
def test_rollers_at_forty_degrees_finish_with_half_the_tolerance():
    """4e-3 leaves more than 5 % of numerical error there."""
    cube, _ = cube_of(JOINT)
    assert cube["attempt"].values.tolist() == [0, 1]
    assert int(cube["first_outcome"][1]) == td.Outcome.INACCURATE
    assert cube["relative_tolerance_used"].values.tolist() == [4e-3, 2e-3]
    asked = td.simulate(model="rollers", joint_angle_deg=40, samples_per_revolution=60, relative_tolerance=2e-3)
    np.testing.assert_array_equal(cube["thrust_amplitude"].values[1], asked["thrust_amplitude"].values)


@pytest.mark.slow
def test_a_lower_rung_takes_its_own_numerics_and_leaves_what_it_cannot_give_open():
    cube, _ = cube_of(JOINT.replace('"smaller-step", ', ""))
    assert cube["attempt"].values.tolist() == [0, 1]
    words = cube["method_used"].flag_meanings.split()
    used = [words[list(cube["method_used"].flag_values).index(flag)] for flag in cube["method_used"].values]
    assert used == ["adaptive-euler", "newton"]
    assert cube["thrust_amplitude_error"].isnull().all("order").values.tolist() == [False, True]
    assert bool(np.isfinite(cube["thrust_amplitude"]).all())


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ('["smaller-steps"]', r"\[run\]: retry: 'smaller-steps'.*did you mean 'smaller-step'"),
        ('[{ modle = "rollers" }]', r"\[run\]: retry: modle = 'rollers': unknown parameter; did you mean 'model'"),
        ('[{ model = "roller" }]', r"retry: model = 'roller': unknown; did you mean 'rollers'"),
        ('[{ model = "rollers" }]', r"retry: model = rollers: it makes no difference"),
        ('[{ model = "equilibrium" }, { model = "equilibrium" }]', r"model = equilibrium: it makes no difference"),
        ('[{ method = "newton" }]', r"retry: method = newton: method = newton: not a method of rollers"),
        ("[{ step_s = 1e-5 }]", r"retry: step_s = 1e-05: .*not used by adaptive-euler"),
        ("[{}]", r"an empty table changes nothing"),
        ("[3]", r"\[run\.retry\].*3"),
    ],
)
def test_a_bad_retry_is_refused_before_anything_runs(entries, message):
    with pytest.raises(td.InputError, match=message):
        parse_study(JOINT.partition("retry")[0] + f"retry = {entries}\n")


def test_retries_of_many_levels_are_checked_on_few_of_their_combinations():
    """Regression: all combinations were listed, whatever the design, and even without a retry."""
    levels = "low = 1e-6\nhigh = 1e-3\ncount = 3000\n"
    factors = "".join(f"[factors.{name}]\n{levels}" for name in ("step_s", "relative_tolerance"))
    text = f'[study]\nname = "z"\n[base]\nmodel = "rollers"\n{factors}[design]\nkind = "zip"\n[run]\nretry = '
    began = time.process_time()
    study = parse_study(text + '["smaller-step", "smaller-step"]\n')
    assert len(study.retry.changes) == 2
    assert time.process_time() - began < 10


@pytest.mark.parametrize(
    ("factor", "change", "reason"),
    [
        ("roller_width_mm", "roller_width_mm = 12", "roller_width_mm: this study varies it"),
        ("speed_rpm", "roller_width_mm = 12", "only model, method and numerics may change"),
        ("cycles", "cycles = 12", "cycles: this study varies it"),
    ],
)
def test_a_retry_of_what_a_point_stands_for_is_refused(factor, change, reason):
    """Regression: the thrust force of a width of 12 mm was given as that of 80 mm."""
    factors = f'[factors.{factor}]\nvalues = [11, 80]\n[base]\nmodel = "rollers"\n'
    with pytest.raises(td.InputError, match=reason):
        parse_study(f'[study]\nname = "r"\n{factors}[run]\nretry = [{{ {change} }}]\n')


def test_a_smaller_step_needs_something_to_halve(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "plain_function.py").write_text("def f(x):\n    return {'y': x}\n")
    text = '[study]\nname="p"\nfunction="plain_function:f"\n[factors.x]\nvalues=[1]\n[run]\nretry=["smaller-step"]\n'
    with pytest.raises(td.InputError, match="no point has a step or a tolerance"):
        parse_study(text, folder=StudyFolder(tmp_path))


def test_a_changed_retry_is_another_study(fragile, write_study):
    assert td.run(write_study(STUDY), fragile / "out", workers=0, progress=False).good
    with pytest.raises(td.InputError, match=r"run\.retry: .* -> "):
        td.run(write_study(STUDY.replace(", { method = 1 }", "")), fragile / "out", workers=0, progress=False)


def test_failed_points_run_again_with_their_retries_when_asked(fragile, write_study):
    study = write_study(STUDY.replace(", { method = 1 }", ""))
    assert td.run(study, fragile / "out", workers=0, progress=False).failed == {"error": 1}
    again = td.run(study, fragile / "out", workers=0, retry_failed=True, progress=False)
    assert (again.computed, again.failed) == (1, {"error": 1})
    assert int(td.open_cube(fragile / "out")["attempt"][3]) == 2


@pytest.mark.slow
def test_a_kill_in_a_retry_loses_nothing_and_changes_nothing(fragile, write_study):
    slow = (
        STUDY.replace("[factors.x]", "[base]\nslow = 0.05\n[factors.x]").replace(
            "values = [1.0, 0.5, 0.3, 0.1]", "low = 0.05\nhigh = 1.0\ncount = 60"
        )
        + "block = 2\n"
    )
    study, log = write_study(slow), fragile / "log"
    command = ["-m", "tripod_doe.cli", "run", str(study), "--out", str(fragile / "killed")]
    process = Process([*command, "--workers", "0"], quiet=True)  # retries are made within a block, wherever it runs
    while not (log.exists() and len(log.read_text().splitlines()) > 40):
        assert process.poll() is None, "it ended before it was killed"
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    resumed = td.run(study, fragile / "killed", workers=0, progress=False)
    assert resumed.good
    assert resumed.reused > 0
    assert td.run(study, fragile / "whole", workers=0, progress=False).good
    names = ["y", "attempt", "step_s_used", "first_outcome", "first_outcome_detail", "outcome"]
    killed, whole = (td.open_cube(fragile / name)[names] for name in ("killed", "whole"))
    xr.testing.assert_identical(killed.drop_attrs(deep=False), whole.drop_attrs(deep=False))
