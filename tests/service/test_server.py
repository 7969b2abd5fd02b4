"""The server as a process: its one line, its end, and what a kill of anything leaves behind."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import textwrap
import time
import urllib.error
import urllib.request
from pathlib import Path

import psutil
import pytest
from service_client import COAST

LONG = """
    [study]
    name = "long"
    [base]
    model = "equilibrium"
    [factors.joint_angle_deg]
    low = 1
    high = 20
    count = 200
    [factors.torque_n_m]
    low = 10
    high = 400
    count = 200
    [keep]
    outputs = ["thrust_rms"]
    [run]
    block = 100
    """
"""Many minutes, in blocks of about a second."""


class Server:
    """A server of our own command line."""

    def __init__(self, folder, *flags):
        words = [sys.executable, "-m", "tripod_doe.cli", "serve", "--folder", str(folder), "--port", "0", *flags]
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.line = self.process.stdout.readline()
        self.address, self.token = re.fullmatch(r"(http://127\.0\.0\.1:\d+)/\?token=(\S+)\n", self.line).groups()

    def ask(self, path, body=None, method=None, seconds=60):
        data = None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        request = urllib.request.Request(f"{self.address}/api/v1{path}", data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=seconds) as answer:
                return answer.status, json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.loads(error.read())

    def submit(self, study):
        status, run = self.ask("/runs", {"study": textwrap.dedent(study)})
        assert status == 201, run
        return run["id"]

    def wait(self, run_id, test, seconds=120):
        until = time.monotonic() + seconds
        while not test(run := self.ask(f"/runs/{run_id}")[1]):
            assert time.monotonic() < until, run
            time.sleep(0.1)
        return run

    def end(self, number=signal.SIGTERM):
        self.process.send_signal(number)
        code = self.process.wait(20)
        with self.process.stdout, self.process.stderr:
            return code, self.process.stdout.read(), self.process.stderr.read()


@pytest.fixture
def serve(tmp_path):
    """Start servers on one folder; at the end they and their runs are gone."""
    servers = []

    def serve(*flags):
        servers.append(Server(tmp_path / "results", *flags))
        return servers[-1]

    yield serve
    for server in servers:
        if server.process.poll() is None:
            server.end(signal.SIGKILL)
    for process in runs_in(tmp_path):
        os.killpg(process.pid, signal.SIGKILL)


def runs_in(folder):
    """Processes of our command line that compute into a folder."""
    return [process for process in psutil.process_iter(["cmdline"])
            if "run" in (words := process.info["cmdline"] or []) and any(str(folder) in word for word in words)]  # fmt: skip


def committed(directory):
    """Fingerprints in a journal, in the order of their commits."""
    with sqlite3.connect(f"file:{directory / 'journal.sqlite'}?mode=ro", uri=True) as journal:
        keys = b"".join(row[0] for row in journal.execute("SELECT keys FROM block ORDER BY id"))
    journal.close()
    return [keys[i : i + 16] for i in range(0, len(keys), 16)]


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


def test_a_folder_has_one_server(serve, tmp_path):
    serve()
    words = [sys.executable, "-m", "tripod_doe.cli", "serve", "--folder", str(tmp_path / "results"), "--port", "0"]
    second = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert second.returncode == 2
    assert "another server looks after this folder" in second.stderr
    assert second.stdout == ""
    reader = serve("--read-only")
    assert reader.ask("/runs")[0] == 200
    assert reader.ask("/runs", {"study": textwrap.dedent(COAST)})[0] == 403
    assert reader.ask("/runs/x", method="DELETE")[0] == 403


@pytest.mark.parametrize(("flags", "told"), [
    (["--folder", "/proc/nowhere"], "cannot write here"),
    (["--folder", "{file}"], "cannot write here"),
    (["--port", "{taken}"], "cannot listen here"),
    (["--port", "70000"], "cannot listen here"),
    (["--host", "no.such.host.example"], "cannot listen here"),
    (["--token-file", "{file}"], "a token has at least"),
    (["--folder", "{missing}", "--read-only"], "no such directory"),
])  # fmt: skip
def test_what_cannot_be_used_is_told_in_a_sentence(tmp_path, monkeypatch, capsys, flags, told):
    from tripod_doe.cli import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("x")
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
def test_the_demonstration_is_finished_before_the_address_is_told(tmp_path):
    server = Server(tmp_path / "demo", "--demo")
    try:
        (run,) = server.ask("/runs")[1]
        assert run["state"] == "finished"
        assert run["points"]["finished"] == run["points"]["total"] == 144
    finally:
        _, _, told = server.end()
    assert "first look" in told
    assert sorted(path.name for path in Path(tmp_path / "demo" / run["id"]).glob("*.nc")) == ["cost.nc", "cube.nc"]
