"""The server as a process: its one line, its end, and what a kill of anything leaves behind."""

from __future__ import annotations

import os
import signal
import socket
import sys
import textwrap
import threading
import time
from contextlib import suppress
from dataclasses import replace
from io import StringIO
from pathlib import Path
from unittest.mock import Mock

import pytest
from server_process import LONG, Server, committed, runs_in
from service_client import ADDRESS, COAST, TOKEN
from starlette.testclient import TestClient

from started import Process
from tripod_doe.service.app import create_app
from tripod_doe.service.runs.run_table import PointCounts, Run, RunTable, State
from tripod_doe.service.server import add_demo
from tripod_doe.service.service import Service
from tripod_doe.service.settings import Settings
from tripod_doe.service.workers.worker_pool import WorkerFailedError


def test_the_server_prints_one_line_and_ends_in_time_with_a_hundred_streams(serve):
    server = serve()
    port = int(server.address.rpartition(":")[2])
    request = f"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {server.token}\r\n\r\n"
    streams = [socket.create_connection(("127.0.0.1", port)) for _ in range(100)]
    try:
        for stream in streams:
            stream.sendall(request.encode())
        for stream in streams:
            assert b"200 OK" in stream.recv(4096)
        started = time.monotonic()
        code, told, complaints = server.end()
        assert time.monotonic() - started < 5
    finally:
        for stream in streams:
            stream.close()
    assert (code, told) == (0, "")
    assert complaints == ""  # and so nothing of the token


@pytest.mark.slow
def test_submits_in_flight_hear_that_the_server_ends(serve):
    """They got a bare 500."""
    server = serve("--workers", "0")
    study = '[study]\nname = "n"\n[base]\nmodel = "equilibrium"\n[factors.joint_angle_deg]\nlow = 1\nhigh = 9\ncount = 9999\n'
    answers = []

    def submit():
        with suppress(OSError):  # one that the server had not begun to read
            answers.append(server.ask("/runs", {"study": study}))

    asking = [threading.Thread(target=submit) for _ in range(60)]
    for thread in asking:
        thread.start()
    time.sleep(1)
    code, _, _ = server.end()
    for thread in asking:
        thread.join(20)
    assert code == 0
    assert {status for status, _ in answers} <= {201, 503}
    assert "the server is stopping" in str([told for status, told in answers if status == 503])


@pytest.mark.slow
def test_a_folder_has_one_server(serve, tmp_path):
    serve()
    second = Process(["-m", "tripod_doe.cli", "serve", "--folder", str(tmp_path / "results"), "--port", "0"])
    told, complaints = second.communicate()
    assert second.returncode == 2
    assert "another server uses this folder" in complaints
    assert told == ""
    reader = serve("--read-only")
    assert reader.ask("/runs")[0] == 200
    assert reader.ask("/runs", {"study": textwrap.dedent(COAST)})[0] == 403
    assert reader.ask("/runs/x", method="DELETE")[0] == 403


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (["--folder", "/proc/nowhere"], "cannot write here"),
        (["--folder", "{file}"], "cannot write here"),
        (["--port", "{taken}"], "cannot listen here"),
        (["--port", "70000"], "cannot listen here"),
        (["--host", "no.such.host.example"], "cannot listen here"),
        (["--token-file", "{file}"], "a token has at least"),
        (["--folder", "{missing}", "--read-only"], "no such directory"),
    ],
)
def test_what_cannot_be_used_is_told_in_a_sentence(tmp_path, monkeypatch, capsys, flags, told):
    from tripod_doe.cli import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("x")
    (tmp_path / "file").chmod(0o600)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        places = {"file": tmp_path / "file", "taken": taken.getsockname()[1], "missing": tmp_path / "missing"}
        assert main(["serve", *(flag.format(**places) for flag in flags)]) == 2
    captured = capsys.readouterr()
    assert told in captured.err
    assert captured.out == ""


def test_a_token_file_is_made_for_its_owner_alone_and_kept(tmp_path):
    from tripod_doe.service.settings import read_token

    path = tmp_path / "token"
    token = read_token(path)
    assert path.stat().st_mode & 0o077 == 0
    assert read_token(path) == token
    assert len(token) > 40


