"""A cube of several times an address-space limit through a run, a query, an analysis and the page.

    python benchmarks/larger_than_memory.py [--limit 1000] [--times 4]

Each command runs under the limit (MB, `ulimit -v`). Its points are those of a function that answers at once with a course
of 16,000 numbers (128 kB) and a number; one point of a hundred fails. Before each command the limit is shown to be real: an array
of its size is refused.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FUNCTION = """
import numpy as np
import xarray as xr

LABELS = {"rotation_deg": np.arange(16000) * 0.0225}
COURSE = np.sin(np.arange(16000) / 800)


def force(x, y):
    if 10 * x % 1 > 0.99:
        raise ValueError("the joint locks")
    return xr.Dataset({"course": ("rotation_deg", x * COURSE + y), "peak": x + y}, coords=LABELS)
"""
STUDY = """
[study]
name = "larger than memory"
question = "?"
function = "force:force"
[factors]
x = {{low = 0, high = 1}}
y = {{low = 0, high = 1}}
[design]
kind = "saltelli"
samples = {samples}
second_order = false
[run]
block = 100
expected_outcomes = ["error"]
[analysis.sobol]
most_dropped = 0.5
resamples = 20
"""
COMMANDS = {
    "run": ["run", "study.toml", "--out", "out", "--workers", "0"],
    "query": ["query", "out", "--variable", "course", "--select", "point=7", "--format", "json", "--output", "one.json"],
    "where": ["query", "out", "--variable", "course", "--where", "x > 0.9999 and rotation_deg < 1", "--output", "some.csv"],
    "report": ["report", "out"],
}  # fmt: skip


def limited(limit: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--limit", type=int, default=1000, help="MB")
    words.add_argument("--times", type=float, default=4.0, help="size of the cube over the limit")
    options = words.parse_args()
    limit = options.limit * 1_000_000
    samples = 1 << (int(options.times * limit / 128_000 / 4) - 1).bit_length()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "force.py").write_text(FUNCTION)
        (Path(folder) / "study.toml").write_text(STUDY.format(samples=samples))
        refused = f"import numpy; numpy.ones({limit // 8})"
        done = subprocess.run(
            [sys.executable, "-c", refused], preexec_fn=lambda: limited(limit), stderr=subprocess.PIPE, check=False
        )
        assert b"MemoryError" in done.stderr or b"ArrayMemoryError" in done.stderr, "the limit does not hold"
        for name, command in COMMANDS.items():
            before, began = os.times(), time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-m", "tripod_doe.cli", *command], cwd=folder, preexec_fn=lambda: limited(limit),
                stderr=subprocess.PIPE, text=True, check=False,
            )  # fmt: skip
            cpu = sum(os.times()[2:4]) - sum(before[2:4])
            print(
                f"{name:8} exit {done.returncode}, {cpu:6.1f} CPU-s, {time.perf_counter() - began:6.1f} s", flush=True
            )
            if done.returncode:
                print(done.stderr[-2000:])
            if name == "run":
                out = Path(folder) / "out"
                size = sum(path.stat().st_size for path in (out / "cube.nc", out / "cost.nc"))
                print(f"         {4 * samples:,} points, cube {4 * samples * 128_008 / limit:.1f} times the limit, "
                      f"{size / 1e6:,.0f} MB in the file, analyses {[p.name for p in (out / 'analysis').glob('*')]}")  # fmt: skip


if __name__ == "__main__":
    main()
