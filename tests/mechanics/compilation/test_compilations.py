"""How often each kernel compiles from an empty cache: once, but for those in a list with their reason.

A second layout of an array, or a literal beside an integer, would compile a kernel once more, and all that it calls.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from tripod_doe.joint.simulator import simulator
from tripod_doe.mechanics.compilation.first_compilation import compilations

COMPILE = """
import json, sys
from tripod_doe.joint.simulator import simulator
from tripod_doe.mechanics.compilation.first_compilation import compilations
simulator.compile(*sys.argv[1:3])
print(json.dumps(compilations(sys.argv[3])))
"""
"""Compiles what a model needs, and answers how often each kernel was compiled."""

TIMES = {
    # for the rows of trunnion and bore as literals: with rows in a variable kinetostatic takes some percent longer
    "tripod_doe.joint.massless_needles.load_along_needle._follow": 2
}
"""Kernels that compile more than once, each with its reason in a comment."""

KERNELS = {
    "equilibrium": (
        "model equilibrium with newton",
        "tripod_doe.joint.force_balance.equilibrium_relaxation.settle_still",
    ),
    "kinetostatic": (
        "model kinetostatic with newton",
        "tripod_doe.joint.force_balance.kinetostatic_relaxation.settle_moving",
    ),
    "rollers": (
        "models rollers and needles with adaptive-euler",
        "tripod_doe.mechanics.integrators.adaptive_euler.integrate",
    ),
}
"""What is compiled for each model, and one kernel of it."""


PARTS = {
    f"tripod_doe.mechanics.solve.{name}" for name in ("newton.solve_stage", "equations_of_motion.linearise_elements")
}
"""Large parts of kernels, which compile with those that call them and never for themselves."""

METHODS = {model: next(iter(simulator.methods({"model": model}))) for model in KERNELS}


def from_an_empty_cache(model, kernels, folder):
    """Count in a process that compiles everything anew."""
    words = [sys.executable, "-c", COMPILE, model, METHODS[model], kernels]
    done = subprocess.run(
        words, env=os.environ | {"NUMBA_CACHE_DIR": str(folder)}, capture_output=True, text=True, check=True
    )
    announced, compiled = done.stderr.splitlines()
    assert announced.startswith(f"compiling kernels of {kernels}")
    assert compiled.startswith("compiled in ")
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("model", KERNELS)
def test_every_kernel_compiles_once(model, tmp_path):
    """Exact, by what the compile cache of this version noted when it was filled.

    That costs no second compilation. Where part of the kernels was in the cache before, they compile here once more.
    Formulas that are inlined compile once for each kind of argument, and are not counted.
    """
    kernels, kernel = KERNELS[model]
    simulator.compile(model, METHODS[model])
    counts = compilations(kernels)
    if kernel not in counts:
        counts = from_an_empty_cache(model, kernels, tmp_path)
    assert kernel in counts
    assert counts.keys().isdisjoint(PARTS)
    assert {name: count for name, count in counts.items() if count > TIMES.get(name, 1)} == {}
