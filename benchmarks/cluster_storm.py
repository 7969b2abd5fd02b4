"""A cluster whose processes are killed or stopped while a study runs: every value, every point committed once.

    python benchmarks/cluster_storm.py [--what worker scheduler client stop freeze] [--times 200] [--every 3] [--workers 4]
                                       [--away 1] [--killer] [--seed 1]

A real scheduler and real workers, which come back when they are killed, compute points that take --pause seconds. Every
--every seconds a random process of the kinds that are named is killed (a worker, the scheduler, which stays away for
--away seconds, or the command itself, which is started again), or stopped for --frozen seconds ("stop": a worker or the
scheduler, "freeze": the command; longer than 60 s is beyond all time limits). With --killer one point
kills its worker each time. At the end every other point has its value, that one alone is worker_lost, and no point
stands in the journal twice. Told is how many points were started more than once.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
from supervised_cluster import SupervisedCluster

import tripod_doe as td
from tripod_doe.study.journal import Journal

FUNCTION = """
import os, time
def f(x):
    with open({log!r}, "a") as log:
        log.write(f"{{x:.0f}}\\n")
    if x == {killer}:
        os._exit(1)
    time.sleep({pause})
    return {{"y": x**2}}
"""
STUDY = """
[study]
name = "storm"
function = "storm_function:f"
[factors.x]
low = 1
high = {count}
count = {count}
{run}
"""


class Command:
    """`tripod-doe run` on a cluster, started again whenever it was killed."""

    def __init__(self, folder: Path, scheduler_file: Path) -> None:
        words = ["run", str(folder / "storm.toml"), "--out", str(folder / "out"), "--wait", "10min"]
        self._words = [sys.executable, "-m", "tripod_doe.cli", *words, "--scheduler-file", str(scheduler_file)]
        self._errors = (folder / "errors").open("w")
        self.start()

    def start(self) -> None:
        """Start it."""
        self._process = subprocess.Popen(self._words, stderr=self._errors, stdout=subprocess.DEVNULL)

    def kill(self) -> None:
        """SIGKILL, and again."""
        self._process.kill()
        self._process.wait()
        self.start()

    def stop(self, seconds: float) -> None:
        """SIGSTOP for some seconds; one that has ended meanwhile stays as it is."""
        self._process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self._process.send_signal(signal.SIGCONT)

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def wait(self) -> int:
        """Its exit code."""
        code = self._process.wait()
        self._errors.close()
        return code


def hit(what: str, cluster: SupervisedCluster, command: Command, frozen: float) -> None:
    """Do something bad to a process."""
    workers = cluster.workers()
    if what == "client":
        command.kill()
    elif what == "scheduler":
        cluster.kill("scheduler")
    elif what == "worker" and workers:
        cluster.kill(random.choice(workers))
    elif what == "stop":
        cluster.stop(random.choice([*workers, "scheduler"]), frozen)
    elif what == "freeze":
        command.stop(frozen)


def storm(folder: Path, options: argparse.Namespace) -> dict[str, object]:
    """Run one study in a storm; raises AssertionError where a value, a point or a word is wrong."""
    random.seed(options.seed)
    log, killer = folder / "log", options.count // 2 if options.killer else 0
    (folder / "storm_function.py").write_text(FUNCTION.format(log=str(log), killer=killer, pause=options.pause))
    run = f"[run]\nblock = {options.block}" if options.block else ""
    (folder / "storm.toml").write_text(STUDY.format(count=options.count, run=run))
    hits: Counter[str] = Counter()
    started = time.monotonic()
    with SupervisedCluster(folder, options.workers, options.away) as cluster:
        command = Command(folder, cluster.file)
        while not log.exists() and command.running:
            time.sleep(0.05)

        def disturb() -> None:
            while sum(hits.values()) < options.times and command.running:
                time.sleep(random.uniform(0.5, 1.5) * options.every)
                if command.running:
                    hits[what := random.choice(options.what)] += 1
                    hit(what, cluster, command, options.frozen)

        thread = threading.Thread(target=disturb)
        thread.start()
        thread.join()
        code = command.wait()
    seconds = time.monotonic() - started
    told = (folder / "errors").read_text()
    assert code == (3 if killer else 0), told
    cube = td.open_cube(folder / "out")
    lost = cube["outcome"].values == td.Outcome.WORKER_LOST
    assert cube["x"].values[lost].tolist() == ([killer] if killer else []), cube["x"].values[lost]
    np.testing.assert_array_equal(cube["y"].values[~lost], cube["x"].values[~lost] ** 2)
    with Journal(folder / "out", read_only=True) as journal:
        keys = journal.keys()
    assert keys.size == np.unique(keys).size == options.count, "a point was committed twice"
    starts = Counter(log.read_text().split())
    twice = sum(starts.values()) - options.count
    return {"hits": dict(hits), "seconds": round(seconds, 1), "points": options.count, "started again": twice,
            "most starts of a point": max(starts.values())}  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """Options with the storm of the issue as default."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument(
        "--what", nargs="+", default=["worker"], choices=["worker", "scheduler", "client", "stop", "freeze"]
    )
    words.add_argument("--times", type=int, default=200)
    words.add_argument("--every", type=float, default=3.0)
    words.add_argument("--workers", type=int, default=4)
    words.add_argument("--away", type=float, default=1.0)
    words.add_argument("--frozen", type=float, default=10.0)
    words.add_argument("--count", type=int, default=20_000)
    words.add_argument("--pause", type=float, default=0.1)
    words.add_argument("--block", type=int, default=0)
    words.add_argument("--killer", action="store_true")
    words.add_argument("--seed", type=int, default=1)
    return words


def main(arguments: list[str] | None = None) -> None:
    """Storm in a folder of its own, and tell."""
    os.environ.setdefault("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    with tempfile.TemporaryDirectory() as name:
        print(storm(Path(name), parser().parse_args(arguments)))


if __name__ == "__main__":
    main()
