"""Cubes of several times an address-space limit through a run, queries, every analysis of a study and the page.

    python benchmarks/larger_than_memory.py [--limit 1000] [--times 4] [--only saltelli,morris]

One study of each kind of design that analyses read. Each command runs under the limit (MB, `ulimit -v`). Its points are those of a function that answers at once with a course
of 16,000 numbers (128 kB) and a number; one point of a hundred fails. Before each command the limit is shown to be real: an array
of its size is refused.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tripod_doe as td

FUNCTION = """
import numpy as np
import xarray as xr

LABELS = {"rotation_deg": np.arange(16000) * 0.0225}
COURSE = np.sin(np.arange(16000) / 800)


def smooth(x, y, bore=1, shaft=1, level=1, method="rk4", step_s=1e-6):
    peak = x * (1 + bore) + y * (2 + shaft) + 0.1 * x * y * level + step_s * (1 + len(method))
    return xr.Dataset({"course": ("rotation_deg", x * COURSE + y), "peak": peak}, coords=LABELS)


def force(x, y):
    if 10 * x % 1 > 0.99:
        raise ValueError("the joint locks")
    return smooth(x, y)
"""
STUDY = """
[study]
name = "larger than memory"
question = "?"
function = "force:{function}"
[factors]
x = {{low = 0, high = 1{count}}}
y = {{low = 0, high = 1{count}}}
{design}
[run]
block = 100
expected_outcomes = ["error"]
"""


@dataclass(frozen=True)
class Design:
    """A study of one kind of design: its table with the analyses of the cube, by the number of points."""

    text: Callable[[int], str]
    function: str = "force"
    cells: int = 0  # of a grid: at each place of x and y

    def study(self, points: int) -> str:
        """The study with about so many points."""
        count = f", count = {math.isqrt(points // self.cells)}" if self.cells else ""
        return STUDY.format(function=self.function, count=count, design=self.text(points))


def _saltelli(points: int) -> str:
    samples = 1 << (points // 4 - 1).bit_length()
    return f"""[design]
kind = "saltelli"
samples = {samples}
second_order = false
[analysis.sobol]
most_dropped = 0.5
resamples = 20"""


def _steps(kind: str, analysis: str) -> Callable[[int], str]:
    """Designs of steps from each sample: one along each factor."""
    table = f"[analysis.{analysis}]\nmost_dropped = 0.5\nresamples = 20"
    return lambda points: f'[design]\nkind = "{kind}"\nsamples = {points // 3}\n{table}'


def _grid(points: int) -> str:
    return """[design]
kind = "grid"
[analysis.effects]
[analysis.effects_of_course]
kind = "effects"
outputs = ["course"]
[analysis.surrogate]
outputs = ["peak"]"""


def _stability(points: int) -> str:
    return """method = {values = ["rk4", "bdf2"]}
step_s = {values = [1e-6, 2e-6, 4e-6, 8e-6]}
[design]
kind = "grid"
[analysis.stability]
output = "course"
select = {rotation_deg = 45}"""


def _sampled(points: int) -> str:
    one = 'outputs = ["peak"]'  # of 16,000 numbers each these would take days, not memory
    return f"""[design]
kind = "latin-hypercube"
samples = {points}
seed = 1
[analysis.rbd-fast]
resamples = 10
[analysis.effects]
[analysis.pawn]
{one}
[analysis.delta]
{one}
[analysis.shapley]
{one}
[analysis.surrogate]
{one}
[analysis.tolerance]
{one}"""


def _switched(points: int) -> str:
    return f'''[design]
kind = "product"
of = ["switches", "places"]
[design.switches]
kind = "ablation"
factors = ["bore", "shaft"]
[design.places]
kind = "sobol"
samples = {points // 4}
seed = 1
factors = ["x", "y"]
[analysis.contribution]
output = "peak"
phase = ""
[analysis.contribution_of_course]
kind = "contribution"
output = "course"
phase = ""'''


def _several_models(points: int) -> str:
    return f"""level = {{values = [0, 1, 2]}}
[design]
kind = "multifidelity"
fidelity = "level"
indices = false
samples = {points // 8}
split = {{0 = {points // 2}, 1 = {3 * points // 8}, 2 = {points // 8}}}
prices = {{0 = 0.1, 1 = 0.2, 2 = 1}}
seed = 1
[analysis.multifidelity]"""


DESIGNS = {
    "saltelli": Design(_saltelli),
    "morris": Design(_steps("morris", "morris")),
    "fast": Design(
        lambda points: f'[design]\nkind = "fast"\nsamples = {points // 2}\nseed = 1\n[analysis.fast]', "smooth"
    ),
    "finite-differences": Design(_steps("finite-differences", "dgsm")),
    "latin-hypercube": Design(_sampled),
    "grid": Design(_grid, cells=1),
    "stability": Design(_stability, "smooth", cells=8),
    "ablation": Design(_switched, "smooth"),
    "multifidelity": Design(_several_models, "smooth"),
}
QUERIES = {
    "query": [
        "query",
        "out",
        "--variable",
        "course",
        "--select",
        "point=7",
        "--format",
        "json",
        "--output",
        "one.json",
    ],
    "where": [
        "query",
        "out",
        "--variable",
        "course",
        "--where",
        "x > 0.9999 and rotation_deg < 1",
        "--output",
        "some.csv",
    ],
    "report": ["report", "out"],
}


def limited(limit: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def command(name: str, words: list[str], folder: str, limit: int) -> None:
    """Run a command under the limit, and tell its price."""
    before, began = os.times(), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "tripod_doe.cli", *words],
        cwd=folder,
        preexec_fn=lambda: limited(limit),
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    cpu = sum(os.times()[2:4]) - sum(before[2:4])
    print(f"{name:20} exit {done.returncode}, {cpu:6.1f} CPU-s, {time.perf_counter() - began:6.1f} s", flush=True)
    if done.returncode:
        print(done.stderr[-2000:])


def one_design(name: str, points: int, limit: int) -> None:
    """Run the study of a design under the limit, and tell how large its cube is and which analyses were made."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "force.py").write_text(FUNCTION)
        (Path(folder) / "study.toml").write_text(DESIGNS[name].study(points))
        command(name, ["run", "study.toml", "--out", "out", "--workers", "0"], folder, limit)
        out = Path(folder) / "out"
        size = sum(path.stat().st_size for path in (out / "cube.nc", out / "cost.nc"))
        with td.open_cube(out, chunks="auto") as cube:
            print(
                f"{'':20} cube {cube.nbytes / limit:.1f} times the limit, {size / 1e6:,.0f} MB in the file, "
                f"made: {', '.join(sorted(path.stem for path in (out / 'analysis').glob('*')))}"
            )
        for query, words in QUERIES.items() if name == "saltelli" else ():
            command(query, words, folder, limit)


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--limit", type=int, default=1000, help="MB")
    words.add_argument("--times", type=float, default=4.0, help="size of the cube over the limit")
    words.add_argument("--only", default=",".join(DESIGNS), help="kinds of designs")
    options = words.parse_args()
    limit = options.limit * 1_000_000
    refused = f"import numpy; numpy.ones({limit // 8})"
    done = subprocess.run(
        [sys.executable, "-c", refused], preexec_fn=lambda: limited(limit), stderr=subprocess.PIPE, check=False
    )
    assert b"MemoryError" in done.stderr or b"ArrayMemoryError" in done.stderr, "the limit does not hold"
    for name in options.only.split(","):
        one_design(name, int(options.times * limit / 128_000), limit)


if __name__ == "__main__":
    main()
