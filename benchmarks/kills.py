"""Studies and workflows killed at random moments: nothing is lost, nothing is written elsewhere, and the cubes are equal.

    python benchmarks/kills.py [--kills 200] [--points 60] [--pause 0.02] [--seed 1]

`run` in its own process, `run` with two workers and a `workflow` with two workers are killed in turns (SIGKILL of the
process group, at a moment of a whole run, so while it starts, computes, writes or draws), and the same command goes on.
Each is forked from this process, which has done the imports: they are three quarters of such a run, and write nothing.
Whenever one has finished, its cubes are compared with those of a run that nobody disturbed, and it begins anew in
another directory. A point that was committed before a kill must not be computed again; besides the result directory
nothing may be written but temporary files, in the folder for those, which the next command may find there.
"""

from __future__ import annotations

import argparse
import atexit
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import dask.array  # noqa: F401 - which xarray imports with the first cube
import matplotlib.figure  # noqa: F401
import numpy as np
import scipy.stats  # noqa: F401
import xarray as xr

import tripod_doe.analyses.main_effects.charts
import tripod_doe.workflow.run_workflow
from tripod_doe.cli import main as tripod_doe
from tripod_doe.study.journal import Journal

FUNCTION = """
import os, time
def f(x):
    with open({log!r}, "a") as log:
        log.write(f"{{x:.0f}}\\n")
    time.sleep({pause})
    return {{"y": x**2 + 0.1}}
"""
STUDY = """
[study]
name = "killed"
function = "killed_function:f"
[factors.x]
low = 1
high = {points}
count = {points}
[run]
block = 1
[analysis.effects]
"""
WORKFLOW = """
[workflow]
name = "killed"
[steps.first]
kind = "study"
study = "study.toml"
[steps.effects]
kind = "analysis"
analysis = "effects"
inputs = ["first"]
[steps.page]
kind = "report"
inputs = ["first", "effects"]
"""
COMMANDS = {
    "run --workers 0": ["run", "study.toml", "--workers", "0"],
    "run --workers 2": ["run", "study.toml", "--workers", "2", "--oversubscribe"],
    "workflow --workers 2": ["workflow", "workflow.toml", "--workers", "2", "--oversubscribe"],
}
AT_WORK = {"run --workers 0": 1, "run --workers 2": 4, "workflow --workers 2": 4}
"""Points that a kill may cost: blocks sent and not answered."""
MEASURED = ("cpu_seconds", "wall_seconds", "worker")


@dataclass(frozen=True)
class Forked:
    """A command in a process of its own."""

    pid: int

    def wait(self, seconds: float) -> int:
        """Its exit code; TimeoutError if it goes on."""
        end = time.monotonic() + seconds
        while True:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                return os.waitstatus_to_exitcode(status)
            if time.monotonic() > end:
                raise TimeoutError
            time.sleep(0.002)


