"""Has anything become slower, or does it do more work? A small set of runs against recorded work and an older commit.

    python benchmarks/regression.py [--against COMMIT] [--rounds 9] [--only equilibrium ...]
    python benchmarks/regression.py --record      # counted work as it is now, into counted_work.toml

Counted work (points finished, steps, force evaluations, solves) must be what `counted_work.toml` says: that needs no
quiet machine. Prices are compared with COMMIT in one run: both versions stay loaded, take turns, and the ratio of every
pair of turns is noted, so that other work on the machine burdens both alike. Exit code 1 where counted work differs, or
where the whole spread between the quartiles of the ratios lies above 1.05. Prices are CPU time, of `study` that of all
its processes; its wall time is told besides. An older commit gets a worktree and a compile cache in a temporary folder,
so its first turn takes a while.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import tomlkit

HERE = Path(__file__).parent
COUNTED = HERE / "counted_work.toml"
COUNTS = {"equilibrium": 500, "kinetostatic": 200, "rollers": 1, "needles": 1, "study": 2000}
"""Points of a turn of every workload."""
SLOWER = 1.05


class Version:
    """A workload of one version of the sources, in a process of its own that waits for its turns."""

    def __init__(self, name: str, count: int, tree: Path, cache: str | None = None) -> None:
        environment = os.environ | {"PYTHONPATH": str(tree / "src")} | ({"NUMBA_CACHE_DIR": cache} if cache else {})
        command = [sys.executable, str(tree / "benchmarks" / "workload.py"), name, str(count)]
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Version:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def answer(self) -> dict:
        """The next line that it prints."""
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("a workload ended early; its message stands above")
        return json.loads(line)

    def turn(self) -> dict:
        """Work once: CPU seconds and counted work."""
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self.answer()


def paired_ratios(name: str, count: int, tree: Path, cache: str, rounds: int) -> tuple[dict[str, np.ndarray], dict]:
    """CPU and wall time here over those in `tree`, of every pair of turns, and the work counted here."""
    with Version(name, count, HERE.parent) as ours, Version(name, count, tree, cache) as theirs:
        ours.answer(), theirs.answer()
        pairs = []
        for number in range(rounds):
            first, second = (ours, theirs) if number % 2 == 0 else (theirs, ours)
            turns = first.turn(), second.turn()
            mine, other = turns if number % 2 == 0 else turns[::-1]
            pairs.append((mine, other))
    times = [key for key in ("cpu_seconds", "wall_seconds") if key in mine]
    return {key: np.array([mine[key] / other[key] for mine, other in pairs]) for key in times}, mine["counted"]


def counted_work(name: str, count: int) -> dict:
    """The work counted here."""
    with Version(name, count, HERE.parent) as ours:
        ours.answer()
        return ours.turn()["counted"]


def differences(counted: dict, recorded: dict) -> list[str]:
    """What was counted otherwise than recorded."""
    return [
        f"{key} {counted.get(key)}, recorded {value}" for key, value in recorded.items() if counted.get(key) != value
    ]


def compare(names: list[str], against: str | None, rounds: int) -> bool:
    """Print a line for every workload; whether all is well."""
    recorded, well = tomlkit.parse(COUNTED.read_text()).unwrap(), True
    with tempfile.TemporaryDirectory() as folder:
        tree, cache = Path(folder) / "tree", str(Path(folder) / "cache")
        if against:
            subprocess.run(["git", "-C", HERE, "worktree", "add", "--quiet", "--detach", tree, against], check=True)
        try:
            for name in names:
                text = ""
                if against:
                    ratios, counted = paired_ratios(name, COUNTS[name], tree, cache, rounds)
                    low, middle, high = np.quantile(ratios["cpu_seconds"], (0.25, 0.5, 0.75))
                    text, well = f"{middle:.3f} of the price ({low:.3f} to {high:.3f})", well and low <= SLOWER
                    if "wall_seconds" in ratios:
                        text += f", {np.median(ratios['wall_seconds']):.3f} of the wall time"
                else:
                    counted = counted_work(name, COUNTS[name])
                found = differences(counted, recorded.get(name, {}))
                well = well and not found
                work = "; ".join(found) or ("as recorded" if name in recorded else "not recorded")
                print(f"{name:13s} {text:36s} work {work}", flush=True)
        finally:
            if against:
                subprocess.run(["git", "-C", HERE, "worktree", "remove", "--force", tree], check=True)
    return well


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="COMMIT")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", nargs="+", choices=COUNTS, default=list(COUNTS))
    parser.add_argument("--record", action="store_true")
    arguments = parser.parse_args()
    if arguments.record:
        recorded = tomlkit.parse(COUNTED.read_text()) if COUNTED.exists() else tomlkit.document()
        for name in arguments.only:
            recorded[name] = counted_work(name, COUNTS[name])
        COUNTED.write_text(tomlkit.dumps(recorded))
        return 0
    return 0 if compare(arguments.only, arguments.against, arguments.rounds) else 1


if __name__ == "__main__":
    sys.exit(main())