@pytest.mark.slow
def test_kills_lose_no_finished_point_and_run_none_twice(serve, tmp_path):
    """The server is killed, then a run, then everything; `benchmarks/service_storm.py` also kills workers."""
    server = serve("--workers", "0")
    run_id, other = server.submit(LONG), server.submit(COAST)
    directory = tmp_path / "results" / run_id
    server.wait(run_id, lambda run: run["points"]["finished"] > 0)
    server.end(signal.SIGKILL)
    before = len(committed(directory))
    server = serve("--workers", "0")
    run = server.wait(run_id, lambda run: run["points"]["finished"] > before)  # it went on alone, and is found again
    assert run["state"] == "running"
    assert server.wait(other, lambda run: run["state"] == "finished")["points"]["missing"] == 0
    (process,) = runs_in(directory)
    process.kill()
    failed = server.wait(run_id, lambda run: run["state"] != "running", seconds=30)
    assert failed["state"] == "failed"
    assert server.ask(f"/runs/{run_id}/resume", method="POST")[1]["state"] == "queued"
    server.wait(run_id, lambda run: run["points"]["finished"] > failed["points"]["finished"])
    for process in runs_in(tmp_path):
        os.killpg(process.pid, signal.SIGKILL)
    later = server.submit(COAST)
    server.end(signal.SIGKILL)
    server = serve("--workers", "0")
    assert server.wait(run_id, lambda run: run["state"] != "running", seconds=30)["state"] == "failed"
    server.wait(later, lambda run: run["state"] in ("running", "failed", "finished"), seconds=30)  # the queue moves
    keys = committed(directory)
    assert len(keys) == len(set(keys)) == server.ask(f"/runs/{run_id}")[1]["points"]["finished"]
    status, rows = server.ask(f"/runs/{run_id}/query?variable=thrust_rms&select=order%3D3")
    assert status == 200
    assert sum(row["outcome"] == "finished" for row in rows) == len(keys)


@pytest.mark.slow
def test_a_run_at_its_start_goes_on_after_a_restart(serve, tmp_path):
    """Regression: the end of the server in these seconds left it failed, "cannot start a process: exit code 255"."""
    server = serve("--workers", "0")
    run_id = server.submit(COAST)
    server.wait(run_id, lambda run: run["state"] == "finished")
    server.end()
    table = RunTable(tmp_path / "results")
    table.put(replace(table.all()[0], state=State.QUEUED))
    table.close()
    server = serve("--workers", "0")  # it starts the run with its first process, which takes a second
    server.wait(run_id, lambda run: run["state"] == "running")
    server.end()
    run = serve("--workers", "0").wait(run_id, lambda run: run["state"] in ("finished", "failed"))
    assert (run["state"], run["message"]) == ("finished", "")


def test_a_server_that_only_reads_refuses_before_it_reads_a_body(tmp_path):
    """Regression: 422, 413 or 415 about the body of a change that it would refuse anyway."""
    with TestClient(create_app(Settings(tmp_path, read_only=True, token=TOKEN)), ADDRESS) as client:
        own = {"authorization": f"Bearer {TOKEN}"}
        for path in ("/runs", "/runs?a=b", "/plans", "/simulate", "/runs/x/stop", "/runs/x/compare"):
            answer = client.post(f"/api/v1{path}", content=b"x" * 1_000_000, headers=own | {"content-type": "text/csv"})
            assert answer.status_code == 403, path
            assert "read-only" in answer.text
        assert client.delete("/api/v1/runs/x?a=b", headers=own).status_code == 403
        assert client.get("/api/v1/runs", headers=own).json() == []


class Terminal(StringIO):
    def isatty(self):
        return True


def test_the_demonstration_shows_its_progress(tmp_path, monkeypatch):
    """Regression: silence from the name of the study to the address."""
    monkeypatch.setattr(sys, "stderr", Terminal())
    run = Run("a" * 16, "study", "demonstration", "", State.RUNNING, counts=PointCounts(144))
    looks = [replace(run, counts=PointCounts(144, 36)), run.changed(state=State.FINISHED, counts=PointCounts(144, 144))]
    service = Mock()
    service.submit.return_value, service.runs.all.return_value, service.runs.find.side_effect = run, [], looks
    add_demo(service)
    assert "144/144" in sys.stderr.getvalue()


def test_a_demonstration_that_cannot_start_keeps_the_server_from_nothing(tmp_path, monkeypatch, capsys):
    """Regression: a worker that failed at the start ended the server with a traceback."""
    service = Service(Settings(tmp_path, workers=0))

    def failed(body):
        raise WorkerFailedError("check: the worker has ended")

    monkeypatch.setattr(service, "submit", failed)
    add_demo(service)
    assert "it cannot run now: check: the worker has ended" in capsys.readouterr().err
    service.runs._table.close()


@pytest.mark.slow
def test_the_demonstration_is_finished_before_the_address_is_told(tmp_path):
    """Whoever opens the printed address finds a run with all its points; the shipped study itself runs, 144 points."""
    server = Server(tmp_path / "demo", "--demo", "--workers", "0")
    try:
        (run,) = server.ask("/runs")[1]
        assert run["state"] == "finished"
        assert run["points"]["finished"] == run["points"]["total"] == 144
    finally:
        _, _, told = server.end()
    assert "first look" in told
    assert sorted(path.name for path in Path(tmp_path / "demo" / run["id"]).glob("*.nc")) == ["cost.nc", "cube.nc"]
