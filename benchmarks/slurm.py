"""The SLURM recipe of docs/reference/cluster.md on a SLURM of this machine, whose jobs are killed, requeued and end.

    python benchmarks/slurm.py [--root /] [--what calm kill requeue wall-time lifetime recipe array]
                               [--count 2000] [--pause 0.3]

It needs Debian's slurmctld, slurmd and slurm-client, installed or unpacked elsewhere (--root), and dask-jobqueue:

    apt-get download slurmctld slurmd slurm-client slurm-wlm-basic-plugins libhwloc15 liblua5.1-0 libmunge2
    for package in *.deb; do dpkg-deb -x $package root; done
    pip install dask-jobqueue

Nothing else is configured: both daemons run as root without munge, and say that this machine has 64 processors. The
code of the recipe is taken from the page; only its sizes and its port are others. Each scene runs one study from no
workers on, and does one thing every --every seconds: `kill` is `scancel -s KILL` of a random job, `requeue` is
`scontrol requeue`, `recipe` kills the process of the recipe, which holds the scheduler, and starts it again. With
`wall-time` jobs have a minute and no lifetime, so that SLURM ends them; with `lifetime` they end by themselves.
`array` kills jobs of the other recipe, an array of jobs of several workers. At the end every point has its value, which
is known, and was committed once. "started again" counts starts of points that were at work when their worker ended.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from cluster_storm import Command, checked, write_study
from supervised_cluster import SupervisedCluster

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "cluster.md"
SIZES = {"maximum_jobs=320": "maximum_jobs=6"}
ENDS = {
    "wall-time": {'walltime="02:00:00"': 'walltime="00:01:00"', '"--lifetime", "110m", "--lifetime-stagger", "8m"': ""},
    "lifetime": {'"110m"': '"30s"', '"8m"': '"10s"'},
}
"""What jobs have in place of two hours."""
ARRAY = {
    "1-200%20": "1-40%3",
    "--cpus-per-task=16": "--cpus-per-task=2",
    "--nworkers 16": "--nworkers 2",
    "dask worker": f"{sys.executable} -m dask worker",
}
CONFIGURATION = """
ClusterName=here
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={node}
AuthType=auth/none
CredType=cred/none
MpiDefault=none
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SlurmdParameters=config_overrides
SlurmUser=root
SlurmdUser=root
PluginDir={libraries}/slurm-wlm
PlugStackConfig=/dev/null
StateSaveLocation={folder}
SlurmdSpoolDir={folder}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ReturnToService=2
KillWait=5
NodeName={host} NodeAddr=127.0.0.1 CPUs=64 RealMemory=1000000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def free_port() -> int:
    """A port that nobody has."""
    with socket.socket() as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


class Slurm:
    """A controller and a node on this machine.

    Parameters
    ----------
    folder
        For its configuration, state and logs.
    root
        Where Debian's packages were unpacked.
    """

    def __init__(self, folder: Path, root: Path) -> None:
        self._folder, self._programs = folder, root / "usr" / "sbin"
        libraries = next(root.glob("usr/lib/*/slurm-wlm")).parent
        (folder / "slurm.conf").write_text(
            CONFIGURATION.format(
                host=socket.gethostname().partition(".")[0],
                controller=free_port(),
                node=free_port(),
                libraries=libraries,
                folder=folder,
            )
        )
        os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
        os.environ["PATH"] = f"{root / 'usr' / 'bin'}:{os.environ['PATH']}"
        if root != Path("/"):
            os.environ["LD_LIBRARY_PATH"] = f"{libraries}:{libraries / 'slurm-wlm'}"

    def __enter__(self) -> Slurm:
        with (self._folder / "daemons").open("w") as log:
            self._daemons = [
                subprocess.Popen([self._programs / words[0], "-D", *words[1:]], stdout=log, stderr=log)
                for words in (["slurmctld-wlm", "-c"], ["slurmd-wlm", "-d", self._programs / "slurmstepd-wlm"])
            ]
        until = time.monotonic() + 30
        while "idle" not in self.ask("sinfo", "--noheader"):
            assert time.monotonic() < until, (self._folder / "daemons").read_text()
            time.sleep(0.2)
        return self

    def __exit__(self, *exception: object) -> None:
        self.end_jobs()
        for daemon in self._daemons:
            daemon.terminate()
            daemon.wait()

    def end_jobs(self) -> None:
        """Cancel all jobs, and wait until they are gone."""
        while jobs := self.jobs():
            self.ask("scancel", *jobs)
            time.sleep(0.5)

    def ask(self, *words: str) -> str:
        """What one of its commands prints."""
        return subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False).stdout

    def jobs(self, *states: str) -> list[str]:
        """Numbers of the jobs in these states, or of all that have not ended."""
        words = ["--states", ",".join(states)] if states else []
        return self.ask("squeue", "--noheader", "--format", "%A", *words).split()


