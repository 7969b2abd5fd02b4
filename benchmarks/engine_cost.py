"""What the engine costs: a contact, the parts of an implicit step and whole steps of rings of needles, and compilation.

    python benchmarks/engine_cost.py [--compile]

Times are the best of several repetitions, CPU seconds of one core. `--compile` starts fresh processes with an empty and
with a filled compile cache.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "mechanics" / "scenes"))

from needle_ring import needle_ring

from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.sphere_contact import add_contacts
from tripod_doe.mechanics.integrators.monitor import Settings, accept, begin_watch
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces, linearise
from tripod_doe.mechanics.solve.newton import factorise_system, gather, solve_system
from tripod_doe.mechanics.tables import FIRST, Slopes

FIRST_USE = """
import time; begun = time.perf_counter()
from tripod_doe.mechanics.scenes.needle_between_plates import simulator
import numpy as np
imported = time.perf_counter()
values = simulator.effective({"method": "METHOD", "duration_s": 1e-3})
simulator.simulate({name: np.array([value], object) for name, value in values.items()}, ["axial_drift_mm"])
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


@kernel
def _search(repetitions, tables, work, positions, velocities, slopes):
    for _ in range(repetitions):
        add_contacts(tables, work, FIRST, tables.contacts.size, positions, velocities, slopes, work.matrix)


def contact_cost(needles: int = 27) -> dict[str, float]:
    """Nanoseconds a row of seven spheres: apart, touching, and touching with derivatives."""
    costs = {}
    for name, preload, by_velocity in (("apart", -1e-3, 0.0), ("forces", 1e-3, 0.0), ("forces and D, K", 1e-3, 1e-6)):
        assembly = assemble(needle_ring(needles, preload=preload))
        state, work = assembly.initial_state(), assembly.work()
        rows = assembly.tables.contacts[assembly.tables.contacts["count"] > 1]
        rows = np.ascontiguousarray(rows[np.arange(rows.size) % 3 < 2])  # trunnion and bore, all in the same state
        tables = dataclasses.replace(assembly.tables, contacts=rows)
        arguments = (tables, work, state.positions, state.velocities, Slopes(1.0, by_velocity, 0.0))
        _search(1, *arguments)
        costs[name] = 1e9 * best(lambda arguments=arguments: _search(200, *arguments)) / 200 / rows.size
    return costs


PARTS = ("forces", "matrix", "factorisation", "solution", "monitor")


@kernel
def _repeat(repetitions, part, tables, work, positions, velocities, clock, settings):
    for _ in range(repetitions):
        if part == 0:
            generalized_forces(tables, work, positions, velocities)
        if 1 <= part <= 3:
            linearise(tables, work, positions, velocities, 1.0, 1e-6, 1e-12, work.matrix)
        if 2 <= part <= 3:
            factorise_system(tables, work, positions)
        if part == 3:
            clear(work.blocks)
            gather(tables, work.force, 1e-6, work.blocks)
            solve_system(tables, work, work.gamma, work.stages[0])
        if part == 4:
            accept(tables, work, positions, velocities, clock, 0.0, 1e-6, settings)


def part_costs(assembly: Assembly, state: State | None = None) -> list[float]:
    """Microseconds of each part of a step, at the start or in another state; a part is what comes to the one before."""
    state, work = state.copy() if state else assembly.initial_state(), assembly.work()
    costs = []
    for part in range(len(PARTS)):
        arguments = (part, assembly.tables, work, state.positions, state.velocities, np.zeros(3), Settings())
        _repeat(1, *arguments)
        costs.append(1e6 * best(lambda arguments=arguments: _repeat(50, *arguments)) / 50)
    forces, matrix, factorised, solved, monitor = costs
    return [forces, matrix - forces, factorised - matrix, solved - factorised, monitor]


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
    text = ", ".join(f"{name} {cost:.0f} ns" for name, cost in contact_cost().items())
    print(f"a row of seven spheres: {text}")
    print("us a part of an implicit step")
    for needles in (3, 9, 27, 81):
        costs = part_costs(assemble(needle_ring(needles)))
        text = "  ".join(f"{name} {cost:5.1f}" for name, cost in zip(PARTS, costs, strict=True))
        print(f"{needles:3d} needles  {text}  together {sum(costs):6.1f}")
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
