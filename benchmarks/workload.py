"""One of the workloads of regression.py, as a process: prints a line of JSON for every line of its standard input.

    PYTHONPATH=TREE/src python benchmarks/workload.py NAME COUNT

It uses only what every commit since the kinetostatic model has, so that it also runs older commits: studies as text,
and their blocks as tasks.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import tomlkit

import tripod_doe as td
from tripod_doe.study.definition import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.task import make_task, run_task

STUDY = (Path(__file__).parent / "throughput.toml").read_text().replace('[base]\nmodel = "equilibrium"\n\n', "")
BASES = {
    "equilibrium": {"model": "equilibrium"},
    "kinetostatic": {"model": "kinetostatic"},
    "rollers": {"model": "rollers", "relative_tolerance": 2e-2, "cycles": 3, "accuracy": 0.5},
    "needles": {"model": "needles", "relative_tolerance": 4e-3, "cycles": 3, "accuracy": 0.5, "needle_count": 9,
                "needle_diameter_mm": 5.89, "spheres_per_needle": 3},
    "study": {"model": "equilibrium", "samples_per_revolution": 30},
}  # fmt: skip
"""Numerics coarser than anybody would study with: what is compared is the price of the same work."""


def study_text(name: str, count: int) -> str:
    """The study of a workload."""
    from tripod_doe.joint.parameters import JOINT_PARAMETERS

    study = tomlkit.parse(STUDY)
    study["design"]["samples"] = count
    base = {key: value for key, value in BASES[name].items() if key in JOINT_PARAMETERS}
    study["base"] = {**study.get("base", {}), **base}
    return tomlkit.dumps(study)


def solve_block(name: str, count: int) -> dict[str, object]:
    """Price and counted work of a block of points."""
    study = parse_study(study_text(name, count))
    result, cpu, _ = run_task(make_task(study, make_points(study), np.arange(count)))
    counted = {key: int(np.sum(getattr(result, key))) for key in ("steps", "force_evaluations", "solves")}
    finished = int(np.sum(np.asarray(result.outcome) == 0))
    return {"cpu_seconds": float(cpu), "counted": {"points": count, "finished": finished} | counted}


def run_study(count: int) -> dict[str, object]:
    """Price of a run of cheap points with journal, cube and report, cluster included."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        path.write_text(study_text("study", count))
        began, worked = time.perf_counter(), _cpu_seconds()
        td.run(path, Path(folder) / "out", workers=1, progress=False)
        wall, cpu = time.perf_counter() - began, _cpu_seconds() - worked
        outcome = td.open_cube(Path(folder) / "out")["outcome"].values
    counted = {"points": int(outcome.size), "finished": int((outcome == 0).sum())}
    return {"cpu_seconds": cpu, "wall_seconds": wall, "counted": counted}


def _cpu_seconds() -> float:
    """CPU time of this process and of all that it started and that have ended."""
    return sum(os.times()[:4])


def main() -> None:
    name, count = sys.argv[1], int(sys.argv[2])
    answer = (lambda: run_study(count)) if name == "study" else (lambda: solve_block(name, count))
    answer()  # compiles, or loads machine code
    print(json.dumps("ready"), flush=True)
    for _ in sys.stdin:
        print(json.dumps(answer()), flush=True)


if __name__ == "__main__":
    main()
