"""How often each stated interval of 95 % holds the truth, over many seeds of functions whose truth is known.

    python benchmarks/intervals.py [--seeds 60]

An interval is honest where 90 to 100 % of 60 seeds hold; `pawn` and `delta` have none, and are tested against factors
without effect instead, of which 5 % count as resolved. Where a method states no interval for a part of the indices, that
part stands beside.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import combinations

import numpy as np
import xarray as xr
from multifidelity import FIRST, MEDIAN, MODELS, TOTAL, VARIANCE, blocks, holds, holds_total
from multifidelity import ishigami as leveled
from scipy.stats import norm

from tripod_doe.analyses.comparison.comparison import compare
from tripod_doe.analyses.factorial_effects.factorial_effects import factorial_effects
from tripod_doe.analyses.main_effects.regression import Estimate, fit_factor
from tripod_doe.analyses.multifidelity.estimates import estimate
from tripod_doe.analyses.multifidelity.quantiles import quantiles
from tripod_doe.analyses.sensitivity.delta import borgonovo_delta
from tripod_doe.analyses.sensitivity.dgsm import derivative_measures
from tripod_doe.analyses.sensitivity.morris import morris_effects
from tripod_doe.analyses.sensitivity.pawn import ChanceSettings, PawnSettings, pawn_indices
from tripod_doe.analyses.sensitivity.rbd_fast import rbd_fast_indices
from tripod_doe.analyses.sensitivity.shapley import shapley_effects
from tripod_doe.analyses.sensitivity.sobol import sobol_indices
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.surrogate.surrogate import SurrogateSettings, surrogate
from tripod_doe.analyses.surrogate.what_if_page import what_if_pages
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.measurement import Measurement
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

_WEIGHTS = np.array([3.0, 2.0, 0.0])  # of a sum of normal factors: indices 9/13, 4/13, 0
_FACTORS = ("joint_angle_deg", "torque_n_m", "speed_rpm")
Hits = Iterator[tuple[str, float]]


_NAMES = [name for name, one in JOINT_PARAMETERS.items() if not one.choices and one.low <= 0 < 0.1 <= one.high]


def ishigami(u: np.ndarray) -> np.ndarray:
    x = np.pi * (2 * u - 1)
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def morris_1991(u: np.ndarray) -> np.ndarray:
    """The function of 20 factors of Morris (1991), with his coefficients drawn once."""
    random = np.random.default_rng(0)
    first, second = random.standard_normal(20), random.standard_normal((20, 20))
    first[:10], second[:6, :6] = 20, -15
    w = 2 * (u - 0.5)
    for at in (2, 4, 6):
        w[:, at] = 2 * (1.1 * u[:, at] / (u[:, at] + 0.1) - 0.5)
    y = w @ first + np.einsum("pi,ij,pj->p", w, np.triu(second, 1), w)
    for three in combinations(range(5), 3):
        y -= 10 * w[:, three].prod(axis=1)
    for four in combinations(range(4), 4):
        y += 5 * w[:, four].prod(axis=1)
    return y


def product(u: np.ndarray) -> np.ndarray:
    return u[:, 0] * u[:, 1]


def sparse(u: np.ndarray) -> np.ndarray:
    """Effects in corners alone."""
    return (u[:, :3] > 0.5).all(axis=1) + 1.0 * (u[:, 3:5] > 0.8).all(axis=1)


def heavy(u: np.ndarray) -> np.ndarray:
    """Effects that differ by a factor of 2,000."""
    return np.exp(3 * (u[:, 0] + u[:, 1] + 0.5 * u[:, 2])) + 0.1 * u[:, 3]


FUNCTIONS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], int]] = {
    "ishigami": (ishigami, 3), "morris-1991": (morris_1991, 20), "product": (product, 2), "sparse": (sparse, 5),
    "heavy": (heavy, 4),
}  # fmt: skip
_WITH_STEPS = ("sparse",)


def _unit_cube(design: str, function: Callable[[np.ndarray], np.ndarray], width: int, seed: int) -> xr.Dataset:
    """A function of the unit cube on a design, each factor from 0.01 to 0.1 of its unit."""
    factors = "\n".join(f"{name} = {{low = 0.01, high = 0.1}}" for name in _NAMES[:width])
    seeded = "" if "finite-differences" in design else f"\nseed = {seed}"
    text = f'[study]\nname = "t"\n[factors]\n{factors}\n[design]\n{design}{seeded}\n'
    columns = make_points(parse_study(text)).columns
    values = function((np.stack(list(columns.values()), axis=1) - 0.01) / 0.09)
    return xr.Dataset(
        {"y": ("point", values), "outcome": ("point", np.full(values.size, Outcome.FINISHED, np.int8))},
        coords={"point": np.arange(values.size)} | {name: ("point", column) for name, column in columns.items()},
        attrs={"study": text},
    )


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


LONG_MORRIS = 40_000
"""Trajectories whose mean effects are taken for the truth."""


def of_indices(seed: int) -> Hits:
    """Sensitivity indices of the sum."""
    share = _WEIGHTS**2 / (_WEIGHTS**2).sum()
    result = sobol_indices(
        cube_of('kind = "saltelli"\nsamples = 128\nsecond_order = false', seed), SensitivitySettings(seed=seed)
    )
    yield from ((f"sobol {key}", hit) for key in ("S1", "ST") for hit in within(result, key, share)[:2])
    sampled = cube_of('kind = "latin-hypercube"\nsamples = 256', seed)
    yield from (("rbd-fast S1", hit) for hit in within(rbd_fast_indices(sampled), "S1", share)[:2])
    yield from (("shapley", hit) for hit in within(shapley_effects(sampled), "shapley", share)[:2])
    for name, analyse, settings in (("pawn", pawn_indices, PawnSettings), ("delta", borgonovo_delta, ChanceSettings)):
        yield f"{name}: not resolved without effect", analyse(sampled, settings(seed=seed))["resolved"].values[2] == 0


def of_effects(seed: int) -> Hits:
    """Morris' mean elementary effects; the truth is their mean over many trajectories."""
    for name, (function, width) in FUNCTIONS.items():
        truth = _mean_effects(name)
        for samples in (10, 20, 50):
            found = morris_effects(_unit_cube(f'kind = "morris"\nsamples = {samples}', function, width, seed))
            half = found["mu_star_conf"].values
            hits = np.abs(found["mu_star"].values - truth) <= half + 1e-9 * truth.max()
            for hit, stated, acts in zip(hits, np.isfinite(half), truth > 0, strict=True):
                if acts:
                    yield f"morris mu_star, {name}, {samples} trajectories", float(hit) if stated else np.nan


