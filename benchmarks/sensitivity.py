"""Sensitivity analyses: time and memory beside a loop over SALib, and how often intervals hold the analytic index.

python benchmarks/sensitivity.py [NAME ...] time and memory of 100,000 rows and 60 outputs, of some analyses or all
python benchmarks/sensitivity.py coverage   100 seeds of each method on Ishigami's function
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from collections.abc import Callable
from functools import partial

import numpy as np
import xarray as xr
from SALib.analyze import delta as salib_delta
from SALib.analyze import dgsm as salib_dgsm
from SALib.analyze import fast as salib_fast
from SALib.analyze import morris as salib_morris
from SALib.analyze import pawn as salib_pawn
from SALib.analyze import rbd_fast as salib_rbd_fast
from SALib.analyze import sobol as salib_sobol

from tripod_doe.analyses.factorial_effects.factorial_effects import factorial_effects
from tripod_doe.analyses.sensitivity.delta import borgonovo_delta
from tripod_doe.analyses.sensitivity.dgsm import derivative_measures
from tripod_doe.analyses.sensitivity.fast import fast_indices
from tripod_doe.analyses.sensitivity.morris import morris_effects
from tripod_doe.analyses.sensitivity.pawn import pawn_indices
from tripod_doe.analyses.sensitivity.rbd_fast import rbd_fast_indices
from tripod_doe.analyses.sensitivity.shapley import shapley_effects
from tripod_doe.analyses.sensitivity.sobol import sobol_indices
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file_schema import parse_file
from tripod_doe.study.designs import unit_sample

_LOOPED = 3  # outputs that SALib analyses: its time is the sum over all
FACTORS = ("a", "b", "c", "d", "e")
PROBLEM = {"num_vars": 5, "names": list(FACTORS), "bounds": [[0, 1]] * 5}
_PARTS = {"1": 0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, "2": 49 / 8, "13": 8 * 0.01 * np.pi**8 / 225}
_WHOLE = sum(_PARTS.values())
TRUTH = {
    "S1": np.array([_PARTS["1"], _PARTS["2"], 0]) / _WHOLE,
    "ST": np.array([_PARTS["1"] + _PARTS["13"], _PARTS["2"], _PARTS["13"]]) / _WHOLE,
    "shapley": np.array([_PARTS["1"] + _PARTS["13"] / 2, _PARTS["2"], _PARTS["13"] / 2]) / _WHOLE,
}
"""Of Ishigami's function with a = 7, b = 0.1."""


def ishigami(unit: np.ndarray) -> np.ndarray:
    x = np.pi * (2 * unit - 1)
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def cube_of(design: str, function: Callable[[np.ndarray], np.ndarray], width: int) -> tuple[xr.Dataset, np.ndarray]:
    """A cube of a design over the unit cube, made without a study run: the analyses are what is measured."""
    factors = "".join(f"{name} = {{low = 0, high = 1}}\n" for name in FACTORS[:width])
    text = f'[study]\nname = "b"\nfunction = "b:f"\n[factors]\n{factors}[design]\n{design}\n'
    file = parse_file(text)
    unit = unit_sample(file.design, file.factors)
    values = function(unit)
    dims = ("point", "component")[: values.ndim]
    cube = xr.Dataset(
        {"y": (dims, values), "outcome": ("point", np.full(len(unit), Outcome.FINISHED, np.int8))},
        coords={name: ("point", column) for name, column in zip(FACTORS, unit.T, strict=False)},
        attrs={"study": text},
    )
    return cube, unit


def sixty(unit: np.ndarray) -> np.ndarray:
    """Sixty outputs, each another mixture of the factors."""
    mix = np.random.default_rng(0).normal(size=(5, 60))
    return unit @ mix + np.sin(6 * unit[:, :1]) * (unit[:, 1:2] @ mix[:1])


def measured(call: Callable[[], object]) -> tuple[float, float]:
    """CPU seconds and the peak of new memory in MB."""
    tracemalloc.start()
    begin = time.process_time()
    call()
    seconds = time.process_time() - begin
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return seconds, peak