def recipe_text(language: str, changed: dict[str, str]) -> str:
    """One of the two programs of the page; raises AssertionError where it lacks a word that is to be another."""
    found = re.search(rf"\*\*SLURM\*\*.*?```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert found
    text = found[1]
    for old, new in changed.items():
        assert old in text, f"{PAGE} has no {old}"
        text = text.replace(old, new)
    return text


class Array:
    """The array of jobs of the page, for a scheduler of its own."""

    def __init__(self, folder: Path) -> None:
        self._cluster = SupervisedCluster(folder, 0).__enter__()
        self.address = self._cluster.address
        text = recipe_text("bash", ARRAY | {"/shared/scheduler.json": str(self._cluster.file)})
        subprocess.run(["bash", "-ec", text[text.index("sbatch") :]], cwd=folder, stdout=subprocess.DEVNULL, check=True)

    def close(self) -> None:
        """End the scheduler; who started the jobs ends them."""
        self._cluster.__exit__()


class Recipe:
    """The program with dask-jobqueue."""

    def __init__(self, folder: Path, changed: dict[str, str]) -> None:
        self._file = folder / "cluster.py"
        self._file.write_text(recipe_text("python", changed))
        self._errors = (folder / "cluster.err").open("w")
        self.start()

    def start(self) -> None:
        """Start it; it says where its scheduler is."""
        self._process = subprocess.Popen(
            [sys.executable, self._file],
            cwd=self._file.parent,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        assert self._process.stdout
        self.address = self._process.stdout.readline().strip()
        assert self.address, Path(self._errors.name).read_text()

    def kill(self) -> None:
        """SIGKILL, and again."""
        self._process.kill()
        self._process.communicate()
        self.start()

    def close(self) -> None:
        """Press Enter."""
        self._process.communicate("\n", timeout=60)
        self._errors.close()


def disturbance(what: str, slurm: Slurm, recipe: Recipe | Array) -> Callable[[], bool]:
    """What a scene does every few seconds: gives whether there was anything to do."""

    def to_a_job(*words: str) -> bool:
        running = slurm.jobs("RUNNING")
        if running:
            slurm.ask(*words, random.choice(running))
        return bool(running)

    def to_the_recipe() -> bool:
        assert isinstance(recipe, Recipe)
        recipe.kill()
        return True

    return {
        "kill": lambda: to_a_job("scancel", "-s", "KILL"),
        "array": lambda: to_a_job("scancel", "-s", "KILL"),
        "requeue": lambda: to_a_job("scontrol", "requeue"),
        "recipe": to_the_recipe,
    }.get(what, lambda: False)


def scene(what: str, folder: Path, slurm: Slurm, options: argparse.Namespace) -> dict[str, object]:
    """One study under one disturbance; raises AssertionError where a value, a point or the exit code is wrong."""
    write_study(folder, options.count, options.pause)
    changed = SIZES | ENDS.get(what, {}) | {"8786": str(free_port())}
    recipe = Array(folder) if what == "array" else Recipe(folder, changed)
    started, seen, most, done = time.monotonic(), set[str](), 0, 0
    command = Command(folder, ["--scheduler", recipe.address])
    disturb = disturbance(what, slurm, recipe)
    ended = threading.Event()

    def go_on() -> None:
        nonlocal done
        while done < options.times and not ended.wait(options.every):
            done += disturb()

    thread = threading.Thread(target=go_on)
    thread.start()
    while command.running:
        running = slurm.jobs("RUNNING")
        seen.update(running)
        most = max(most, len(running))
        time.sleep(0.5)
    seconds = time.monotonic() - started
    ended.set()
    thread.join()
    twice = checked(folder, command, options.count)["started again"]
    recipe.close()
    slurm.end_jobs()
    return {"seconds": round(seconds, 1), "disturbed": done, "jobs": len(seen), "at once": most, "started again": twice}


def main(arguments: list[str] | None = None) -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    scenes = ["calm", "kill", "requeue", "wall-time", "lifetime", "recipe", "array"]
    words.add_argument("--root", type=Path, default=Path("/"))
    words.add_argument("--what", nargs="+", default=scenes, choices=scenes)
    words.add_argument("--count", type=int, default=2000)
    words.add_argument("--pause", type=float, default=0.3)
    words.add_argument("--every", type=float, default=15.0)
    words.add_argument("--times", type=int, default=5)
    options = words.parse_args(arguments)
    os.environ.setdefault("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "slurm").mkdir()
        with Slurm(folder / "slurm", options.root.absolute()) as slurm:
            for what in options.what:
                (folder / what).mkdir()
                print(f"{what:10}", scene(what, folder / what, slurm, options), flush=True)


if __name__ == "__main__":
    main()