@lru_cache
def _mean_effects(name: str) -> np.ndarray:
    function, width = FUNCTIONS[name]
    cube = _unit_cube(f'kind = "morris"\nsamples = {LONG_MORRIS}', function, width, 1000)
    unit = np.stack([cube[factor].values / 0.09 for factor in _NAMES[:width]], axis=1)
    moves = np.diff(unit.reshape(-1, width + 1, width), axis=1)
    effects = np.abs(np.diff(cube["y"].values.reshape(-1, width + 1), axis=1)) / np.abs(moves).max(axis=2)
    return np.array([effects[np.abs(moves).argmax(axis=2) == at].mean() for at in range(width)])


def of_derivatives(seed: int) -> Hits:
    """Mean squared derivatives, and the upper bounds made of them; designs that differ by their number of points."""
    for name in (each for each in FUNCTIONS if each not in _WITH_STEPS):
        found, large = _derivatives(name, 24 + seed), _derivatives(name, 4096)
        for key in ("vi", "dgsm"):
            half = found[f"{key}_conf"]
            hits = (np.abs(found[key] - large[key]) <= half).where(half.notnull())
            yield from ((f"dgsm {key}, {name}", float(hit)) for hit in hits.values[large[key].values > 1e-9])


@lru_cache
def _derivatives(name: str, samples: int) -> xr.Dataset:
    function, width = FUNCTIONS[name]
    return derivative_measures(_unit_cube(f'kind = "finite-differences"\nsamples = {samples}', function, width, 0))


