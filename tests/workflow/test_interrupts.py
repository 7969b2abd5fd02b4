"""Interrupts: wherever they meet a command, it ends with 130, keeps what is finished, and goes on when run again."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import pytest
from choosing_chain import CHAIN

import tripod_doe as td
from started import Process

pytestmark = pytest.mark.usefixtures("charts_not_drawn")

WAVE = """
import os, time
from tripod_doe.model_interface import Candidate
def wave(x, z=0.0, model=1, slow=0.02):
    with open(os.path.join(os.path.dirname(__file__), "log"), "a") as log:
        log.write(f"{x} {model}\\n")
    time.sleep(slow)
    return {"y": 10 + x + (2 - model) * 0.01, "y_error": 0.001}
wave.candidates = (Candidate({"model": 1}, 1e-3, 1), Candidate({"model": 2}, 1.0, 1, full=True))
"""
NAMED = """
[study]
name = "wave"
function = "wave:wave"
[factors]
x = {low = 0, high = 1, count = 40}
[run]
block = 1
"""
AUTO = NAMED + '[base]\nmodel = "auto"\n[accuracy]\ny = 0.03\n'
PILOT = NAMED.replace("count = 40", "count = 12") + "[factors.model]\nvalues = [1, 2]\n"
# Runs a command in which a function lets Python drop an interrupt once it has been called TIMES: by a destructor.
DROPPING = """
import importlib, signal, sys
from tripod_doe.cli import main
class Sink:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def dropping(function, calls=[]):
    def called(*arguments, **options):
        answer = function(*arguments, **options)
        calls.append(1)
        if len(calls) == times:
            Sink()
        return answer
    return called
if __name__ == "__main__":
    module, names, times = sys.argv.pop(1), sys.argv.pop(1).split("."), int(sys.argv.pop(1))
    owner = importlib.import_module(module)
    for name in names[:-1]:
        owner = getattr(owner, name)
    setattr(owner, names[-1], dropping(getattr(owner, names[-1])))
    sys.exit(main())
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "wave", raising=False)
    texts = {
        "wave.py": WAVE,
        "named.toml": NAMED,
        "auto.toml": AUTO,
        "pilot.toml": PILOT,
        "chain.toml": CHAIN.replace("study.toml", "auto.toml"),
    }
    for name, text in (texts | {"dropping.py": DROPPING}).items():
        (tmp_path / name).write_text(text)
    return tmp_path


def calls(folder: Path) -> int:
    """Points that were run so far."""
    log = folder / "log"
    return len(log.read_text().splitlines()) if log.exists() else 0


def command(folder: Path, name: str, workers: int) -> list[str]:
    kind = "workflow" if name == "chain" else "run"
    return [kind, str(folder / f"{name}.toml"), "--out", str(folder / "out"), "--workers", str(workers)]


def go_on(folder: Path, name: str) -> None:
    """Run the rest in this process."""
    if name == "chain":
        assert td.run_workflow(folder / "chain.toml", folder / "out", workers=0, progress=False).good
    else:
        assert td.run(folder / f"{name}.toml", folder / "out", workers=0, progress=False).good


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "workers", "dropped_in", "most"),
    [
        ("named", 1, "tripod_doe.study.journal Journal.commit 5", 40),
        ("named", 0, "tripod_doe.study.journal Journal.commit 5", 40),
        (
            "auto",
            0,
            "tripod_doe.study.journal Journal.commit 5",
            18 + 40,
        ),  # in the pilot: nine points on two candidates
        ("chain", 0, "tripod_doe.analyses.model_choice.selection choose 1", 24 + 40),
    ],
)
def test_an_interrupt_that_python_drops_is_obeyed_all_the_same(folder, name, workers, dropped_in, most):
    """Regression: one that met Dask's callback of the garbage collector was printed, and the study ran to its end."""
    process = Process([str(folder / "dropping.py"), *dropped_in.split(), *command(folder, name, workers)])
    message = process.communicate()[1]
    assert "Exception ignored in" in message  # it was dropped
    assert process.returncode == 130, message
    assert "interrupted; finished points are kept" in message
    before = calls(folder)
    assert 0 < before < most
    go_on(folder, name)
    assert calls(folder) <= most + 2  # lost: the block at work and the one that waited


@pytest.mark.slow
@pytest.mark.parametrize(("presses", "workers"), [(1, 1), (2, 1), (1, 0), (2, 0)])
def test_a_background_command_is_interrupted_too_and_a_second_interrupt_ends_it_at_once(folder, presses, workers):
    """A shell without job control starts what stands before an & with interrupts ignored."""
    process = Process(["-m", "tripod_doe.cli", *command(folder, "named", workers)], ignores_interrupts=True)
    deadline = time.monotonic() + 60
    while calls(folder) < 5 and time.monotonic() < deadline:
        time.sleep(0.02)
    for _ in range(presses):
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: workers get it, too
        time.sleep(0.02)
    message = process.communicate(timeout=60)[1]
    assert process.returncode == 130, message
    if workers:  # without workers to end, the first interrupt may have done it before the second comes
        assert ("interrupted again" if presses == 2 else "interrupted; finished points are kept") in message
    deadline = time.monotonic() + 10
    while _alive(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(process.pid), "a worker outlived its command"
    before = calls(folder)
    assert before < 40
    go_on(folder, "named")
    assert calls(folder) <= 40 + 2


SPINNING = """
import os
from numba import njit
@njit(nogil=True)
def spin(turns):
    x = 0.5
    for _ in range(turns):
        x = 3.9 * x * (1.0 - x)
    return x
def spinning(turns):
    spin(10)
    open(os.path.join(os.path.dirname(__file__), "log"), "w").write("compiled\\n")
    return {"x": spin(int(turns))}
"""


@pytest.mark.slow
def test_an_interrupt_does_not_wait_for_a_kernel_that_runs_in_the_process_of_the_command(folder):
    """Python holds interrupts back until compiled code returns: this one would after some ten minutes."""
    (folder / "spinning.py").write_text(SPINNING)
    text = '[study]\nname = "s"\nfunction = "spinning:spinning"\n[factors.turns]\nvalues = [300_000_000_000]\n'
    (folder / "spinning.toml").write_text(text)
    process = Process(["-m", "tripod_doe.cli", *command(folder, "spinning", workers=0)])
    deadline = time.monotonic() + 100
    while not calls(folder) and time.monotonic() < deadline:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    assert calls(folder), "the kernel was not reached"
    process.send_signal(signal.SIGINT)
    message = process.communicate(timeout=60)[1]
    assert process.returncode == 130, message
    assert "interrupted; finished points are kept" in message


def _alive(session: int) -> bool:
    try:
        os.killpg(session, 0)
    except ProcessLookupError:
        return False
    return True
