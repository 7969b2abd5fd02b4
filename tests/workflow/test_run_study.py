"""Runs: same cube whatever the policy, nothing lost to kills, only what is missing runs."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import time

import numpy as np
import psutil
import pytest
import xarray as xr

import tripod_doe as td
from stand_in_workers import SlowStart
from started import Process
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution import dask_workers
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import Journal
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.workflow import run_study

pytestmark = pytest.mark.usefixtures("pages_not_made")

GRID = """
    [study]
    name = "grid"
    [factors]
    joint_angle_deg = {values = [5, 10, 15]}
    torque_n_m = {values = [25, 50]}
    [keep]
    outputs = ["thrust_amplitude", "thrust", "friction_power_w"]
    [base]
    samples_per_revolution = 60
"""

SLOW = """
    [study]
    name = "slow"
    function = "slow_function:slow"
    [factors]
    x = {low = 0, high = 1, count = 120}
    [run]
    block = 2
"""

SLOW_FUNCTION = """
import os, time
def slow(x):
    with open(os.environ["SLOW_LOG"], "a") as log:
        log.write(f"{x}\\n")
    time.sleep(0.03)
    return {"y": x * x}
"""


def run(study, out, **options):
    return td.run(study, out=out, progress=False, **options)


def assert_same_cube(one, other):
    first, second = (td.open_cube(path).drop_vars(["cpu_seconds", "wall_seconds", "worker"]) for path in (one, other))
    for cube in (first, second):
        cube.attrs.pop("history")
    xr.testing.assert_identical(first, second)


@pytest.mark.slow
def test_the_cube_does_not_depend_on_workers_blocks_or_interruptions(write_study, tmp_path):
    """Invariance, bit for bit: two workers, none, blocks of one point; what is there is not computed again."""
    whole = write_study(GRID, "whole.toml")
    assert run(whole, tmp_path / "two", workers=2).good
    assert set(td.open_cube(tmp_path / "two")["worker"].values.ravel()) <= {"0", "1"}
    for workers in (0, None):
        assert run(whole, tmp_path / str(workers), workers=workers).good
        assert_same_cube(tmp_path / "two", tmp_path / str(workers))
    assert set(td.open_cube(tmp_path / "None")["worker"].values.ravel()) == {"main process"}
    blocks = write_study(GRID + "    [run]\n    block = 1\n", "blocks.toml")
    assert run(blocks, tmp_path / "blocks").good
    names = ["thrust_amplitude", "thrust", "friction_power_w", "outcome"]
    xr.testing.assert_equal(td.open_cube(tmp_path / "two")[names], td.open_cube(tmp_path / "blocks")[names])
    again = run(whole, tmp_path / "two")
    assert (again.computed, again.reused) == (0, 6)
    cube = td.open_cube(tmp_path / "two")
    assert cube["thrust"].dims == ("joint_angle_deg", "torque_n_m", "rotation_deg")
    assert cube["thrust"].sizes["rotation_deg"] == 120
    direct = td.simulate(joint_angle_deg=15, torque_n_m=25, samples_per_revolution=60)
    cell = cube["thrust_amplitude"].sel(joint_angle_deg=15, torque_n_m=25)
    assert np.array_equal(cell.values, direct["thrust_amplitude"].values)


@pytest.mark.slow
def test_a_study_that_grew_reuses_and_one_that_changed_is_refused(write_study, tmp_path):
    out = tmp_path / "out"
    run(write_study(GRID), out)
    grown = run(write_study(GRID.replace("[25, 50]", "[25, 50, 100]")), out)
    assert (grown.computed, grown.reused) == (3, 6)
    before = (out / "cube.nc").read_bytes()
    with pytest.raises(td.InputError, match=r"factors\.torque_n_m\.values.*\n?.*") as caught:
        run(write_study(GRID.replace("[25, 50]", "[30, 50]")), out)
    assert "samples_per_revolution" not in str(caught.value)
    with pytest.raises(td.InputError, match=r"base\.samples_per_revolution: 60 -> 90"):
        run(write_study(GRID.replace("[25, 50]", "[25, 50, 100]").replace("= 60", "= 90")), out)
    with pytest.raises(td.InputError, match=r"keep\.outputs"):
        run(write_study(GRID.replace("[25, 50]", "[25, 50, 100]").replace('"thrust", ', "")), out)
    assert (out / "cube.nc").read_bytes() == before


@pytest.mark.slow
def test_failed_points_are_flagged_reported_and_retried(write_study, tmp_path):
    text = """
        [study]
        name = "misfit"
        [factors.needle_count]
        values = [27, 28]
        [keep]
        outputs = ["thrust_amplitude"]
    """
    summary = run(write_study(text), tmp_path / "out")
    assert summary.failed == {"jammed": 1}
    assert not summary.good
    cube = td.open_cube(tmp_path / "out").sel(needle_count=28)
    assert int(cube["outcome"]) == td.Outcome.JAMMED
    assert "do not fit" in str(cube["outcome_detail"].values)
    assert bool(cube["thrust_amplitude"].isnull().all())
    expected = run(write_study(text + '        [run]\n        expected_outcomes = ["jammed"]\n'), tmp_path / "out")
    assert expected.good
    retried = run(write_study(text), tmp_path / "out", retry_failed=True)
    assert (retried.computed, retried.reused) == (1, 1)


@pytest.mark.slow
def test_a_point_that_kills_its_worker_costs_only_itself(write_study, tmp_path):
    """Outcomes: three workers die on it, its block is halved until it stands alone, and the others finish."""
    (tmp_path / "deadly.py").write_text(
        "import os\ndef f(x):\n    if x == 3:\n        os._exit(9)\n    return {'y': 2 * x}\n"
    )
    study = write_study(
        '[study]\nname = "deadly"\nfunction = "deadly:f"\n[factors.x]\nvalues = [1, 2, 3, 4]\n[run]\nblock = 2\n'
    )
    summary = run(study, tmp_path / "out")
    assert summary.failed == {"worker_lost": 1}
    cube = td.open_cube(tmp_path / "out")
    assert cube["y"].sel(x=[1, 2, 4]).values.tolist() == [2, 4, 8]
    assert int(cube["outcome"].sel(x=3)) == td.Outcome.WORKER_LOST


@pytest.mark.parametrize(
    ("end", "said"), [("exit(9)", "asked Python to exit (9)"), ("raise KeyboardInterrupt", "raised KeyboardInterrupt")]
)
def test_a_point_that_asks_python_to_exit_costs_only_itself_in_this_process(write_study, tmp_path, end, said):
    (tmp_path / "leaving.py").write_text(f"def f(x):\n    if x == 3:\n        {end}\n    return {{'y': 2 * x}}\n")
    study = write_study(
        '[study]\nname = "leaving"\nfunction = "leaving:f"\n[factors.x]\nvalues = [1, 2, 3, 4]\n[run]\nblock = 2\n'
    )
    assert run(study, tmp_path / "out", workers=0).failed == {"worker_lost": 1}
    cube = td.open_cube(tmp_path / "out")
    assert cube["y"].sel(x=[1, 2, 4]).values.tolist() == [2, 4, 8]
    assert said in str(cube["outcome_detail"].sel(x=3).values)


def test_a_study_whose_process_died_goes_on_with_worker_processes(write_study, tmp_path, monkeypatch):
    """A point that crashes the process must not do so each time the study is run again."""
    monkeypatch.setattr(dask_workers, "DaskWorkers", SlowStart)
    study = write_study(GRID)
    (tmp_path / "out").mkdir()
    with Journal(tmp_path / "out") as journal:
        journal.remember({"computing": "yes"})  # as a process leaves it that dies in its work
    assert run(study, tmp_path / "out").good
    assert set(td.open_cube(tmp_path / "out")["worker"].values.ravel()) == {"worker"}
    with ResultDirectory(tmp_path / "out") as directory, directory.computing() as died_before:
        assert not died_before


def test_an_error_in_a_function_is_a_flagged_cell(write_study, tmp_path):
    (tmp_path / "dividing.py").write_text("def g(x):\n    return {'y': 1 / x, 'z': [x, x]}\n")
    study = write_study('[study]\nname = "fragile"\nfunction = "dividing:g"\n[factors.x]\nvalues = [0, 4]\n')
    summary = run(study, tmp_path / "out", workers=0)
    assert summary.failed == {"error": 1}
    cube = td.open_cube(tmp_path / "out")
    assert "ZeroDivisionError" in str(cube["outcome_detail"].sel(x=0).values)
    assert float(cube["y"].sel(x=4)) == 0.25
    assert cube["z"].sel(x=4).values.tolist() == [4, 4]


def test_points_of_another_version_of_a_function_are_not_taken(write_study, tmp_path):
    """Regression: the code was in no hash: old points were given as those of the changed function, and mixed with new ones."""
    (tmp_path / "factors_of.py").write_text("K = 2.0\ndef times(x):\n    return K * x\n")
    (tmp_path / "watched.py").write_text("def f(x):\n    from factors_of import times\n    return {'y': times(x)}\n")
    study = write_study('[study]\nname = "w"\nfunction = "watched:f"\n[factors.x]\nvalues = [1, 2]\n')
    assert run(study, tmp_path / "out", workers=0).computed == 2
    (tmp_path / "factors_of.py").write_text("K = 2.0  # still\n\ndef times(x):\n    return K * x\n")
    assert run(study, tmp_path / "out", workers=0).reused == 2
    (tmp_path / "factors_of.py").write_text("K = 20.0\ndef times(x):\n    return K * x\n")
    with pytest.raises(
        td.InputError,
        match=r"computed by another version of watched:f \(\w{16}, now \w{16}\); run the study into another",
    ):
        run(study, tmp_path / "out", workers=0)
    assert run(study, tmp_path / "new", workers=0).good
    assert td.open_cube(tmp_path / "new")["y"].values.tolist() == [20, 40]
    kept = td.open_cube(tmp_path / "new").attrs["kernel_source_hash"]
    (tmp_path / "more.toml").write_text('[responses.twice]\nformula = "2 * y"\n')
    td.derive(tmp_path / "new", tmp_path / "more.toml")
    assert td.open_cube(tmp_path / "new")["twice"].values.tolist() == [40, 80]
    assert td.open_cube(tmp_path / "new").attrs["kernel_source_hash"] == kept != ""


def test_constraints_and_fail_fast(write_study, tmp_path):
    text = GRID + '    [design]\n    constraints = ["joint_angle_deg * torque_n_m < 600"]\n'
    assert run(write_study(text), tmp_path / "out").good
    cube = td.open_cube(tmp_path / "out")
    assert int(cube["outcome"].sel(joint_angle_deg=15, torque_n_m=50)) == td.Outcome.NOT_RUN
    (tmp_path / "bad.py").write_text("def h(x):\n    raise RuntimeError(x)\n")
    study = write_study('[study]\nname="b"\nfunction="bad:h"\n[factors.x]\nlow=0\nhigh=1\ncount=200\n[run]\nblock=1\n')
    summary = run(study, tmp_path / "stopped", workers=0, fail_fast=True)
    assert summary.computed < 200
    assert not summary.complete


def start(study, out, log, workers=2):
    environment = os.environ | {"SLOW_LOG": str(log)}
    command = ["-m", "tripod_doe.cli", "run", str(study), "--out", str(out), "--workers", str(workers)]
    return Process(command, environment)


def calls(log):
    return len(log.read_text().splitlines()) if log.exists() else 0


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "kills"), [(2, 2), (0, 3)])
def test_kills_lose_nothing_and_run_no_committed_block_twice(write_study, tmp_path, monkeypatch, workers, kills):
    """kill -9 of the whole process group at random moments; then the cube equals the uninterrupted one."""
    (tmp_path / "slow_function.py").write_text(SLOW_FUNCTION)
    study, log, out = write_study(SLOW), tmp_path / "log", tmp_path / "killed"
    moments = random.Random(0)
    committed = []
    for _ in range(kills):
        process = start(study, out, log, workers)
        wanted = calls(log) + moments.randint(0, 60 // kills)  # 0: killed while it starts
        while process.poll() is None and calls(log) < wanted:
            time.sleep(0.01)
        assert process.poll() is None, process.stderr.read()
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if (out / "journal.sqlite").exists():
            with Journal(out) as journal:
                committed.append(len(journal.keys()))
    process = start(study, out, log, workers)
    _, message = process.communicate()
    assert process.returncode == 0, message
    assert committed == sorted(committed)
    assert len(set(committed)) > 1, "no kill hit the work"
    with Journal(out) as journal:
        keys = journal.keys()
    assert len(keys) == len(np.unique(keys)) == 120
    monkeypatch.setenv("SLOW_LOG", str(log))
    run(study, tmp_path / "whole", workers=0)
    assert_same_cube(out, tmp_path / "whole")


@pytest.mark.slow
def test_a_worker_killed_in_mid_block_loses_nothing(write_study, tmp_path):
    """kill -9 of one worker process: its blocks run again elsewhere, and every point finishes with its value."""
    (tmp_path / "slow_function.py").write_text(SLOW_FUNCTION)
    study, log, out = write_study(SLOW), tmp_path / "log", tmp_path / "out"
    process = start(study, out, log)
    while not log.exists():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    children = psutil.Process(process.pid).children(recursive=True)
    workers = [child.pid for child in children if any("forkserver" in word for word in child.parent().cmdline())]
    os.kill(random.Random(1).choice(workers), signal.SIGKILL)
    _, message = process.communicate()
    assert process.returncode == 0, message
    cube = td.open_cube(out)
    assert (cube["outcome"] == td.Outcome.FINISHED).all()
    np.testing.assert_allclose(cube["y"], cube["x"] ** 2)


@pytest.mark.slow
def test_an_existing_scheduler_gives_the_same_cube(write_study, tmp_path):
    """Invariance, bit for bit, on its one worker; and an address at which nothing answers is refused."""
    from distributed import LocalCluster

    study = write_study(GRID)
    run(study, tmp_path / "own")
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50) as cluster:
        run(study, tmp_path / "theirs", scheduler=cluster.scheduler_address)
    assert_same_cube(tmp_path / "own", tmp_path / "theirs")
    with pytest.raises(td.InputError, match="no Dask scheduler"):
        run(study, tmp_path / "nowhere", scheduler="tcp://127.0.0.1:9")


def test_a_disk_that_is_too_small_is_reported_before_anything_starts(write_study, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr("tripod_doe.study.result_directory.directory.shutil.disk_usage", lambda path: usage)
    with pytest.raises(td.InputError, match=r"1 MB free, but journal and cube need 20 MB"):
        run(write_study(GRID), tmp_path / "out")
    assert not (tmp_path / "out" / "study.toml").exists()


def test_two_runs_do_not_share_a_directory(write_study, tmp_path):
    with ResultDirectory(tmp_path / "out"), pytest.raises(td.InputError, match="is writing here"):
        run(write_study(GRID), tmp_path / "out")


def test_analyses_and_report_are_made_while_the_directory_is_held(write_study, tmp_path, monkeypatch):
    """Regression: a run of the grown study ended first, and the one before wrote its analyses and report over it."""
    held, whole = [], run_study.find

    def find_while_another_begins(cube):
        with pytest.raises(td.InputError, match="is writing here"):
            ResultDirectory(tmp_path / "out")
        held.append(cube.sizes)
        return whole(cube)

    monkeypatch.setattr(run_study, "find", find_while_another_begins)
    run(write_study(GRID), tmp_path / "out")
    td.derive(tmp_path / "out", write_study('[responses.peak]\nformula = "max(thrust)"\n', "more.toml"))
    assert len(held) == 2
    ResultDirectory(tmp_path / "out").close()


def test_a_run_that_lost_its_directory_writes_no_analysis(write_study, tmp_path, monkeypatch):
    whole = run_study.run_analyses

    def run_after_a_take_over(study, cube, path, check):
        (path / ".lock").unlink()
        (path / ".lock").touch()
        return whole(study, cube, path, check)

    monkeypatch.setattr(run_study, "run_analyses", run_after_a_take_over)
    with pytest.raises(td.StorageError, match="took this directory over"):
        run(write_study(GRID + "[analysis.effects]\n"), tmp_path / "out")
    assert not list(tmp_path.glob("out/analysis/*"))


def test_keys_are_the_journals(write_study, tmp_path):
    study = write_study(GRID)
    run(study, tmp_path / "out")
    checked = load_study(study)
    keys = point_keys(checked, make_points(checked))
    with Journal(tmp_path / "out") as journal:
        assert sorted(keys.tolist()) == sorted(journal.keys().tolist())
    cube = td.open_cube(tmp_path / "out")
    assert json.loads(cube.attrs["fixed_parameters"])["speed_rpm"] == 600


def test_where_no_point_finished_an_analysis_says_so(write_study, tmp_path):
    """Regression: "output: 'thrust_amplitude' is not in the cube; allowed:"."""
    text = """
        [study]
        name = "None"
        [base]
        model = "equilibrium"
        needle_diameter_mm = 9
        [design]
        kind = "ablation"
        [analysis.contribution]
    """
    summary = td.run(write_study(text), out=tmp_path / "out", workers=0, progress=False)
    assert summary.analyses == {"contribution": "no point finished: there is nothing to analyse"}
    page = td.write_report(tmp_path / "out").read_text()
    assert "Analysis contribution was not made: no point finished: there is nothing to analyse." in page


def test_a_study_whose_parts_fit_nowhere_is_refused_before_anything_is_written(write_study, tmp_path):
    text = GRID.replace("samples_per_revolution = 60", "needle_length_mm = 30")
    with pytest.raises(td.InputError, match=r"all 6 points .* reach 1.* mm into the groove's wall.* needle_length_mm"):
        run(write_study(text), tmp_path / "out", refuse_impossible=True)
    assert not (tmp_path / "out").exists()
    text += '    [run]\n    expected_outcomes = ["jammed"]\n'
    expected = run(write_study(text), tmp_path / "out", refuse_impossible=True)
    assert expected.complete
    assert expected.good
