"""Faults of a machine: a full disk, a restart with a queue; and what runs open to the network."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from contextlib import suppress

import psutil
import pytest
from server_process import LONG, committed, runs_in
from service_client import COAST

from tripod_doe.study.execution.dask_local_cluster import LocalWorkers

pytestmark = pytest.mark.slow


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 48 MB; needs the right to mount."""
    place = tmp_path / "results"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=48m", "tmpfs", str(place)], capture_output=True).returncode:
        pytest.skip("no right to mount a small file system")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def test_a_full_disk_is_told_and_what_was_finished_is_kept(small_disk, serve):
    """A real file system without room: requests say so, the run ends, and goes on from its journal when there is room."""
    server = serve("--workers", "0")
    run_id = server.submit(LONG)
    server.wait(run_id, lambda run: run["points"]["finished"] > 0)
    filler = small_disk / "filler"
    with filler.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))
    until = time.monotonic() + 120
    while runs_in(small_disk / run_id):  # it ends; that can be told when it can be stored
        assert time.monotonic() < until
        time.sleep(0.1)
    time.sleep(2)  # the server looks four times per second, and must see the disk as it is now
    before = committed(small_disk / run_id)
    assert before
    status, told = server.ask("/runs", {"study": LONG})
    assert status == 503
    assert "cannot write" in told["errors"][0]["message"]
    assert server.ask("/runs")[0] == 200  # what is there can be looked at
    filler.unlink()
    ended = server.wait(run_id, lambda run: run["state"] == "failed", seconds=30)
    assert "full" in ended["message"] or "No space left" in ended["message"]
    assert server.ask(f"/runs/{run_id}/resume", method="POST")[0] == 200
    server.wait(run_id, lambda run: run["points"]["finished"] > len(before))
    server.ask(f"/runs/{run_id}/stop", method="POST")
    server.wait(run_id, lambda run: run["state"] == "stopped")
    after = committed(small_disk / run_id)
    assert after[: len(before)] == before
    assert len(after) == len(set(after))


def test_the_queue_moves_within_five_seconds_of_a_restart(serve, tmp_path):
    server = serve("--workers", "0")
    at_work = [server.submit(LONG) for _ in range(2)]
    waiting = server.submit(COAST)
    for run_id in at_work:
        server.wait(run_id, lambda run: run["state"] == "running")
    server.end(signal.SIGKILL)
    for process in runs_in(tmp_path / "results" / at_work[0]):
        process.kill()
    server = serve("--workers", "0")
    started = time.monotonic()
    server.wait(waiting, lambda run: run["state"] != "queued")
    assert time.monotonic() - started < 5


def test_worker_processes_are_reached_from_this_machine_alone():
    workers = LocalWorkers(1)
    try:
        own = [psutil.Process(os.getpid()), *psutil.Process(os.getpid()).children(recursive=True)]
        open_at = [
            place.laddr.ip
            for process in own
            for place in process.net_connections("inet")
            if place.status == psutil.CONN_LISTEN
        ]
    finally:
        workers.close()
    assert len(open_at) > 2  # scheduler, its dashboard, worker and nanny
    assert set(open_at) <= {"127.0.0.1", "::1"}
