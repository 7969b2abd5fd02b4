"""Where the time of a step of the full joint goes, and what needles and spheres cost and do to the orders.

    python benchmarks/joint_cost.py             # 2 minutes; parts and runs, then the prices of the candidates
    python benchmarks/joint_cost.py --record    # a minute; the prices only, into joint/models/prices.toml: on a quiet machine

Parts are microseconds a step, at the start of the reference joint, where few contacts touch, and after a quarter of a
revolution, where three quarters do. Runs are those of `tripod-doe simulate --model
needles` at skews of (0.4, -0.4, 0.4) deg and a tolerance of 1e-3, with their error estimates. Prices are
CPU microseconds a force evaluation of every candidate that model = "auto" may choose, the least of three runs.
"""

from __future__ import annotations

import math
import sys

import numpy as np
import tomlkit
from engine_cost import PARTS, part_costs

import tripod_doe as td
from tripod_doe.joint.models.candidates import PRICES
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.model_interface import Candidate
from tripod_doe.study.execution.task import Task, run_task

SKEW = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4}


def candidate_cost(candidate: Candidate) -> tuple[float, float]:
    """CPU seconds a force evaluation, and evaluations a run, in a block as studies run it."""
    count = 500 if candidate.values["model"] in ("equilibrium", "kinetostatic") else 1
    columns = {"replicate": np.arange(count, dtype=float)}
    task = Task(
        "joint", None, None, simulator.source_hash, dict(candidate.values), columns, count, ("thrust_amplitude",)
    )
    runs = [run_task(task) for _ in range(4)][1:]  # the first one warms up; other work on the machine only adds
    evaluations = runs[0][0].force_evaluations
    return min(cpu for _, cpu, _ in runs) / evaluations.sum(), evaluations.mean()


def candidate_prices(record: bool) -> None:
    """Print the price of every candidate beside the recorded one, and record it."""
    prices = tomlkit.parse(PRICES.read_text())
    scenes = [{**each.values, "accuracy": None} for each in simulator.candidates]
    costs = []
    for candidate in simulator.candidates:
        costs.append(candidate_cost(candidate))
        seconds, evaluations = costs[-1]
        print(
            f"{candidate.label}: {1e6 * seconds:.1f} us an evaluation (recorded {1e6 * candidate.evaluation_seconds:.1f}), "
            f"{evaluations:.0f} a run (recorded {candidate.evaluations:.0f})",
            flush=True,
        )
    for table, scene, (_, evaluations) in zip(prices.values(), scenes, costs, strict=True):
        least = min(cost for other, (cost, _) in zip(scenes, costs, strict=True) if other == scene)  # at any accuracy
        table["evaluation_seconds"], table["evaluations"] = float(f"{least:.3g}"), round(evaluations)
    if record:
        PRICES.write_text(tomlkit.dumps(prices))


def later(assembly: Assembly, speed: float) -> State:
    """The state after a quarter of a revolution."""
    way = run(
        assembly, "adaptive-euler", math.pi / 2 / speed, settings=Settings(tolerance=2e-3), limits=Limits(windows=0)
    )
    return State(float(way.times[-1]), way.positions[-1], way.velocities[-1])


def main() -> None:
    print(f"{'us a step':12s}" + "".join(f"{name:>13s}" for name in PARTS))
    for needles in (9, 18, 27):
        values = point_values({"needle_count": needles}).point(0)
        assembly = assemble(build_joint(values, needles=True))
        for state in (assembly.initial_state(), later(assembly, values.speed)):
            costs = part_costs(assembly, state)
            print(f"{needles:3d} needles " + "".join(f"{cost:13.1f}" for cost in costs), flush=True)
    cases = [{"needle_count": n} for n in (9, 18, 27)] + [{"spheres_per_needle": s} for s in (3, 5, 7, 11)]
    for case in cases:
        result = td.simulate(model="needles", relative_tolerance=1e-3, **SKEW, **case)
        amplitudes = result.thrust_amplitude.values[2:4] if result.finished else (np.nan, np.nan)
        errors = result.thrust_amplitude_error.values[2:4] if result.finished else (np.nan, np.nan)
        cost = result.cost
        print(
            f"{case}: {cost['cpu_seconds']:.2f} s, {cost['steps']} steps, second {amplitudes[0]:.4f} +- "
            f"{errors[0]:.3f} N, third {amplitudes[1]:.4f} +- {errors[1]:.3f} N {result.outcome_detail.values}",
            flush=True,
        )


if __name__ == "__main__":
    if sys.argv[1:] != ["--record"]:
        main()
    candidate_prices(record=sys.argv[1:] == ["--record"])
