"""What the engine costs: a contact, a step against the size of a ring of needles, and compilation.

    python benchmarks/engine_cost.py [--compile]

Times are the best of several repetitions, CPU seconds of one core. `--compile` starts fresh processes with an empty and
with a filled compile cache.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from tripod_doe.mechanics.assembly import Assembly, assemble
from tripod_doe.mechanics.contact import contact_forces
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.monitor import Settings, begin_watch
from tripod_doe.mechanics.scenes.needle_ring import needle_ring

FIRST_USE = """
import time; begun = time.perf_counter()
from tripod_doe.mechanics.scenes.needle_between_plates import scene
import numpy as np
imported = time.perf_counter()
values = scene.effective({"method": "METHOD", "duration_s": 1e-3})
scene.simulate({name: np.array([value], object) for name, value in values.items()}, ["axial_drift_mm"])
print(time.perf_counter() - imported)
"""


def best(action, repetitions: int = 7) -> float:
    """Shortest CPU time of several repetitions."""
    times = []
    for _ in range(repetitions):
        begun = time.process_time()
        action()
        times.append(time.process_time() - begun)
    return min(times)


def contact_cost(needles: int = 27) -> list[float]:
    """Nanoseconds a touching sphere with rolling resistance, one without, and one that does not touch."""
    costs = []
    for preload, rolling in ((1e-3, True), (1e-3, False), (-1e-3, True)):
        assembly = assemble(needle_ring(needles, preload=preload))
        state, work = assembly.initial_state(), assembly.work()
        rows = assembly.tables.contacts[assembly.tables.contacts["count"] > 1]
        rows = np.ascontiguousarray(rows[np.arange(rows.size) % 3 < 2])  # trunnion and bore, all in the same state
        rows["rolling"] *= rolling
        arguments = (rows, state.positions, state.velocities, work.force, work.ledger, work.slip)
        contact_forces(*arguments)
        seconds = best(lambda arguments=arguments: [contact_forces(*arguments) for _ in range(200)]) / 200
        costs.append(1e9 * seconds / rows["count"].sum())
    return costs


def step_cost(assembly: Assembly, method: str, count: int, step: float) -> float:
    """Microseconds a step."""

    def steps() -> None:
        state, work = assembly.initial_state(), assembly.work()
        begin_watch(assembly.tables, work, state.positions, state.velocities, 0.0)
        METHODS[method].integrate(
            assembly.tables, work, state.positions, state.velocities, np.zeros(3), count * step, count, Settings()
        )

    steps()
    return 1e6 * best(steps, 5) / count


def compile_cost() -> None:
    for method in ("symplectic-euler", "bdf2", "rosenbrock"):
        with tempfile.TemporaryDirectory() as cache:
            environment = os.environ | {"NUMBA_CACHE_DIR": cache}
            command = [sys.executable, "-c", FIRST_USE.replace("METHOD", method)]
            runs = [subprocess.run(command, env=environment, capture_output=True, text=True, check=True) for _ in "12"]
            cold, warm = (float(run.stdout) for run in runs)
        print(f"first run with {method}: {cold:.1f} s cold, {warm:.2f} s from the cache")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--compile", action="store_true")
    if parser.parse_args().compile:
        compile_cost()
    rolling, sliding, apart = contact_cost()
    print(
        f"contact: {sliding:.0f} ns a touching sphere, {rolling:.0f} ns with rolling resistance, {apart:.0f} ns apart"
    )
    print("us a step, and us a step and needle")
    for needles in (3, 9, 27, 81):
        assembly = assemble(needle_ring(needles))
        costs = {
            "symplectic-euler": step_cost(assembly, "symplectic-euler", 50, 1e-9),
            "linearly-implicit-euler": step_cost(assembly, "linearly-implicit-euler", 50, 1e-6),
            "bdf2": step_cost(assembly, "bdf2", 50, 1e-6),
        }
        text = "  ".join(f"{name} {cost:8.1f} {cost / needles:6.2f}" for name, cost in costs.items())
        print(f"{needles:3d} needles  {text}")


if __name__ == "__main__":
    main()
