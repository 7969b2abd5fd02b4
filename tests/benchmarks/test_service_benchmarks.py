"""Benchmarks of the service in a tiny form: that they run and find nothing wrong. No test here measures a speed."""

from __future__ import annotations

import asyncio
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

import tripod_doe as td
from started import Process

pytestmark = pytest.mark.slow


def in_own_thread(function, *arguments):
    """What a function returns that runs a loop of its own: a browser's tests leave one running in this thread."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(function, *arguments).result()


class ForkedServer(Process):
    """A server that is forked: one that starts anew, and what it forks from, import for three seconds."""

    def __init__(self, words, **streams):
        super().__init__(words[1:])

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def wait(self, timeout=60):
        super().wait(timeout)
        self.stderr.close()


@pytest.fixture
def forked_servers(benchmark, monkeypatch):
    monkeypatch.setattr(benchmark("service_load"), "subprocess", SimpleNamespace(Popen=ForkedServer, PIPE=None))


@pytest.mark.usefixtures("forked_servers")
def test_load(benchmark, tmp_path, capsys):
    """Real server, client connections and runs: 200 event streams lose nothing, and answers go on beside two studies."""
    load = benchmark("service_load")
    (tmp_path / "small.toml").write_text(load.LONG.format(count=2))
    td.run(tmp_path / "small.toml", out=tmp_path / "results" / "small", workers=0, progress=False)
    server = load.Server(tmp_path / "results", "--workers", "0")  # the demonstration would cost more than all this
    try:
        in_own_thread(asyncio.run, load.measure(server, 40, 40, 3, 6, 1))
    finally:
        server.end()
    told = capsys.readouterr().out
    assert "200 streams: 0 lost an event" in told
    assert "200 per second beside two studies" in told


def test_requests_made_from_the_description_meet_no_internal_error(benchmark):
    """What schemathesis makes of the published description, alone and in chains: no route fails or answers beside it."""
    tally = benchmark("service_cases").run_cases(60, 3)
    assert tally.total() > 30  # at most so many single requests; the others in chains
    assert {"2", "4"} <= {route.rpartition(" ")[2][0] for route in tally}


@pytest.mark.usefixtures("forked_servers")
def test_a_kill(benchmark):
    """Of a server, a run, a worker or all at a random moment: no finished point lost or run twice, and equal cubes."""
    assert sum(in_own_thread(benchmark("service_storm").storm_and_compare, 1, 4, "0", 12)["kills"].values()) == 1


@pytest.mark.usefixtures("forked_servers")
def test_page(benchmark, capsys):
    """A browser loads list and explorer, and draws slices and many points; this holds only that all of it happens."""
    if shutil.which("chromium") is None:
        pytest.skip("chromium is not installed")
    in_own_thread(benchmark("service_page").measure, 5, 2000, 2)
    told = capsys.readouterr().out
    assert "slice of 25 points at the server" in told
    assert "2,000 points, matrix" in told