@dataclass
class Storm:
    """One command that is killed and started again."""

    folder: Path  # with the study, its results, a home and a folder for temporary files
    name: str  # one of COMMANDS
    points: int  # of the study
    whole: float = 0.0  # seconds of a run that is not disturbed
    number: int = 0  # of the result directory
    kills: int = 0  # of that directory
    at: Counter[str] = field(default_factory=Counter)  # kills by what the command did
    faults: list[str] = field(default_factory=list)

    @property
    def out(self) -> Path:
        """Where the results are."""
        return self.folder / f"out{self.number}"

    def begin(self) -> None:
        """Take the time of a run that is not disturbed, whose cubes are the measure of all."""
        begun = time.monotonic()
        self.check_end(self.start().wait(600))
        self.whole = time.monotonic() - begun
        self.next()

    def start(self) -> Forked:
        """Start the command on the latest directory."""
        pid = os.fork()
        if pid:
            return Forked(pid)
        code = 1
        try:
            os.setsid()
            os.chdir(self.folder)
            os.environ |= {"HOME": str(self.folder / "home"), "TMPDIR": str(self.folder / "tmp")}
            tempfile.tempdir = None
            with (self.folder / "errors").open("ab") as errors:
                for number in (1, 2):
                    os.dup2(errors.fileno(), number)
            sys.path[0] = ""  # as with `python -m`
            code = tripod_doe([*COMMANDS[self.name], "--out", self.out.name])
            atexit._run_exitfuncs()
        finally:
            os._exit(code)

    def turn(self, moment: float) -> bool:
        """Start the command and kill it after a part of the time that it needs; whether it was still at work."""
        process = self.start()
        before = self.committed()
        try:
            self.check_end(process.wait(moment * self.whole))
        except TimeoutError:
            with suppress(ProcessLookupError):  # it leads no group yet
                os.killpg(process.pid, signal.SIGKILL)
            os.kill(process.pid, signal.SIGKILL)
            os.waitpid(process.pid, 0)
            self.kills += 1
            after = self.committed()
            whole = len(after) == self.points
            self.at["writes" if whole else "computes" if len(after) > len(before) else "starts"] += 1
            if not before <= after:
                self.faults.append(f"{self.out.name}: committed points are gone")
            return True
        self.compare()
        self.next()
        return False

    def finish(self) -> None:
        """Let the command end, and compare."""
        self.check_end(self.start().wait(600))
        self.compare()

    def next(self) -> None:
        """Begin anew in another directory."""
        (self.folder / "log").unlink(missing_ok=True)
        self.number, self.kills = self.number + 1, 0

    def check_end(self, code: int) -> None:
        """Note an exit code other than 0."""
        if code:
            self.faults.append(f"{self.out.name}: exit code {code}: {(self.folder / 'errors').read_text()[-500:]}")

    def journals(self) -> list[Path]:
        """Directories with a journal."""
        return [place for place in (self.out, self.out / "steps" / "first") if (place / "journal.sqlite").is_file()]

    def committed(self) -> set[bytes]:
        """Fingerprints of the points in the journals."""
        found: set[bytes] = set()
        for place in self.journals():
            with Journal(place, read_only=True) as journal:
                keys = journal.keys()
                found |= {key.tobytes() for key in keys}
        return found

    def compare(self) -> None:
        """Hold the results against those of the run that was not disturbed, and the folder against what may be there."""
        first = self.folder / "out0"
        files = {path.relative_to(first) for path in first.rglob("*.nc")}
        here = {path.relative_to(self.out) for path in self.out.rglob("*.nc")}
        if files != here or not files:
            self.faults.append(f"{self.out.name}: {sorted(map(str, files ^ here))} are in one of two only")
        for name in sorted(files & here):
            with xr.open_dataset(first / name) as one, xr.open_dataset(self.out / name) as other:
                one, other = (cube.drop_vars(MEASURED, errors="ignore") for cube in (one, other))
                for cube in (one, other):
                    cube.attrs.pop("history", None)
                if not one.identical(other):
                    self.faults.append(f"{self.out.name}: {name} differs")
        for place in self.journals():
            with Journal(place, read_only=True) as journal:
                keys = journal.keys()
            if len(keys) != len(np.unique(keys)):
                self.faults.append(f"{self.out.name}: points are committed twice")
        ran = Counter((self.folder / "log").read_text().split())
        again = sum(ran.values()) - len(ran)
        if again > self.kills * AT_WORK[self.name]:
            self.faults.append(f"{self.out.name}: {again} points ran again after {self.kills} kills")
        self.faults += [f"written elsewhere: {path}" for path in self.elsewhere()]

    def elsewhere(self) -> list[str]:
        """What stands in the folder besides results, temporary files and what was there."""
        own = {"study.toml", "workflow.toml", "killed_function.py", "log", "errors", "home", "tmp", "__pycache__"}
        own |= {f"out{number}" for number in range(self.number + 1)}
        strange = [str(path) for path in self.folder.iterdir() if path.name not in own]
        of_libraries = {".cache", ".config"}  # compiled kernels, and fonts of matplotlib
        return strange + [str(path) for path in (self.folder / "home").iterdir() if path.name not in of_libraries]


def prepared(folder: Path, name: str, points: int, pause: float) -> Storm:
    """A folder with what a command needs."""
    for own in ("home", "tmp"):
        (folder / own).mkdir(parents=True)
    (folder / "killed_function.py").write_text(FUNCTION.format(log=str(folder / "log"), pause=pause))
    (folder / "study.toml").write_text(STUDY.format(points=points))
    (folder / "workflow.toml").write_text(WORKFLOW)
    return Storm(folder, name, points)


def storm(folder: Path, name: str, kills: int, points: int, pause: float, chosen: random.Random) -> list[str]:
    """Kill a command so many times; what went wrong."""
    disturbed = prepared(folder, name, points, pause)
    disturbed.begin()
    done = 0
    while done < kills:
        done += disturbed.turn(chosen.random())
    disturbed.finish()
    left = sum(path.is_file() for path in (folder / "tmp").rglob("*"))
    print(
        f"{name:22} {done} kills in {disturbed.number} studies of {disturbed.whole:.1f} s, "
        f"while it {', '.join(f'{what} {count}' for what, count in disturbed.at.items())}: "
        f"{len(disturbed.faults)} faults; {left} temporary files left"
    )
    return disturbed.faults


def main(words: list[str] | None = None) -> int:
    """Storm over all commands; the exit code is 1 where anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--points", type=int, default=60)
    parser.add_argument("--pause", type=float, default=0.02)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=COMMANDS, help="one of the commands")
    options = parser.parse_args(words)
    names = [options.only] if options.only else list(COMMANDS)
    folder, chosen = Path(tempfile.mkdtemp(prefix="kills-")), random.Random(options.seed)
    faults = []
    for number, name in enumerate(names):
        kills = options.kills // len(names) + (number < options.kills % len(names))
        faults += storm(folder / str(number), name, kills, options.points, options.pause, chosen)
    for fault in faults:
        print(fault)
    if not faults:
        shutil.rmtree(folder)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
