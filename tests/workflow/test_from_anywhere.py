"""Studies run from wherever Python runs: scripts without a guard, standard input, a notebook's running event loop."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import tripod_doe
from tripod_doe.study.execution.child_process import start_child

CALLS = """
import os
import tripod_doe as td
with open("started", "a") as started:
    started.write("once\\n")
summary = td.run("study.toml", out="out", workers=1, progress=False)
assert summary.good and summary.computed == 4, summary
"""
PLAN = """
import tripod_doe.study.plan as plan
plan._TIMING_SECONDS = 600.0  # however slow the machine is
assert td.plan("study.toml").timed > 0
"""
CELL = f"import asyncio\nasync def cell():\n    exec({CALLS!r})\nasyncio.run(cell())"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "square.py").write_text("def square(x):\n    print('loud')\n    return {'y': x * x}\n")
    text = '[study]\nname = "s"\nfunction = "square:square"\n[factors.x]\nvalues = [1, 2, 3, 5]\n'
    (tmp_path / "study.toml").write_text(text)
    (tmp_path / "script.py").write_text(CALLS + PLAN)  # both kinds of children; they start in the same way anywhere
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("words", [["script.py"], ["-"]], ids=["script", "notebook on standard input"])
def test_a_study_on_worker_processes_runs_its_script_once(folder, words):
    """Regression: every worker imported the script, which ran the study again: no guard is to be needed.

    Nor is a main module that could be imported, nor an event loop that does not yet run, as in the cell of a notebook.
    """
    environment = os.environ | {"PYTHONPATH": str(Path(tripod_doe.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        input=CELL if words == ["-"] else "",
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert (folder / "started").read_text() == "once\n"
    assert done.stdout == ""  # what a function prints in a worker is no answer of the script
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_worker_processes_end_with_the_process_that_wanted_them():
    """As the system does it for a process that is killed: it closes the pipe."""
    program = start_child("tripod_doe.study.execution.dask_local_cluster", "1")
    assert '"address": "tls://127.0.0.1:' in program.stdout.readline()
    program.stdin.close()
    assert program.wait(timeout=60) == 1
    assert program.stdout.read() == ""
    program.stdout.close()
