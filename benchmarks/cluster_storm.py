"""A cluster whose processes are killed or stopped while a study runs: every value, every point committed once.

    python benchmarks/cluster_storm.py [--what worker scheduler client stop freeze] [--times 200] [--every 3] [--workers 4]
                                       [--away 1] [--killer] [--seed 1]

A real scheduler and real workers, which come back when they are killed, compute points that take --pause seconds. Every
--every seconds a random process of the kinds that are named is killed (a worker, the scheduler, which stays away for
--away seconds, or the command itself, which is started again), or stopped for --frozen seconds ("stop": a worker or the
scheduler, "freeze": the command; longer than 60 s is beyond all time limits). With --killer one point
kills its worker each time. At the end every other point has its value, that one alone is worker_lost, and no point
stands in the journal twice. Told is how many points were started more than once, for which part of the time from the
first to the last point workers were at points, and how long after a restart of the scheduler they were again.
`--times 0 --workers 8 --threads 8 --count 20000 --pause 2` disturbs nothing.
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
import psutil
from supervised_cluster import SupervisedCluster

import tripod_doe as td
from tripod_doe.study.journal import Journal

FUNCTION = """
import os, time
def f(x):
    with open({log!r}, "a") as log:
        log.write(f"{{x:.0f}} {{time.time()}} {{os.getpid()}}\\n")
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
    """`tripod-doe run` on a cluster, started again whenever it was killed.

    Attributes
    ----------
    cpu_seconds
        CPU time of the latest process, when it was last looked at.
    """

    cpu_seconds = 0.0

    def __init__(self, folder: Path, scheduler: list[str]) -> None:
        words = ["run", str(folder / "storm.toml"), "--out", str(folder / "out"), "--wait", "10min"]
        self._words = [sys.executable, "-m", "tripod_doe.cli", *words, *scheduler]
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
        self.cpu_seconds = cpu_seconds(self._process) or self.cpu_seconds
        return self._process.poll() is None

    def wait(self) -> int:
        """Its exit code."""
        code = self._process.wait()
        self._errors.close()
        return code


def write_study(folder: Path, count: int, pause: float, killer: int = 0, block: int = 0) -> None:
    """The study: squares of 1 to so many, each after a pause; each start stands in ``log``."""
    (folder / "storm_function.py").write_text(FUNCTION.format(log=str(folder / "log"), killer=killer, pause=pause))
    run = f"[run]\nblock = {block}" if block else ""
    (folder / "storm.toml").write_text(STUDY.format(count=count, run=run))


def checked(folder: Path, command: Command, count: int, killer: int = 0) -> dict[str, object]:
    """What the command made; raises AssertionError where its exit code, a value or a point is wrong."""
    code, told = command.wait(), (folder / "errors").read_text()
    assert code == (3 if killer else 0), told
    cube = td.open_cube(folder / "out")
    lost = cube["outcome"].values == td.Outcome.WORKER_LOST
    assert cube["x"].values[lost].tolist() == ([killer] if killer else []), cube["x"].values[lost]
    np.testing.assert_array_equal(cube["y"].values[~lost], cube["x"].values[~lost] ** 2)
    with Journal(folder / "out", read_only=True) as journal:
        keys = journal.keys()
    assert keys.size == np.unique(keys).size == count, "a point was committed twice"
    times = Counter(point for point, _, _ in starts(folder))
    return {"points": count, "started again": times.total() - count, "most starts of a point": max(times.values())}


def cpu_seconds(process: subprocess.Popen) -> float:
    """CPU time of a process, 0 if it has ended."""
    try:
        return sum(psutil.Process(process.pid).cpu_times()[:2])
    except psutil.Error:
        return 0.0


def starts(folder: Path) -> list[tuple[str, float, str]]:
    """Point, time and process of every start of a point."""
    lines = (line.split() for line in (folder / "log").read_text().splitlines())
    return [(point, float(at), process) for point, at, process in lines]


def busy_share(folder: Path, workers: int, pause: float) -> float:
    """Which part of the time from the first start of a point to the last end so many workers were at points."""
    times = [at for _, at, _ in starts(folder)]
    return len(times) * pause / workers / (max(times) + pause - min(times))


def slowest_restart(folder: Path, restarts: list[float]) -> float:
    """Seconds from the start of a scheduler to that of the first point on a worker of its own, at most."""
    found = starts(folder)
    times = []
    for back in restarts:
        older = {process for _, at, process in found if at <= back}
        times += [min((at - back for _, at, process in found if process not in older), default=0.0)]
    return max(times)


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
    killer = options.count // 2 if options.killer else 0
    write_study(folder, options.count, options.pause, killer, options.block)
    hits: Counter[str] = Counter()
    started = time.monotonic()
    with SupervisedCluster(folder, options.workers, options.away, options.threads) as cluster:
        if not options.times:
            cluster.wait()
        command = Command(folder, ["--scheduler-file", str(cluster.file)])
        while not (folder / "log").exists() and command.running:
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
        while command.running:
            time.sleep(0.2)
        prices = {
            "CPU seconds of the command": round(command.cpu_seconds, 1),
            "of the scheduler": round(cpu_seconds(cluster.processes["scheduler"]), 1),
        }
    seconds = time.monotonic() - started
    told = {"hits": dict(hits), "seconds": round(seconds, 1)} | checked(folder, command, options.count, killer)
    busy = busy_share(folder, options.workers * options.threads, options.pause)
    if hits["scheduler"]:
        told["slowest restart"] = round(slowest_restart(folder, cluster.schedulers[1:]), 1)
    return told | {"busy": f"{busy:.1%}"} | prices


def parser() -> argparse.ArgumentParser:
    """Options with the storm of the issue as default."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument(
        "--what", nargs="+", default=["worker"], choices=["worker", "scheduler", "client", "stop", "freeze"]
    )
    words.add_argument("--times", type=int, default=200)
    words.add_argument("--every", type=float, default=3.0)
    words.add_argument("--workers", type=int, default=4)
    words.add_argument("--threads", type=int, default=1, help="of each worker")
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
