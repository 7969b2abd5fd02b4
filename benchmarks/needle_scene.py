"""Error against CPU time on the needle and the roller scene: this engine and its peers.

    pip install exudyn mujoco
    python benchmarks/needle_scene.py [--scene roller|needle|both] [--out benchmarks/charts]

Every run is one of 0.1 s (needle) or 0.02 s (roller) without the checks, warm, CPU seconds of one core. The needle's
error is that of the drift against the Rosenbrock method at 1e-9; the roller's is relative to its closed form. Explicit
methods run the needle for 1 ms and are scaled up; their error is that of the steady drift.
MuJoCo has another friction law (a cone): its error is against the sharp closed form mu N sin(tilt). With one --scene the
rows of the other are kept from the file.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
import warnings
from pathlib import Path

import matplotlib
import numpy as np
from roller_peers import roller_in_exudyn, roller_in_mujoco

from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.mechanics.scenes import needle_between_plates, roller_in_groove

matplotlib.use("Agg")
import matplotlib.pyplot as plt

NO_CHECKS = Limits(windows=0)
IMPLICIT_STEPS = (1e-3, 1e-4, 1e-5, 1e-6)
SWEEP = {
    "linearly-implicit-euler": IMPLICIT_STEPS,
    "implicit-euler": IMPLICIT_STEPS,
    "bdf2": IMPLICIT_STEPS,
    "generalized-alpha": IMPLICIT_STEPS,
    "symplectic-euler": (1e-6, 1e-7, 2e-8, 5e-9, 2e-9),
    "rk4": (1e-6, 1e-7, 2e-8, 5e-9, 2e-9),
    "rosenbrock": (1e-2, 1e-4, 1e-6, 1e-8),
    "scipy-radau": (1e-4, 1e-6, 1e-8),
    "scipy-bdf": (1e-4, 1e-6, 1e-8),
    "scipy-lsoda": (1e-4, 1e-6, 1e-8),
}
MUJOCO = "MuJoCo (other friction law)"
EXPLICIT = ("symplectic-euler", "rk4")


def numbers(scene, **values) -> dict[str, float]:
    full = scene.effective(values)
    return {name: float(value) for name, value in full.items() if isinstance(value, int | float)}


def timed(scene_description, method: str, setting: float, duration: float):
    """Run twice, and time the second."""
    assembly = assemble(scene_description)
    step = setting if method in SWEEP and setting and METHOD_HAS_STEP[method] else None
    settings = Settings(tolerance=setting, budget=20_000_000)
    for _ in range(2):
        begun = time.process_time()
        result = run(assembly, method, duration, step=step, samples=2, settings=settings, limits=NO_CHECKS)
        seconds = time.process_time() - begun
    return result, seconds


METHOD_HAS_STEP = {name: name not in ("rosenbrock", "scipy-radau", "scipy-bdf", "scipy-lsoda") for name in SWEEP}


def needle_rows() -> list[tuple[str, str, float, float, float, str]]:
    values = numbers(needle_between_plates.simulator)
    scene, duration = needle_between_plates.build(values), values["duration_s"]
    reference = timed(scene, "rosenbrock", 1e-9, duration)[0].positions[-1, 1, 1]
    rate = needle_between_plates.closed_form(values)[1] / duration
    print(f"reference drift {reference:.12f} mm, closed form of the steady drift {rate * duration:.12f} mm")
    rows = []
    for method, sweep in SWEEP.items():
        for setting in sweep:
            if method in EXPLICIT:
                result, seconds = timed(scene, method, setting, 1e-3)
                y = result.positions[:, 1, 1]
                error = abs((y[-1] - y[1]) / 0.5e-3 - rate) * duration if result.times.size == 3 else np.nan
                seconds *= duration / 1e-3
            else:
                result, seconds = timed(scene, method, setting, duration)
                error = abs(result.positions[-1, 1, 1] - reference)
            rows.append(("needle", method, setting, error, seconds, result.outcome.label))
    try:
        from exudyn_needle import simulate_in_exudyn
    except ImportError:
        print("Exudyn is not installed: left out")
        return rows
    simulate_in_exudyn(values, 1e-3)  # compiles the contact law
    for step in (1e-3, 1e-4, 1e-5):
        drift, seconds = simulate_in_exudyn(values, step)
        rows.append(("needle", "Exudyn generalised-alpha", step, abs(drift - reference), seconds, ""))
    return rows


def roller_rows() -> list[tuple[str, str, float, float, float, str]]:
    values = numbers(roller_in_groove.simulator)
    scene, true = roller_in_groove.build(values), roller_in_groove.closed_form(values)
    rows = []
    for method, sweep in SWEEP.items():
        for setting in (1e-6, 1e-7, 1e-8) if method in EXPLICIT else sweep:
            result, seconds = timed(scene, method, setting, values["duration_s"])
            force = roller_in_groove.simulator.answer(values, result)["axial_force_n"]
            rows.append(("roller", method, setting, abs(force / true - 1), seconds, result.outcome.label))
    sharp = values["friction"] * values["load_n"] * abs(math.sin(math.radians(values["tilt_deg"])))
    peers = (
        ("Exudyn generalised-alpha", roller_in_exudyn, true, (1e-3, 1e-4, 1e-5, 1e-6), ""),
        (MUJOCO, roller_in_mujoco, sharp, (1e-3, 1e-4, 1e-5, 1e-6), "against the sharp closed form"),
    )
    for name, simulate, answer, steps, note in peers:
        for step in steps:
            try:
                simulate(values, step)  # warm
                force, seconds = simulate(values, step)
            except ImportError:
                print(f"{name} is not installed: left out")
                break
            except (RuntimeError, ValueError) as problem:
                print(f"{name} at {step:g} s: {problem}")
                rows.append(("roller", name, step, np.nan, np.nan, "failed"))
                continue
            rows.append(("roller", name, step, abs(force / answer - 1), seconds, note))
    return rows


def chart(rows, out: Path) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(13.5, 5.2), layout="constrained")
    titles = {
        "needle": ("Needle between two plates, 0.1 s", "error of the drift, mm"),
        "roller": ("Roller in its groove, 0.02 s (MuJoCo: against the sharp law)", "relative error of the axial force"),
    }
    names = list(dict.fromkeys(row[1] for row in rows))
    for axis, (scene, (title, label)) in zip(axes, titles.items(), strict=True):
        for number, name in enumerate(names):
            chosen = [row for row in rows if row[0] == scene and row[1] == name and np.isfinite(row[3])]
            if chosen:
                style = "--" if name.startswith("scipy") else ":" if name.startswith(("Exudyn", "MuJoCo")) else "-"
                errors = [max(row[3], 1e-16) for row in chosen]
                color = plt.get_cmap("tab20")(2 * number % 20 + (number > 9))
                axis.loglog([row[4] for row in chosen], errors, style, marker="o", ms=4, color=color, label=name)
        axis.set(title=title, xlabel="CPU seconds", ylabel=label)
        axis.grid(alpha=0.3)
    entries = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(entries.values(), entries.keys(), loc="outside right center", fontsize=8)
    figure.savefig(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "charts")
    parser.add_argument("--scene", choices=("roller", "needle", "both"), default="both")
    arguments = parser.parse_args()
    out = arguments.out
    out.mkdir(exist_ok=True)
    warnings.simplefilter("ignore")
    kept = []
    if arguments.scene != "both" and (out / "needle_scene.csv").exists():
        with (out / "needle_scene.csv").open(newline="") as file:
            kept = [(*row[:2], *map(float, row[2:5]), row[5]) for row in list(csv.reader(file))[1:]]
    rows = needle_rows() if arguments.scene != "roller" else [row for row in kept if row[0] == "needle"]
    rows += roller_rows() if arguments.scene != "needle" else [row for row in kept if row[0] == "roller"]
    with (out / "needle_scene.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scene", "method", "step_s or tolerance", "error", "cpu_s", "outcome without checks"])
        writer.writerows(rows)
    for row in rows:
        print(f"{row[0]:7s} {row[1]:26s} {row[2]:8.0e}  error {row[3]:9.2e}  CPU {row[4]:9.4f} s  {row[5]}")
    chart(rows, out / "needle_scene.svg")


if __name__ == "__main__":
    main()
