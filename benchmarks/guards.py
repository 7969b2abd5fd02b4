"""Do runs know when they fail? Random runs of the needle scene against the truth.

    python benchmarks/guards.py [--count 200] [--seed 1]

Every run draws method, step, friction, plate speed, skew and load. The truth is the Rosenbrock method at 1e-7, held
against the closed form. A run is wrong if its drift is off by more than 5 %. Target: no wrong run is called finished,
and at most 2 % of the runs are good but called inaccurate.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.scenes.needle_between_plates import closed_form, scene
from tripod_doe.results import Outcome

STEPS = {  # log-uniform range of steps, s
    "symplectic-euler": (2e-9, 1e-6),
    "rk4": (2e-9, 1e-6),
    "linearly-implicit-euler": (1e-8, 1e-3),
    "implicit-euler": (1e-7, 1e-3),
    "bdf2": (1e-7, 1e-3),
    "generalized-alpha": (1e-7, 1e-3),
}
CONTROLLED = {
    "rosenbrock": (1e-7, 1e-2),
    "scipy-radau": (1e-8, 1e-2),
    "scipy-bdf": (1e-8, 1e-2),
    "scipy-lsoda": (1e-8, 1e-2),
}
LARGEST_STEPS = 100_000


def draw(rng: np.random.Generator) -> tuple[str, dict[str, float]]:
    """Draw one run."""
    methods = list(STEPS) + list(CONTROLLED)
    method = methods[rng.integers(len(methods))]
    friction = rng.uniform(0.01, 0.1, 2)
    while not max(friction) / min(friction) > 1.05:  # equal friction has no drift to be relative to
        friction = rng.uniform(0.01, 0.1, 2)
    values = {
        "friction_a": friction[0], "friction_b": friction[1],
        "plate_speed_mm_s": np.exp(rng.uniform(*np.log([10, 1000]))),
        "skew_deg": rng.choice([-1, 1]) * rng.uniform(0.3, 10), "load_n": np.exp(rng.uniform(*np.log([10, 500]))),
    }  # fmt: skip
    low, high = np.log(STEPS.get(method) or CONTROLLED[method])
    setting = float(np.exp(rng.uniform(low, high)))
    if method in STEPS:
        duration = min(0.05, setting * LARGEST_STEPS)
        return method, values | {"step_s": min(setting, duration / 20), "duration_s": duration}
    return method, values | {"relative_tolerance": setting, "duration_s": 0.01}


def simulate(method: str, values: dict[str, float]):
    """Run one point and return the run and its drift."""
    full = scene.effective({"method": method} | {name: float(value) for name, value in values.items()})
    numbers = {name: float(value) for name, value in full.items() if isinstance(value, int | float)}
    settings = Settings(tolerance=numbers.get("relative_tolerance", 0.0), budget=2_000_000)
    result = scene.run(numbers, method, numbers.get("step_s"), settings)
    return result, float(result.positions[-1, 1, 1]), closed_form(numbers)[1]


def truth(values: dict[str, float]) -> float:
    """Drift by the Rosenbrock method at a tight tolerance, which must have finished."""
    fine = {name: value for name, value in values.items() if name != "step_s"} | {"relative_tolerance": 1e-7}
    result, drift, _ = simulate("rosenbrock", fine)
    if result.outcome != Outcome.FINISHED:
        raise SystemExit(f"no truth for {values}: {result.detail}")
    return drift


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    lies, false_alarms, rows, shares = [], [], {}, []
    begun = time.perf_counter()
    for number in range(arguments.count):
        method, values = draw(rng)
        result, drift, formula = simulate(method, values)
        true = truth(values)
        error = abs(drift - true) / abs(true) if np.isfinite(drift) else np.inf
        if result.outcome not in (Outcome.FINISHED, Outcome.INACCURATE):
            error = np.inf
        finished, wrong = result.outcome == Outcome.FINISHED, not error <= 0.05
        row = rows.setdefault(method, [0, 0, 0, 0])
        row[2 * wrong + (not finished)] += 1
        if finished:
            shares.append(result.check_evaluations / result.force_evaluations)
        text = (
            f"{number} {method} {values} error {error:.3g} truth against the closed form {true / formula - 1:.2g} "
            f"energy {result.energy_residual:.2g} reversals {result.reversals:.2g} halved step "
            f"{result.disagreement:.2g}: {result.detail}"
        )
        if finished and wrong:
            lies.append(text)
        if not finished and not wrong:
            false_alarms.append(text)
    print(f"{'method':26s} good+finished  good+flagged  wrong+finished  wrong+flagged")
    for method, row in sorted(rows.items()):
        print(f"{method:26s} {row[0]:13d} {row[1]:13d} {row[2]:15d} {row[3]:14d}")
    print(f"wrong but called finished: {len(lies)} (target 0)")
    print(f"good but called inaccurate: {len(false_alarms)} (target {arguments.count // 50})")
    print(f"checks: {100 * np.median(shares):.1f} % of the force evaluations (median of the finished runs)")
    print(f"{time.perf_counter() - begun:.0f} s")
    for title, texts in (("LIES", lies), ("FALSE ALARMS", false_alarms)):
        print("\n".join([title, *texts]) if texts else f"no {title.lower()}")


if __name__ == "__main__":
    main()
