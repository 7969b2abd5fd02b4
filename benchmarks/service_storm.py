"""Kills at random moments: no finished point lost, none run twice, nothing stuck.

    python benchmarks/service_storm.py [--kills 20] [--seed 1] [--workers 1]

A server runs small studies while it, a run, a worker of a run, or everything is killed at random moments. After each kill
the server is there again, runs that were killed are resumed, and at the end every run is finished, every point stands
in its journal once, and every cube equals that of the same study run undisturbed.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import signal
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import xarray as xr
from service_load import LONG, Server, once

import tripod_doe as td
from tripod_doe.service.runs.processes import run_process
from tripod_doe.study.journal import Journal


def processes_in(folder: Path) -> list[psutil.Process]:
    """Processes that run our command line on a folder or on folders in it."""
    numbers = [run_process(place.parent) for place in folder.rglob(".alive")]
    return [psutil.Process(number) for number in numbers if number]


def kill(what: str, server: Server, folder: Path) -> None:
    """Kill a server, a run, a worker, or all of them, as far as there are any."""
    runs = processes_in(folder)
    if what == "worker":
        workers = [child for run in runs for child in run.children(recursive=True) if not child.children()]
        for worker in random.sample(workers, min(1, len(workers))):
            worker.kill()
    if what in ("run", "all"):
        for run in runs if what == "all" else random.sample(runs, min(1, len(runs))):
            try:
                os.killpg(run.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
    if what in ("server", "all"):
        server.process.kill()
        server.process.wait()
        server.process.stdout.close()


def committed(directory: Path) -> list[bytes]:
    """Fingerprints in a journal."""
    with Journal(directory, read_only=True) as journal:
        keys = journal.keys()
    return [key.tobytes() for key in keys]


async def storm(folder: Path, kills: int, workers: str, study: str) -> dict[str, object]:
    """Kill, go on, and check."""
    server = Server(folder, "--workers", workers)
    run_ids = [(await once(server, "POST", "/runs", {"study": study}))["id"] for _ in range(2)]
    counts = {"server": 0, "run": 0, "worker": 0, "all": 0}
    slowest = 0.0
    for _ in range(kills):
        await asyncio.sleep(random.uniform(0.2, 12))
        what = random.choice(sorted(counts))
        counts[what] += 1
        before = {
            run_id: set(committed(folder / run_id))
            for run_id in run_ids
            if (folder / run_id / "journal.sqlite").exists()
        }
        kill(what, server, folder)
        if server.process.poll() is not None:
            server = Server(folder, "--workers", workers)
        started = time.monotonic()
        while True:
            runs = {run["id"]: run for run in await once(server, "GET", "/runs")}
            stuck = [
                run
                for run in runs.values()
                if run["state"] in ("running", "stopping") and not processes_in(folder / run["id"])
            ]
            if not stuck:
                break
            assert time.monotonic() - started < 30, stuck
            await asyncio.sleep(0.05)
        slowest = max(slowest, time.monotonic() - started)
        for run_id, keys in before.items():
            assert keys <= set(committed(folder / run_id)), "a finished point is lost"
        for run in runs.values():
            if run["state"] == "failed":
                await once(server, "POST", f"/runs/{run['id']}/resume")
            if run["state"] == "finished":
                run_ids.append((await once(server, "POST", "/runs", {"study": study}))["id"])
                await once(server, "DELETE", f"/runs/{run['id']}")
                run_ids.remove(run["id"])
    for run_id in run_ids:
        while (run := await once(server, "GET", f"/runs/{run_id}"))["state"] != "finished":
            if run["state"] == "failed":
                await once(server, "POST", f"/runs/{run_id}/resume")
            await asyncio.sleep(0.2)
        assert run["points"]["missing"] == run["points"]["failed"] == 0, run
        keys = committed(folder / run_id)
        assert len(keys) == len(set(keys)) == run["points"]["total"], "a point ran twice"
    server.end()
    return {"kills": counts, "slowest to be told (s)": round(slowest, 2), "runs": run_ids}


def main() -> None:
    """Storm, then compare with undisturbed results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", default="1", help="worker processes of each run; 0: none that could be killed")
    options = parser.parse_args()
    print(storm_and_compare(options.kills, options.seed, options.workers))


def storm_and_compare(kills: int, seed: int, workers: str, side: int = 60) -> dict[str, object]:
    """Storm on a folder of its own, and compare with undisturbed results."""
    random.seed(seed)
    study = LONG.format(count=side)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "results"
        told = asyncio.run(storm(folder, kills, workers, study))
        (Path(name) / "study.toml").write_text(study)
        td.run(Path(name) / "study.toml", Path(name) / "undisturbed", workers=0, progress=False)
        with xr.open_dataset(Path(name) / "undisturbed" / "cube.nc") as calm:
            for run_id in told["runs"]:
                with xr.open_dataset(folder / run_id / "cube.nc") as cube:
                    np.testing.assert_array_equal(cube["thrust_rms"].values, calm["thrust_rms"].values)
    return told


if __name__ == "__main__":
    main()
