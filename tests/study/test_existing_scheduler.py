"""Studies on a Dask cluster of somebody else, whose processes die: real schedulers and workers."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.errors import TripodDoeError
from tripod_doe.study.existing_scheduler import ExistingScheduler
from tripod_doe.workflow.run import run

FUNCTION = """
import os, time
def f(x):
    with open({log!r}, "a") as log:
        log.write(f"{{x:.0f}} {{os.getpid()}}\\n")
    if x == {killer}:
        os._exit(1)
    time.sleep({pause})
    return {{"y": x**2}}
"""
STUDY = """
[study]
name = "cluster"
function = "cluster_function:f"
[factors.x]
low = 1
high = {count}
count = {count}
[run]
block = {block}
"""


class Cluster:
    """A scheduler and supervised workers: what ends of them is started again, as a cluster manager does."""

    def __init__(self, folder, workers):
        self.file = folder / "scheduler.json"
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.ended = threading.Event()
        self.processes = {}
        self.commands = {"scheduler": ["scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard",
                                       "--scheduler-file", str(self.file)]}  # fmt: skip
        for number in range(workers):
            self.add_worker(f"worker {number}")
        self.supervisor = threading.Thread(target=self.supervise)

    def add_worker(self, name):
        self.commands[name] = ["worker", self.address, "--no-nanny", "--nthreads", "1", "--no-dashboard",
                               "--host", "127.0.0.1", "--death-timeout", "10", "--name", name]  # fmt: skip

    def supervise(self):
        while not self.ended.wait(0.1):
            for name, command in list(self.commands.items()):
                if name not in self.processes or self.processes[name].poll() is not None:
                    self.processes[name] = subprocess.Popen(
                        [sys.executable, "-m", "dask", *command], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
                    )

    def kill(self, name):
        self.processes[name].send_signal(signal.SIGKILL)
        self.processes[name].wait()

    def __enter__(self):
        self.supervisor.start()
        while not self.file.exists():
            time.sleep(0.05)
        return self

    def __exit__(self, *exception):
        self.ended.set()
        self.supervisor.join()
        for process in self.processes.values():
            process.kill()
            process.wait()


@pytest.fixture
def case(tmp_path, monkeypatch):
    """Writes a study of a function that notes every point that it starts, and reads these notes."""
    log = tmp_path / "log"

    def write(count, block=1, pause=0.1, killer=0):
        (tmp_path / "cluster_function.py").write_text(FUNCTION.format(log=str(log), killer=killer, pause=pause))
        (tmp_path / "s.toml").write_text(STUDY.format(count=count, block=block))
        return tmp_path / "s.toml"

    def started():
        return Counter(int(line.split()[0]) for line in log.read_text().splitlines()) if log.exists() else Counter()

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    write.started = started
    return write


def meanwhile(step, condition):
    """Do something in a thread as soon as a condition holds."""

    def wait():
        while not condition():
            time.sleep(0.02)
        step()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


@pytest.mark.slow
def test_a_scheduler_that_is_killed_and_comes_back_costs_the_blocks_at_work_only(case, tmp_path, capsys):
    """Exact: every value, and no more points ran twice than were at work; workers that join late are used."""
    study = case(count=60)
    with Cluster(tmp_path, workers=1) as cluster:

        def disturb():
            cluster.add_worker("late worker")
            cluster.kill("scheduler")

        thread = meanwhile(disturb, lambda: sum(case.started().values()) >= 5)
        run(study, tmp_path / "out", scheduler_file=cluster.file, progress=False)
        thread.join()
    cube = td.open_cube(tmp_path / "out")
    np.testing.assert_array_equal(cube["y"], cube["x"] ** 2)
    assert sum(case.started().values()) - 60 <= 4
    assert {name for name in np.unique(cube["worker"].values) if name} == {"worker 0", "late worker"}
    told = capsys.readouterr().err
    assert "the scheduler is gone; waiting up to 60 s for it" in told
    assert "the scheduler is back" in told


@pytest.mark.slow
def test_a_point_that_kills_its_worker_is_condemned_alone(case, tmp_path, monkeypatch):
    """Its neighbours in the worker's queue die with it, and finish all the same."""
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
    study = case(count=12, pause=0.02, killer=5)
    with Cluster(tmp_path, workers=1) as cluster:
        run(study, tmp_path / "out", scheduler=cluster.address, progress=False)
    cube = td.open_cube(tmp_path / "out")
    lost = cube["outcome"].values == td.Outcome.WORKER_LOST
    assert cube["x"].values[lost].tolist() == [5]
    np.testing.assert_array_equal(cube["y"].values[~lost], cube["x"].values[~lost] ** 2)
    assert "a worker process died on this point" in str(cube["outcome_detail"].values[lost][0])


@pytest.mark.slow
def test_a_scheduler_that_stays_away_ends_the_run_with_its_points_kept(case, tmp_path):
    study = case(count=30)
    with Cluster(tmp_path, workers=1) as cluster:

        def end():
            cluster.commands.pop("scheduler")
            cluster.kill("scheduler")

        thread = meanwhile(end, lambda: sum(case.started().values()) >= 5)
        with pytest.raises(TripodDoeError, match="no Dask scheduler has answered for 1 s; finished points are kept"):
            run(study, tmp_path / "out", scheduler=cluster.address, wait=1, progress=False)
        thread.join()
    before = case.started()
    summary = run(study, tmp_path / "out", workers=0, progress=False)
    assert summary.reused >= 3
    assert summary.computed + summary.reused == 30
    assert sum((case.started() - before).values()) == summary.computed


def test_what_names_no_scheduler_is_refused(tmp_path):
    (tmp_path / "empty.json").write_text(json.dumps({}))
    with pytest.raises(td.InputError, match=r"scheduler_file='.*none.json': there is no such file"):
        ExistingScheduler(file=tmp_path / "none.json").connect()
    with pytest.raises(td.InputError, match=r"give scheduler='tcp://a:1' or scheduler_file='.*', not both"):
        ExistingScheduler("tcp://a:1", tmp_path / "empty.json")
    with pytest.raises(td.InputError, match="no Dask scheduler answers there"):
        ExistingScheduler(file=tmp_path / "empty.json").connect()
