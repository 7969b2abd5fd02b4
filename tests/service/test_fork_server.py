"""Processes of the service are forked: what they are then, and what becomes of them when one of the two ends."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
import time
from contextlib import suppress

import psutil
import pytest

from tripod_doe.service import answer_processes, fork_server
from tripod_doe.service.answer_processes import AnswerFailedError, AnswerProcesses
from tripod_doe.service.fork_server import Answering, start_module
from tripod_doe.service.limits import Limits

PROGRAMS = {
    "bare": """
        from tripod_doe.service import answer_processes, fork_server
        fork_server._prepare = lambda: None
        fork_server._main()
        """,
    "telling": """
        import json, os, signal, sys
        told = [sys.argv[1:], os.getpid(), os.getsid(0), os.nice(0), "tripod_doe" in sys.modules, sys.stdin.read()]
        print(json.dumps(told), flush=True)
        os.close(1)
        signal.pause()
        """,
    "replying": """
        import sys
        for line in sys.stdin:
            print('{"answer": "yes", "bytes": 0}', flush=True)
        """,
}
"""A fork server that imports nothing; a program that says what it is and waits until it is killed; one that answers."""


@pytest.fixture
def own_server(monkeypatch, tmp_path):
    """A fork server of the test, which finds the test's own modules."""
    for name, text in PROGRAMS.items():
        (tmp_path / f"{name}.py").write_text(textwrap.dedent(text))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(fork_server, "__name__", "bare")
    monkeypatch.setattr(answer_processes, "_WORKER", "replying")
    monkeypatch.setattr(fork_server, "_fork_server", server := fork_server._ForkServer())
    yield server
    server.end()


@pytest.mark.parametrize("system", ["linux", "another"])
def test_a_module_runs_in_a_session_of_its_own_and_holds_its_mark(own_server, tmp_path, monkeypatch, system):
    """The same where processes are not forked."""
    monkeypatch.setattr(sys, "platform", system)
    (answers, answered), (told, mark) = os.pipe(), os.pipe()
    with (tmp_path / "input").open("w+") as words:
        words.write("asked")
        words.seek(0)
        start_module("telling", ["one", "two"], (words.fileno(), answered, 2), mark, niceness=3)
    os.close(answered)
    os.close(mark)
    with os.fdopen(answers) as stream:
        given, pid, session, niceness, forked, asked = json.loads(stream.read())
    assert (given, asked) == (["one", "two"], "asked")
    assert session == pid
    assert niceness == os.nice(0) + 3
    assert forked == (system == "linux")
    with os.fdopen(told) as stream:
        assert int(stream.readline()) == pid
        os.set_blocking(told, False)
        assert stream.buffer.raw.read(1) is None  # it is held
        os.kill(pid, 9)
        os.set_blocking(told, True)
        assert stream.read() == ""


def test_what_was_killed_is_replaced(own_server):
    """First a process that answers, then the one that forks: the next question but one is answered."""
    processes = AnswerProcesses(1, Limits())

    def ask():
        return processes.ask("whether", 60)

    try:
        assert ask() == ("yes", b"")
        (process,) = psutil.Process(own_server._process.pid).children()
        process.kill()
        with suppress(AnswerFailedError):  # unless its end is seen before the question is asked
            assert ask() == ("yes", b"")
        assert ask() == ("yes", b"")
        own_server._process.kill()
        own_server._process.wait()
        processes._processes[0].end()
        assert ask() == ("yes", b"")
    finally:
        processes.close()
    until = time.monotonic() + 60
    while psutil.Process(own_server._process.pid).children():  # those that have ended are forgotten, too
        assert time.monotonic() < until


def test_what_must_start_starts_though_nobody_waits_for_it(own_server, tmp_path):
    """A run that is asked for just before the server ends; a process that answers has nothing to do then."""
    number = tmp_path / "number"
    asked = Answering("replying")
    with number.open("wb") as mark, open(os.devnull, "r+b") as nothing:
        start_module("telling", [], (nothing.fileno(),) * 3, mark.fileno())
    own_server.end()
    until = time.monotonic() + 60
    while not number.read_text():
        assert time.monotonic() < until
    os.kill(int(number.read_text()), 9)
    asked.close()


def test_what_is_forked_has_one_thread_and_knows_nothing_of_the_web():
    """A process with threads must not fork."""
    script = (
        "import os, sys; from tripod_doe.service.fork_server import _prepare; _prepare(); "
        "print(len(os.listdir('/proc/self/task')), sys.modules.keys() & {'fastapi', 'starlette', 'uvicorn'})"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "1 set()\n"
