"""What an optimisation costs beside its points: the CPU time of one process, less the planned price of the points.

    python benchmarks/search_cost.py [--evaluations 1000 3000 10000 20000]

The constants of `tripod_doe.workflow.optimise_plan` are the least squares of such rows.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import tripod_doe as td
from tripod_doe.analyses.optimisation.search import population_of
from tripod_doe.workflow.optimise_plan import plan_optimisation

FILE = """
[optimisation]
name = "search cost"
[base]
model = "equilibrium"
[variables]
joint_angle_deg = {low = 2, high = 12}
pitch_radius_mm = {low = 19, high = 25}
[objectives.third]
output = "thrust_amplitude"
order = 3
[objectives.radius]
output = "pitch_radius_mm"
goal = "maximise"
[search]
evaluations = """


def main() -> None:
    """Plan and run optimisations of several sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--evaluations", type=int, nargs="+", default=[1000, 3000, 10_000, 20_000])
    for evaluations in parser.parse_args().evaluations:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "optimise.toml"
            file.write_text(FILE + str(evaluations))
            *points, beside = plan_optimisation(file)
            planned = 3600 * sum(part.cpu_hours[1] for part in points if part.cpu_hours)
            started = time.process_time()
            summary = td.optimise(file, Path(folder) / "out", workers=0, progress=False)
            spent = time.process_time() - started
        generations = evaluations / population_of(evaluations, None)
        print(
            f"{summary.computed:7,} points, {generations:4.0f} generations: {spent:6.1f} CPU-s, {planned:6.1f} planned for "
            f"points, {spent - planned:5.1f} beside them, planned {3600 * beside.cpu_hours[1]:5.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