def of_regressions(seed: int) -> Hits:
    """Effects of random designs: those of a regression on as many points as wanted."""
    for name in ("ishigami", "heavy", "product"):
        function, width = FUNCTIONS[name]
        truth = _long_regression(name)
        for kind in ("latin-hypercube", "halton"):
            found = factorial_effects(_unit_cube(f'kind = "{kind}"\nsamples = 64', function, width, seed))
            hits = np.abs(found["effect"] - truth.sel(term=found["term"])) <= found["effect_conf"] + 1e-9
            yield from ((f"effects, {name}, 64 points of {kind}", bool(hit)) for hit in hits.values)


def of_slopes(seed: int) -> Hits:
    """Changes over the range of a factor, as sentences on trends state them, beside those of as many points as wanted."""
    for name in ("ishigami", "heavy", "product"):
        function, width = FUNCTIONS[name]
        for at, truth in enumerate(_long_slopes(name)):
            own = _slope(function, width, at, 64, seed)
            yield f"slopes, {name}, 64 points", abs(own.value - truth) <= own.half


def _slope(function: Callable[[np.ndarray], np.ndarray], width: int, at: int, samples: int, seed: int) -> Estimate:
    cube = _unit_cube(f'kind = "latin-hypercube"\nsamples = {samples}', function, width, seed)
    columns = {name: cube[name].values for name in _NAMES[:width]}
    return fit_factor(columns, _NAMES[at], cube["y"].values, 0.0).trend


@lru_cache
def _long_slopes(name: str) -> list[float]:
    function, width = FUNCTIONS[name]
    return [_slope(function, width, at, 20_000, 1).value for at in range(width)]


@lru_cache
def _long_regression(name: str) -> xr.DataArray:
    function, width = FUNCTIONS[name]
    return factorial_effects(_unit_cube('kind = "latin-hypercube"\nsamples = 100000', function, width, 1))["effect"]


def of_distributions(seed: int) -> Hits:
    """Quantiles, exceedance and gains under scatter."""
    cube = cube_of('kind = "latin-hypercube"\nsamples = 400', seed)
    exact, limit = norm(100, np.sqrt(13)), 104.0
    result = tolerance(cube, ToleranceSettings(outputs=["y"], limits={"y": limit}, seed=seed))
    truth = exact.ppf(result["probability"].values)
    low, high = result["quantile_low"].values, result["quantile_high"].values
    yield from (("tolerance quantiles", a <= t <= b) for a, t, b in zip(low, truth, high, strict=True))
    yield "tolerance exceedance", result["exceedance_low"] <= exact.sf(limit) <= result["exceedance_high"]
    yield from of_remedies(seed)
    gain = 1 - np.sqrt([9 / 4 + 4, 9 + 1]) / np.sqrt(13)
    yield from (("tolerance gains", hit) for hit in within(result, "gain_of_halving", np.append(gain, 0))[:2])


def of_remedies(seed: int) -> Hits:
    """Chances to exceed with smaller scatters and moved centres, and whether what is proposed keeps the limit."""
    for samples in (400, 2048):
        cube, limit = cube_of(f'kind = "latin-hypercube"\nsamples = {samples}', seed), 107.0
        settings = ToleranceSettings(
            outputs=["y"], limits={"y": limit}, keep=0.98, seed=seed, costs=dict.fromkeys(_FACTORS, 1.0)
        )
        result, name = tolerance(cube, settings), f"tolerance, {samples} points"
        count = range(len(_FACTORS))
        halved = [np.where(np.arange(3) == at, 0.5, 1.0) for at in count]
        for at, sizes in enumerate(halved):
            yield f"{name}: chance if halved", _holds_chance(result.isel(factor=at), "if_halved", _beyond(limit, sizes))
        wrong = 0
        for first in count:
            for second in range(first + 1):
                one = result.isel(factor=first, factor_2=second)
                scale = np.where(np.isin(np.arange(3), (first, second)), float(one["scale_to_keep"]), 1.0)
                truth = _beyond(limit, scale)
                yield f"{name}: chance at a scale proposed", _holds_chance(one, "at_scale", truth)
                wrong += truth > 0.02
            truth = _beyond(limit - _WEIGHTS[first] * float(result["shift_to_keep"][first]), np.ones(3))
            yield f"{name}: chance at a shift proposed", _holds_chance(result.isel(factor=first), "at_shift", truth)
            wrong += truth > 0.02
        truth = _beyond(limit, result["cheapest_scale"].values)
        yield f"{name}: chance at the cheapest scales", _holds_chance(result, "at_cheapest", truth)
        yield f"{name}: all that is proposed keeps the limit", wrong + (truth > 0.02) == 0


