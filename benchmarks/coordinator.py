"""What a study costs besides its simulation: every stage of a run on made-up answers, in CPU time and memory.

    python benchmarks/coordinator.py [--points 1000000] [--design sobol|grid] [--block 5000] [--course 0] [--page]
                                      [--only plan]

The points are those of the joint with four factors; each "answers" at once with its outcome and 13 orders (104 bytes),
and with --course with a thrust of so many rotation angles (`--points 65536 --course 16000`: 8.4 GB).
"resume" is what the same command does, when it is run again, before it computes what is missing.
What every run costs once (imports, machine code) is the stage "start", and stands in no price of a point.
Memory is the largest of each stage, above that of the process before the study is read.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import tripod_doe as td
from tripod_doe.model_interface import BlockResult, Outcome, Values
from tripod_doe.reports.study_report import write_report
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task
from tripod_doe.study.failure_summary import failures_in
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.plan import plan
from tripod_doe.study.query.query import records
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.study.result_directory.open_cube import opened_cube
from tripod_doe.study.study_points import StudyPoints

SAMPLED = """
[study]
name = "coordinator"
question = "What does a point cost besides its simulation?"
[base]
model = "equilibrium"
[factors]
joint_angle_deg = {{low = 4, high = 12}}
torque_n_m = {{low = 50, high = 150}}
speed_rpm = {{low = 400, high = 800}}
groove_sliding_friction = {{low = 0.04, high = 0.08}}
[design]
kind = "sobol"
samples = {points}
seed = 1
[keep]
outputs = ["thrust_amplitude"{course}]
"""
_MOST_BYTES = 32_000_000  # of a block, as in a run


def grid_of(points: int) -> str:
    """The study as a grid of about so many points."""
    levels = round(points**0.25)
    text = SAMPLED.split("[design]")[0].replace("}}", f", count = {levels}}}}}")
    return text + '[design]\nkind = "grid"\n[keep]\noutputs = ["thrust_amplitude"{course}]\n'


def memory(what: str) -> float:
    """MB of this process: ``VmRSS`` now, ``VmHWM`` the most since it was reset."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(what))
    return int(line.split()[1]) / 1024


@contextmanager
def stage(name: str, points: int, before: float) -> Iterator[None]:
    """Measure a part of a run, and print it."""
    Path("/proc/self/clear_refs").write_text("5")
    cpu, wall = time.process_time(), time.perf_counter()
    yield
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    print(
        f"{name:24}{cpu:9.2f} CPU-s {1e6 * cpu / points:8.2f} us/point  wall {wall:7.2f} s  "
        f"memory {memory('VmHWM') - before:7.0f} MB, {1e6 * (memory('VmHWM') - before) / points:6.0f} bytes/point",
        flush=True,
    )


def rehearse(folder: Path) -> None:
    """Import what a run imports, and load its machine code."""
    import dask.array  # noqa: F401 - as xarray does for its first variable

    file = folder / "rehearsal.toml"
    file.write_text(SAMPLED.format(points=1024, course=""))
    study = load_study(file)
    asked = StudyPoints(study, make_points(study))
    study.simulator.prepare(asked.columns(np.arange(1)))
    with ResultDirectory(folder / "rehearsal") as directory:
        for block in answers(study, asked, directory.resume.missing(asked), 1024):
            directory.commit(block)
        directory.write_cube(asked, "rehearsal").close()


def answers(
    study: Study, asked: StudyPoints, missing: np.ndarray, block: int, course: int = 0
) -> Iterator[FinishedBlock]:
    """Finished blocks without simulation, with a course of so many numbers."""
    orders, angles = np.arange(13), np.arange(course) * 0.0225
    block = min(block, _MOST_BYTES // max(8 * course, 1))
    for start in range(0, missing.size, block):
        chosen = missing[start : start + block]
        make_task(asked.study, asked.points, chosen)
        result = BlockResult.blank(chosen.size, Outcome.FINISHED)
        result.outputs["thrust_amplitude"] = Values(("order",), np.sin(chosen)[:, None] + 2.0 + orders)
        result.coordinates["order"] = orders
        if course:
            size = np.sin(chosen)[:, None]
            result.outputs["thrust"] = Values(("rotation_deg",), size * np.sin(angles / 18) + size**2)
            result.coordinates["rotation_deg"] = angles
        yield FinishedBlock(asked.keys[chosen], result, 0.1, 0.1, f"worker {start % 7}")


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--points", type=int, default=1_000_000)
    words.add_argument("--design", choices=["sobol", "grid"], default="sobol")
    words.add_argument("--block", type=int, default=5000)
    words.add_argument("--course", type=int, default=0)
    words.add_argument("--page", action="store_true")
    words.add_argument("--only", choices=["plan"], help="nothing after this stage")
    options = words.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "study.toml"
        text = SAMPLED if options.design == "sobol" else grid_of(options.points)
        file.write_text(text.format(points=options.points, course=', "thrust"' if options.course else ""))
        study = load_study(file)
        out = Path(folder) / "out"
        before = memory("VmRSS")
        with stage("start", options.points, before):
            rehearse(Path(folder))
        with stage("plan", options.points, before):
            plan(study, timing=False)
        if options.only:
            return
        began = time.process_time()
        with stage("points", options.points, before):
            asked = StudyPoints(study, make_points(study))
        with stage("keys", options.points, before):
            asked.keys  # noqa: B018 - made when first asked for
        with ResultDirectory(out) as directory:
            with stage("checks, missing points", options.points, before):
                directory.accept(asked)
                missing = directory.resume.missing(asked)
            with stage("preparation", options.points, before):
                study.simulator.prepare(asked.columns(asked.of_each_kind(missing)))
            with stage("blocks, journal", options.points, before):
                for block in answers(study, asked, missing, options.block, options.course):
                    directory.commit(block)
            del missing
            with stage("points done", options.points, before):
                assert directory.resume.missing(asked).size == 0
            began_cube = time.perf_counter()
            with stage("cube", options.points, before):
                cube = directory.write_cube(asked, "benchmark")
            size, seconds = cube.nbytes / 1e6, time.perf_counter() - began_cube
            print(f"written {size:,.0f} MB of cube, {size / seconds:.0f} MB/s")
            with stage("failures", options.points, before):
                failures_in(cube, asked)
            del cube
        del asked
        price = 1e6 * (time.process_time() - began) / options.points
        print(f"a point costs {price:.2f} us besides its simulation, without plan and page")
        size = sum(path.stat().st_size for path in (out / "cube.nc", out / "cost.nc"))
        print(f"cube and costs {size / 1e6:,.0f} MB")
        with stage("resume", options.points, before):
            asked = StudyPoints(load_study(file), make_points(study))
            with ResultDirectory(out) as directory:
                directory.accept(asked)
                assert directory.resume.missing(asked).size == 0
        del asked
        with stage("lazy open", options.points, before):
            td.open_cube(out, chunks="auto").close()
        with stage("one point", options.points, before), opened_cube(out) as arrays:
            along = "point=5" if options.design == "sobol" else "joint_angle_deg=4"
            records(arrays, "thrust_amplitude", [along, "order=3"])
        if options.course and options.design == "sobol":
            with stage("one course", options.points, before), opened_cube(out) as arrays:
                records(arrays, "thrust", [f"point={options.points // 2}"])
        if options.page:
            with stage("page", options.points, before):
                page = write_report(out)
            print(f"page {page.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
