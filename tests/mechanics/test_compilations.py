"""How often each kernel compiles from an empty cache: once, but for those in a list with their reason.

A second layout of an array, or a literal beside an integer, would compile a kernel once more, and all that it calls.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

COUNT = """
import collections, json, sys
from numba.core import event
from tripod_doe.joint.simulator import simulator

class Counter(event.Listener):
    counts = collections.Counter()
    def on_start(self, event):
        pass
    def on_end(self, event):
        kernel = event.data["dispatcher"]
        if kernel.py_func.__module__.startswith("tripod_doe.") and "forceinline" not in kernel.targetoptions:
            self.counts[f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"] += 1

event.register("numba:compile", Counter())
model = sys.argv[1]
simulator.compile(model, next(iter(simulator.methods({"model": model}))))
print(json.dumps(Counter.counts))
"""

TIMES: dict[str, int] = {}
"""Kernels that compile more than once, each with its reason in a comment; none today."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "kernel"),
    [
        ("equilibrium", "tripod_doe.joint.relaxation.solve_still"),
        ("kinetostatic", "tripod_doe.joint.moving_relaxation.solve_moving"),
        ("rollers", "tripod_doe.mechanics.implicit.solve_stage"),
    ],
)
def test_every_kernel_compiles_once(model, kernel, tmp_path):
    """Exact. Formulas that are inlined compile once for each kind of argument, and are not counted."""
    done = subprocess.run(
        [sys.executable, "-c", COUNT, model], env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    counts = json.loads(done.stdout)
    assert kernel in counts
    assert {name: count for name, count in counts.items() if count > TIMES.get(name, 1)} == {}
    announced, compiled = done.stderr.splitlines()
    assert announced.startswith("compiling kernels of model")
    assert compiled.startswith("compiled in ")