def _beyond(limit: float, scales: np.ndarray) -> float:
    return float(norm(100, np.sqrt((_WEIGHTS**2 * scales**2).sum())).sf(limit))


def _holds_chance(result: xr.Dataset, way: str, truth: float) -> float:
    low, high = (float(result[f"exceedance_{way}_{end}"]) for end in ("low", "high"))
    return np.nan if np.isnan(low) or np.isnan(truth) else float(low <= truth <= high)


def of_surrogates(seed: int) -> Hits:
    """Bands of the what-if page at places that no point computed."""
    for name in ("ishigami", "product", "heavy"):
        function, width = FUNCTIONS[name]
        cube = _unit_cube('kind = "latin-hypercube"\nsamples = 96', function, width, seed)
        page = what_if_pages({"s": surrogate(cube, SurrogateSettings(seed=seed))})[0]
        for place in np.random.default_rng(seed).random((10, width)):
            values = dict(zip(_NAMES[:width], 0.01 + 0.09 * place, strict=True))
            ((value, half),) = page.at(**values)
            held = float(abs(value - function(place[None])[0]) <= half)
            yield f"what-if band, {name}", held if np.isfinite(half) else np.nan


def of_models(seed: int) -> Hits:
    """Mean, variance, indices and median by several models, with splits of prices 1, 0.05 and 0.001."""
    for counts in ((48, 200, 1600), (48, 1500, 40000)):
        x = blocks(seed, counts[-1])
        values = [leveled(x[:count], *model) for count, model in zip(counts, MODELS, strict=True)]
        found = estimate(values)
        yield f"multifidelity mean {counts}", holds(found.mean, 3.5)
        yield f"multifidelity variance {counts}", holds(found.variance, VARIANCE, logarithmic=True)
        for key, each, truth, inside in (("S1", found.first, FIRST, holds), ("ST", found.total, TOTAL, holds_total)):
            yield from ((f"multifidelity {key} {counts}", inside(*pair)) for pair in zip(each, truth, strict=True))
        low, high = quantiles([each[:, [0, -1]] for each in values], [0.5], 1.96)[1:, 0]
        yield f"multifidelity median {counts}", low <= MEDIAN <= high


def of_records(seed: int) -> Hits:
    """Amplitude and phase of a measured order, with noise."""
    rng, rotation = np.random.default_rng(seed), np.arange(0, 8 * 360, 3.0)
    force = 14 * np.cos(np.radians(3 * rotation - 75)) + rng.standard_normal(rotation.size)
    orders = np.arange(13)
    model = xr.Dataset(
        {
            "thrust_amplitude": ("order", 14.0 * (orders == 3), {"units": "N"}),
            "thrust_phase_deg": ("order", -75.0 * (orders == 3), {"units": "degree"}),
        },
        coords={"order": orders},
    )
    third = compare(Measurement(rotation, force, None, "zero"), model, 0.0).sel(order=3)
    yield "compare amplitude", bool(third["agrees"])
    yield "compare phase", abs(third["phase_difference_deg"]) <= third["phase_difference_uncertainty_deg"]


SOURCES = (
    of_indices, of_effects, of_derivatives, of_regressions, of_slopes, of_distributions, of_surrogates, of_models, of_records,
)  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Print a line for each kind of interval."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=60)
    options = parser.parse_args(arguments)
    hits: defaultdict[str, list[float]] = defaultdict(list)
    for seed in range(options.seeds):
        for source in SOURCES:
            for name, hit in source(seed):
                hits[name].append(float(hit))
    for name, each in hits.items():
        stated = np.array(each)[np.isfinite(each)]
        share = f"{100 * np.mean(stated):5.1f} %" if stated.size else "   no "
        print(
            f"{name:52} {share} of {stated.size}"
            + (f"; none for {len(each) - stated.size}" * (stated.size < len(each)))
        )


if __name__ == "__main__":
    main()
