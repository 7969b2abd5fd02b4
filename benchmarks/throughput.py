"""Points per second of the equilibrium model, side by side in one run.

    python benchmarks/throughput.py [--points 200000]

Lines: the kernel inside a block (one core); `tripod-doe run` with two workers, journal, cube and report included; two
independent processes on the same points, without any of that; plain NumPy, one point at a time; xyzpy around the
kernel, one point a call. All third orders are compared, so that nobody is fast and wrong.
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy_equilibrium import third_order

import tripod_doe as td
from tripod_doe.joint.unit_conversion import internal_values
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file import load_study, parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task, run_task

HERE = Path(__file__).parent
BLOCK = 5000


def simulate_range(text: str, start: int, stop: int) -> float:
    """What one independent process does: blocks of the same points, no journal, no cube; returns the wall time."""
    study = parse_study(text)
    points = make_points(study)
    run_task(make_task(study, points, np.arange(1)))  # compiles, or loads machine code
    began = time.perf_counter()
    for first in range(start, stop, BLOCK):
        run_task(make_task(study, points, np.arange(first, min(first + BLOCK, stop))))
    return time.perf_counter() - began


def one_point(**factors: float) -> float:
    """The task of xyzpy: one point through the kernel."""
    scene = load_simulator("joint")
    columns = {name: np.array([value]) for name, value in factors.items()}
    result = scene.simulate(scene.columns({"model": "equilibrium"}, columns, 1), ["thrust_amplitude"])
    return float(result.outputs["thrust_amplitude"].data[0, 3])


def rate_of_numpy(study, points, count):
    columns = {name: column[:count] for name, column in points.columns.items()}
    full = study.simulator.columns({"model": "equilibrium", "relative_tolerance": 1e-9}, columns, count)
    internal = internal_values(full)
    began = time.perf_counter()
    third = [third_order(internal.point(i)) for i in range(count)]
    return count / (time.perf_counter() - began), np.array(third)


def rate_of_xyzpy(points, count):
    import xyzpy

    cases = [tuple(float(column[i]) for column in points.columns.values()) for i in range(count)]
    began = time.perf_counter()
    third = xyzpy.case_runner(one_point, tuple(points.columns), cases, parallel=True, num_workers=2, verbosity=0)
    return count / (time.perf_counter() - began), np.array(third, float).ravel()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=200_000)
    count = parser.parse_args().points
    text = (HERE / "throughput.toml").read_text().replace("samples = 200000", f"samples = {count}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "throughput.toml"
        path.write_text(text)
        study = load_study(path)
        points = make_points(study)
        inside = min(count, 20_000) / simulate_range(text, 0, min(count, 20_000))
        print(f"inside a block, one core            {inside:10,.0f} points/s")

        began = time.perf_counter()
        processes = [
            subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    f"import sys; sys.path.insert(0, {str(HERE)!r}); "
                    f"import throughput; print(throughput.simulate_range(open({str(path)!r}).read(), {a}, {b}))",
                ],
                stdout=subprocess.PIPE,
                text=True,
            )
            for a, b in ((0, count // 2), (count // 2, count))
        ]
        working = max(float(process.communicate()[0]) for process in processes)
        independent = count / (time.perf_counter() - began)
        print(
            f"two independent processes           {independent:10,.0f} points/s, whole processes; "
            f"{count / working:,.0f} while they work"
        )

        out = Path(folder) / "out"
        began = time.perf_counter()
        run = subprocess.run(
            [sys.executable, "-m", "tripod_doe.cli", "run", str(path), "--workers", "2", "--out", str(out)],
            check=True,
            stderr=subprocess.PIPE,
            text=True,
        )
        whole = count / (time.perf_counter() - began)
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        cube = td.open_cube(out)
        seconds = float(re.findall(r"points computed in ([0-9.]+) s", run.stderr)[0])
        print(
            f"tripod-doe run, two workers         {whole:10,.0f} points/s, journal, cube and report included; "
            f"{count / seconds:,.0f} while they work, {working / seconds:.2f} of the independent processes"
        )
        print(f"    largest process {memory:,.0f} MB, cube {(out / 'cube.nc').stat().st_size / 1e6:,.0f} MB")
        ours = cube["thrust_amplitude"].sel(order=3).values

        rate, third = rate_of_numpy(study, points, 20)
        error = np.abs(third / ours[:20] - 1).max()
        print(
            f"plain NumPy, one core               {rate:10,.1f} points/s (run is {whole / rate:,.0f} times faster; "
            f"largest difference {error:.0e})"
        )
        rate, third = rate_of_xyzpy(points, min(count, 2000))
        error = np.abs(third / ours[: third.size] - 1).max()
        print(
            f"xyzpy around the kernel, two procs  {rate:10,.0f} points/s (run is {whole / rate:.1f} times faster; "
            f"largest difference {error:.0e})"
        )


if __name__ == "__main__":
    main()
