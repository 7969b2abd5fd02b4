"""Sobol' indices of Ishigami's function beside SALib's own workflow and OpenTURNS, each in its own process.

python benchmarks/sensitivity_peers.py [--samples 1024]

Values, CPU seconds with all imports, peak memory, and the lines that a user writes (function left out). A peer that is
not installed is left out.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

FUNCTION = """
import math
def ishigami(x1, x2, x3):
    return {"y": math.sin(x1) + 7 * math.sin(x2) ** 2 + 0.1 * x3**4 * math.sin(x1)}
"""
STUDY = """
[study]
name = "Ishigami"
function = "ishigami:ishigami"
[factors]
x1 = {low = -3.141592653589793, high = 3.141592653589793}
x2 = {low = -3.141592653589793, high = 3.141592653589793}
x3 = {low = -3.141592653589793, high = 3.141592653589793}
[design]
kind = "saltelli"
samples = SAMPLES
second_order = false
[analysis.sobol]
"""
OURS = """
import tripod_doe as td, xarray as xr
td.run("study.toml", "out", workers=0, progress=False)
found = xr.open_dataset("out/analysis/sobol.nc")
tell([*found["S1"].values, *found["ST"].values])
"""
SALIB = """
import numpy as np
from SALib.analyze import sobol as analyze
from SALib.sample import sobol as sample
problem = {"num_vars": 3, "names": ["x1", "x2", "x3"], "bounds": [[-np.pi, np.pi]] * 3}
x = sample.sample(problem, SAMPLES, calc_second_order=False, seed=1)
y = np.array([ishigami(*row)["y"] for row in x])
found = analyze.analyze(problem, y, calc_second_order=False, seed=1)
tell([*found["S1"], *found["ST"]])
"""
OPENTURNS = """
import openturns as ot
from math import pi
ot.RandomGenerator.SetSeed(1)
inputs = ot.JointDistribution([ot.Uniform(-pi, pi)] * 3)
model = ot.PythonFunction(3, 1, lambda x: [ishigami(*x)["y"]])
x = ot.SobolIndicesExperiment(inputs, SAMPLES).generate()
found = ot.SaltelliSensitivityAlgorithm(x, model(x), SAMPLES)
tell([*found.getFirstOrderIndices(), *found.getTotalOrderIndices()])
"""
TELL = (
    "import json, sys\nfrom ishigami import ishigami\ndef tell(values): print(json.dumps([float(v) for v in values]))\n"
)
PEERS = {"tripod_doe": (OURS, ""), "SALib": (SALIB, "SALib"), "OpenTURNS": (OPENTURNS, "openturns")}


def measured(code: str, folder: Path) -> tuple[list[float], float, float]:
    """Indices, CPU seconds and peak memory (MB) of a program of its own."""
    output = folder / "told.json"
    with output.open("w") as stream:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path[1:]])}
        process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", TELL + code], cwd=folder, stdout=stream, env=environment
        )
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"it ended with exit code {process.returncode}")
    told = json.loads(output.read_text().splitlines()[-1])
    return told, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3


def compare(samples: int) -> None:
    """One line a program."""
    print(f"{'':12} {'S1':>22} {'ST':>22} {'CPU s':>7} {'MB':>6} {'lines':>6}")
    for name, (code, package) in PEERS.items():
        if package and importlib.util.find_spec(package) is None:
            print(f"{name:12} not installed")
            continue
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            (folder / "ishigami.py").write_text(FUNCTION)
            (folder / "study.toml").write_text(STUDY.replace("SAMPLES", str(samples)))
            values, seconds, memory = measured(code.replace("SAMPLES", str(samples)), folder)
        first, total = (" ".join(f"{value:7.3f}" for value in part) for part in (values[:3], values[3:]))
        written = STUDY if name == "tripod_doe" else code
        lines = len([line for line in written.strip().splitlines() if "tell(" not in line])
        print(f"{name:12} {first:>22} {total:>22} {seconds:7.1f} {memory:6.0f} {lines:6}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1024, help="N of Saltelli's blocks")
    compare(parser.parse_args().samples)