def beside_salib(names: list[str]) -> None:
    """Analyses (all, if none is named) of about 100,000 rows and 60 outputs, and SALib's in a loop where it has the same."""
    print(f"{'analysis':12} {'rows':>8}  {'ours: CPU s':>12} {'MB':>6}  {'SALib: CPU s':>12} {'MB':>6}")
    cases = {
        "sobol": (
            'kind = "saltelli"\nsamples = 8192',
            sobol_indices,
            lambda x, y: salib_sobol.analyze(PROBLEM, y, seed=1),
        ),
        "morris": (
            'kind = "morris"\nsamples = 16667',
            morris_effects,
            lambda x, y: salib_morris.analyze(PROBLEM, x, y, seed=1),
        ),
        "rbd-fast": (
            'kind = "rbd-fast"\nsamples = 100000',
            rbd_fast_indices,
            lambda x, y: salib_rbd_fast.analyze(PROBLEM, x, y, seed=1),
        ),
        "fast": (
            'kind = "fast"\nsamples = 20000',
            fast_indices,
            lambda x, y: salib_fast.analyze(PROBLEM, y, num_resamples=20, seed=1),
        ),
        "dgsm": (
            'kind = "finite-differences"\nsamples = 16667',
            derivative_measures,
            lambda x, y: salib_dgsm.analyze(PROBLEM, x, y, seed=1),
        ),
        "pawn": (
            'kind = "latin-hypercube"\nsamples = 100000',
            pawn_indices,
            lambda x, y: salib_pawn.analyze(PROBLEM, x, y, seed=1),
        ),
        "delta": (
            'kind = "latin-hypercube"\nsamples = 100000',
            borgonovo_delta,
            lambda x, y: salib_delta.analyze(PROBLEM, x, y, num_resamples=20, seed=1),
        ),
        "shapley": ('kind = "latin-hypercube"\nsamples = 100000', shapley_effects, None),
        "effects": ('kind = "rbd-fast"\nsamples = 100000', factorial_effects, None),
    }
    for name in names or cases:
        design, analyse, theirs = cases[name]
        cube, unit = cube_of(design, sixty, 5)
        seconds, peak = measured(partial(analyse, cube))
        line = f"{name:12} {len(unit):8,}  {seconds:12.2f} {peak:6.0f}"
        if theirs is not None:
            seconds, peak = measured(partial(one_by_one, theirs, unit, cube["y"].values[:, :_LOOPED]))
            line += f"  {seconds * 60 / _LOOPED:12.2f} {peak:6.0f}  (from {_LOOPED} of 60 outputs)"
        print(line, flush=True)


def one_by_one(theirs: Callable[[np.ndarray, np.ndarray], object], unit: np.ndarray, values: np.ndarray) -> None:
    """SALib's loop over outputs."""
    for column in values.T:
        theirs(unit, column)


def coverage(seeds: int = 100) -> None:
    """Share of the intervals that hold the analytic index, by method and number of samples."""
    methods = [
        (f'kind = "saltelli"\nsamples = {n}\nsecond_order = false', sobol_indices, ("S1", "ST"))
        for n in (64, 256, 1024)
    ]
    methods += [
        ('kind = "rbd-fast"\nsamples = 1024', rbd_fast_indices, ("S1",)),
        ('kind = "latin-hypercube"\nsamples = 1024', shapley_effects, ("shapley",)),
    ]
    for design, analyse, keys in methods:
        hits: dict[str, list[np.ndarray]] = {key: [] for key in keys}
        for seed in range(seeds):
            found = analyse(cube_of(f"{design}\nseed = {seed}", ishigami, 3)[0])
            for key in keys:
                hits[key].append((np.abs(found[key] - TRUTH[key]) <= found[f"{key}_conf"]).values)
        told = ", ".join(f"{key} {100 * np.mean(hits[key]):.1f} %" for key in keys)
        print(f"{' '.join(design.split()):60} {told}", flush=True)


if __name__ == "__main__":
    coverage() if "coverage" in sys.argv[1:] else beside_salib(sys.argv[1:])
