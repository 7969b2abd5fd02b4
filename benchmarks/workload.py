"""One of the workloads of regression.py, as a process: prints a line of JSON for every line of its standard input.

    PYTHONPATH=TREE/src python benchmarks/workload.py NAME COUNT

regression.py starts the file of each version's own tree. `accurate-needles` and `accurate-rollers` run the point of
number COUNT (full_model.py).
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
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task, run_task

STUDY = (Path(__file__).parent / "throughput.toml").read_text().replace('[base]\nmodel = "equilibrium"\n\n', "")
BASES = {
    "equilibrium": {"model": "equilibrium"},
    "kinetostatic": {"model": "kinetostatic"},
    "rollers": {"model": "rollers", "relative_tolerance": 2e-2, "cycles": 3, "accuracy": 0.5},
    "needles": {
        "model": "needles",
        "relative_tolerance": 4e-3,
        "cycles": 3,
        "accuracy": 0.5,
        "needle_count": 9,
        "needle_diameter_mm": 5.89,
        "spheres_per_needle": 3,
    },
    "study": {"model": "equilibrium", "samples_per_revolution": 30},
}
"""Numerics coarser than anybody would study with: what is compared is the price of the same work."""
POINTS = (
    {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4},
    {
        "joint_angle_deg": 12,
        "torque_n_m": 150,
        "speed_rpm": 900,
        "groove_sliding_friction": 0.08,
        "initial_skew_1_deg": 1,
        "initial_skew_2_deg": -0.5,
    },
    {
        "joint_angle_deg": 7,
        "torque_n_m": 250,
        "speed_rpm": 400,
        "groove_sliding_friction": 0.04,
        "needle_sliding_friction": 0.05,
        "initial_skew_1_deg": -0.3,
        "initial_skew_2_deg": 0.3,
        "initial_skew_3_deg": 0.6,
    },
    {
        "joint_angle_deg": 15,
        "torque_n_m": 40,
        "speed_rpm": 1000,
        "groove_sliding_friction": 0.06,
        "needle_sliding_friction": 0.02,
        "initial_skew_1_deg": 0.2,
        "initial_skew_3_deg": -0.5,
    },
    {
        "joint_angle_deg": 18,
        "torque_n_m": 100,
        "speed_rpm": 200,
        "initial_skew_1_deg": 0.6,
        "initial_skew_2_deg": -0.3,
        "initial_skew_3_deg": 0.2,
    },
)
"""Points of full_model.py."""
FEW = {"needle_count": 9, "needle_diameter_mm": 5.89, "spheres_per_needle": 3, "cycles": 2}
"""A cheap joint that takes the same way through the code."""
ACCURACY = {3: 0.005}
"""What is asked of the orders of the thrust there. The second differs by chance from revolution to revolution."""


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


def solve_accurately(model: str, number: int, **other: float) -> dict[str, object]:
    """Price, counted work and orders of one point, refined to an accuracy of its orders, with other parameters."""
    from tripod_doe.joint.accuracy import OrderAccuracy
    from tripod_doe.joint.models.multibody_run import run_joint
    from tripod_doe.joint.multibody.run_result import Wanted
    from tripod_doe.joint.orders import complex_amplitudes
    from tripod_doe.joint.unit_conversion import point_values

    values, worked = point_values(POINTS[number] | other).point(0), time.process_time()
    run = run_joint(values, model == "needles", "adaptive-euler", Wanted(360), accuracy=OrderAccuracy(ACCURACY))
    orders = abs(complex_amplitudes(run.readings.groove_thrust.sum(1)).mean(0))[2:4]
    counted = {"steps": run.steps, "force_evaluations": run.force_evaluations, "solves": run.solves}
    return {
        "cpu_seconds": time.process_time() - worked,
        "counted": counted,
        "orders": orders.tolist(),
        "tolerance": run.setting,
        "detail": f"{run.outcome.label} {run.detail}",
    }


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
    if name.startswith("accurate-"):
        model = name.removeprefix("accurate-")
        solve_block("needles", 1)  # compiles
        solve_accurately(model, 0, **FEW)  # loads machine code
        answer = lambda: solve_accurately(model, count)  # noqa: E731
    else:
        answer()  # compiles, or loads machine code
    print(json.dumps("ready"), flush=True)
    for _ in sys.stdin:
        print(json.dumps(answer()), flush=True)


if __name__ == "__main__":
    main()
