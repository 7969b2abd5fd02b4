"""How often each stated interval of 95 % holds the truth, over many seeds of functions whose truth is known.

    python benchmarks/intervals.py [--seeds 60]

An interval is honest where 90 to 99 % of 60 seeds hold; `pawn` and `delta` have none, and are tested against factors
without effect instead, of which 5 % count as resolved.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import xarray as xr
from multifidelity import MODELS, VARIANCE, holds
from multifidelity import ishigami as leveled
from scipy.stats import norm

from tripod_doe.analyses.comparison.comparison import compare
from tripod_doe.analyses.multifidelity.estimates import estimate
from tripod_doe.analyses.records.measurement import Measurement
from tripod_doe.analyses.sensitivity.delta import DeltaSettings, borgonovo_delta
from tripod_doe.analyses.sensitivity.morris import MorrisSettings, morris_effects
from tripod_doe.analyses.sensitivity.pawn import PawnSettings, pawn_indices
from tripod_doe.analyses.sensitivity.rbd_fast import rbd_fast_indices
from tripod_doe.analyses.sensitivity.shapley import shapley_effects
from tripod_doe.analyses.sensitivity.sobol import SobolSettings, sobol_indices
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.simulator import Outcome
from tripod_doe.study.definition.study import parse_study
from tripod_doe.study.designs import make_points

_WEIGHTS = np.array([3.0, 2.0, 0.0])  # of a sum of normal factors: indices 9/13, 4/13, 0
_FACTORS = ("joint_angle_deg", "torque_n_m", "speed_rpm")
Hits = Iterator[tuple[str, float]]


def cube_of(design: str, seed: int) -> xr.Dataset:
    """y = 3 a + 2 b + 0 c of normal factors with a deviation of one."""
    factors = "\n".join(f'{name} = {{distribution = "normal", mean = 20, std = 1}}' for name in _FACTORS)
    text = f'[study]\nname = "t"\n[factors]\n{factors}\n[design]\n{design}\nseed = {seed}\n'
    columns = make_points(parse_study(text)).columns
    values = np.stack(list(columns.values()), axis=1) @ _WEIGHTS
    return xr.Dataset(
        {"y": ("point", values), "outcome": ("point", np.full(values.size, Outcome.FINISHED, np.int8))},
        coords={"point": np.arange(values.size)} | {name: ("point", column) for name, column in columns.items()},
        attrs={"study": text},
    )


def within(result: xr.Dataset, key: str, truth: np.ndarray | float) -> np.ndarray:
    return np.abs(result[key].values - truth) <= result[f"{key}_conf"].values + 1e-12


def of_indices(seed: int) -> Hits:
    """Sensitivity indices of the sum."""
    share = _WEIGHTS**2 / (_WEIGHTS**2).sum()
    result = sobol_indices(
        cube_of('kind = "saltelli"\nsamples = 128\nsecond_order = false', seed), SobolSettings(seed=seed)
    )
    yield from ((f"sobol {key}", hit) for key in ("S1", "ST") for hit in within(result, key, share)[:2])
    sampled = cube_of('kind = "latin-hypercube"\nsamples = 256', seed)
    yield from (("rbd-fast S1", hit) for hit in within(rbd_fast_indices(sampled), "S1", share)[:2])
    yield from (("shapley", hit) for hit in within(shapley_effects(sampled), "shapley", share)[:2])
    for name, analyse, settings in (("pawn", pawn_indices, PawnSettings), ("delta", borgonovo_delta, DeltaSettings)):
        yield f"{name}: not resolved without effect", analyse(sampled, settings(seed=seed))["resolved"].values[2] == 0


def of_effects(seed: int) -> Hits:
    """Morris' mean elementary effects of a product of factors, whose mean over the trajectories' grid is known."""
    text = (
        '[study]\nname = "t"\n[factors]\njoint_angle_deg = {low = 0, high = 1}\ntorque_n_m = {low = 0, high = 1}\n'
        f'[design]\nkind = "morris"\nsamples = 20\nseed = {seed}\n'
    )
    columns = make_points(parse_study(text)).columns
    values = np.prod(list(columns.values()), axis=0)
    cube = xr.Dataset(
        {"y": ("point", values), "outcome": ("point", np.full(values.size, Outcome.FINISHED, np.int8))},
        coords={name: ("point", column) for name, column in columns.items()},
        attrs={"study": text},
    )
    yield from (
        ("morris mu_star", hit) for hit in within(morris_effects(cube, MorrisSettings(seed=seed)), "mu_star", 0.5)
    )


def of_distributions(seed: int) -> Hits:
    """Quantiles, exceedance and gains under scatter."""
    cube = cube_of('kind = "latin-hypercube"\nsamples = 400', seed)
    exact, limit = norm(100, np.sqrt(13)), 104.0
    result = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": limit}, seed=seed))
    truth = exact.ppf(result["probability"].values)
    low, high = result["quantile_low"].values, result["quantile_high"].values
    yield from (("tolerance quantiles", a <= t <= b) for a, t, b in zip(low, truth, high, strict=True))
    yield "tolerance exceedance", result["exceedance_low"] <= exact.sf(limit) <= result["exceedance_high"]
    gain = 1 - np.sqrt([9 / 4 + 4, 9 + 1]) / np.sqrt(13)
    yield from (("tolerance gains", hit) for hit in within(result, "gain_of_halving", np.append(gain, 0))[:2])


def of_models(seed: int) -> Hits:
    """Mean and variance by several models, with splits of prices 1, 0.05 and 0.001."""
    for counts in ((48, 200, 1600), (48, 1500, 40000)):
        x = np.pi * (2 * np.random.default_rng(seed).random((counts[-1], 1, 3)) - 1)
        found = estimate([leveled(x[:count], *model) for count, model in zip(counts, MODELS, strict=True)])
        yield f"multifidelity mean {counts}", holds(found.mean, 3.5)
        yield f"multifidelity variance {counts}", holds(found.variance, VARIANCE, logarithmic=True)


def of_records(seed: int) -> Hits:
    """Amplitude and phase of a measured order, with noise."""
    rng, rotation = np.random.default_rng(seed), np.arange(0, 8 * 360, 3.0)
    force = 14 * np.cos(np.radians(3 * rotation - 75)) + rng.standard_normal(rotation.size)
    orders = np.arange(13)
    model = xr.Dataset(
        {"thrust_amplitude": ("order", 14.0 * (orders == 3)), "thrust_phase_deg": ("order", -75.0 * (orders == 3))},
        coords={"order": orders},
    )
    third = compare(Measurement(rotation, force, None, "zero"), model, 0.0).sel(order=3)
    yield "compare amplitude", bool(third["agrees"])
    yield "compare phase", abs(third["phase_difference_deg"]) <= third["phase_difference_uncertainty_deg"]


def main(arguments: list[str] | None = None) -> None:
    """Print a line for each kind of interval."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=60)
    options = parser.parse_args(arguments)
    hits: defaultdict[str, list[bool]] = defaultdict(list)
    for seed in range(options.seeds):
        for source in (of_indices, of_effects, of_distributions, of_models, of_records):
            for name, hit in source(seed):
                hits[name].append(bool(hit))
    for name, each in hits.items():
        print(f"{name:40} {100 * np.mean(each):5.1f} % of {len(each)}")


if __name__ == "__main__":
    main()
