"""The split of a multifidelity study: how many samples each model gets, from a pilot in which all models ran.

Peherstorfer, Willcox and Gunzburger (2016): with prices w and correlations rho of the models with the truth, in falling
order, model k gets r_k = sqrt(w_1 (rho_k^2 - rho_k+1^2) / (w_k (1 - rho_2^2))) times the samples of the truth. Models
that do not pay are left out; the combination with the smallest variance at equal price is taken.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import xarray as xr

from tripod_doe.analyses.multifidelity.estimates import moments, statistics
from tripod_doe.analyses.multifidelity.multifidelity import outputs_of_all
from tripod_doe.analyses.multifidelity.nested_samples import Ladder, Rung, price_of_point, read_ladder
from tripod_doe.analyses.output_table import OutputTable, read_outputs
from tripod_doe.analyses.settings import PointSettings
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Simulator
from tripod_doe.study.designs import most_samples, pilot_samples

_LEAST_UNEXPLAINED = 1e-3
"""Part of the variance that is taken to be unexplained at least: a pilot cannot show less, and the samples of a cheap
model would grow without bound."""


@dataclass(frozen=True)
class Split:
    """Samples of each model, and the expected gain."""

    samples: Mapping[str, int]  # samples of each model, the truth first
    prices: Mapping[str, float]  # CPU seconds of a point with each model
    explained: Mapping[str, float]  # part of the truth's variance that each model explains, averaged over the targets
    pilot: int  # samples that all models ran
    block: int  # points of a sample
    gain: float  # variance of the truth alone at the same price, relative to the split, averaged over the targets
    seconds: float  # CPU time of all samples
    variance: float  # expected variance of a mean, over the variance of the output


def find_split(pilot: xr.Dataset, simulator: Simulator) -> Split:
    """The split that makes the variance small for its price.

    Args:
        pilot: Cube with costs of a multifidelity study in which all models ran the pilot's samples.
        simulator: What ran; it may know the price of counted work.

    Raises:
        InputError: If a target is no output of all models, or too little of the pilot finished.
    """
    settings = PointSettings(most_dropped=0.5)  # the rest still gives prices and correlations
    names = outputs_of_all(pilot, [])
    ladder = read_ladder(pilot, settings, names)
    rungs = (ladder.truth, *ladder.aside)
    tables = list(read_outputs(pilot, names, np.arange(pilot.sizes["point"])))
    explained = dict(zip((rung.model for rung in rungs), _explained(ladder, rungs, tables), strict=True))
    prices = {
        rung.model: price_of_point(pilot, simulator.candidates, ladder.design, rung.model, rung.rows.ravel())
        for rung in rungs
    }
    truth, asked, ran = ladder.truth.model, int(ladder.design.samples or 0), pilot_samples(ladder.design)
    chain = _best_chain(truth, prices, explained)
    ratios = _ratios(chain, prices, explained)
    samples = {model: max(ran, math.ceil(asked * ratios.get(model, 0.0))) for model in prices}
    samples[truth] = asked
    samples = within(samples, ran, most_samples(ladder.design, len(samples), ladder.block))
    seconds = ladder.block * sum(samples[model] * prices[model] for model in samples)
    variance = _variance(chain, samples, explained)
    alone = ladder.block * prices[truth] / seconds
    return Split(samples, prices, explained, ran, ladder.block, alone / variance, seconds, variance)


def within(samples: Mapping[str, int], least: int, most: int) -> dict[str, int]:
    """Samples of each model, the truth first; too many in all reduce the samples of cheap models by one factor.

    Args:
        samples: What is wanted.
    """
    truth, *cheap = samples
    if sum(samples.values()) <= most:
        return dict(samples)
    left = max(most - samples[truth] - len(cheap) * least, 0)
    wanted = sum(samples[model] for model in cheap)
    return {truth: samples[truth]} | {model: max(least, samples[model] * left // wanted) for model in cheap}


def _explained(ladder: Ladder, rungs: tuple[Rung, ...], tables: list[OutputTable]) -> list[float]:
    """Part of the variance of the truth's samples that each model explains, averaged over targets and statistics."""
    known = [key for table in tables for key in table.keys]
    for key in ladder.design.target:
        if key not in known:
            raise InputError(f"[design]: target: {key!r} is no output of all models{near_match(key, known)}")
    explained = []
    for key in ladder.design.target or [table.name for table in tables]:
        for table in tables:
            parts = [_statistics(ladder, rungs, table, int(at)) for at in np.flatnonzero(table.named(key))]
            if parts:
                explained += _explained_parts(np.stack(parts))
    if not explained:
        raise InputError("no target varies in the pilot, so no split follows from it")
    return [float(each) for each in np.mean(explained, axis=0)]


def _statistics(ladder: Ladder, rungs: tuple[Rung, ...], table: OutputTable, at: int) -> FloatArray:
    """What the split is made for: the value, and with indices the total effects; shape (model, statistic, sample)."""
    values = [table.values[rung.rows, at] for rung in rungs]
    parts = np.stack([statistics(moments(each - each.mean()), 0.0) for each in values])
    factors = (parts.shape[1] - 2) // 2
    return parts[:, :1] if not factors else np.stack([parts[:, 0], parts[:, 2 + factors :].sum(axis=1)], axis=1)


def _explained_parts(parts: FloatArray) -> list[FloatArray]:
    """For each statistic that varies, the part that each model explains, of (component, model, statistic, sample).

    Adjusted for the number of samples, which would show some correlation by chance.
    """
    centred = parts - parts.mean(axis=-1, keepdims=True)
    power = (centred**2).mean(axis=-1)
    both = (centred * centred[:, :1]).mean(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        square = np.nan_to_num(both**2 / (power * power[:, :1]))
    weight, count = power[:, 0], parts.shape[-1]
    explained = []
    for at in np.flatnonzero(weight.sum(axis=0) > 0):
        whole = (weight[:, at] @ square[..., at]) / weight[:, at].sum()
        explained.append(np.clip(1 - (1 - whole) * (count - 1) / (count - 2), 0, 1 - _LEAST_UNEXPLAINED))
    return explained


def _chains(truth: str, prices: Mapping[str, float], explained: Mapping[str, float]) -> Iterator[list[str]]:
    """The truth and cheaper models by falling explained variance, whose share per cost grows from each to the next."""
    others = sorted((model for model in prices if model != truth), key=lambda model: -explained[model])
    for length in range(len(others) + 1):
        for chosen in combinations(others, length):
            chain = [truth, *chosen]
            parts, costs = _steps(chain, explained), [prices[model] for model in chain]
            worth = [part / cost for part, cost in zip(parts, costs, strict=True)]
            if all(first < second for first, second in pairwise(worth)):
                yield chain


def _steps(chain: list[str], explained: Mapping[str, float]) -> list[float]:
    """Variance that each model explains beyond the next one; of the truth, the rest of the best cheaper one."""
    parts = [1.0, *(explained[model] for model in chain[1:]), 0.0]
    return [first - second for first, second in pairwise(parts)]


def _best_chain(truth: str, prices: Mapping[str, float], explained: Mapping[str, float]) -> list[str]:
    """The chain with the smallest variance at equal price, (sum sqrt(w_k (rho_k^2 - rho_k+1^2)))^2 / w_1."""

    def root(chain: list[str]) -> float:
        steps = zip(chain, _steps(chain, explained), strict=True)
        return sum(math.sqrt(prices[model] * max(step, 0.0)) for model, step in steps)

    return min(_chains(truth, prices, explained), key=root)


def _ratios(chain: list[str], prices: Mapping[str, float], explained: Mapping[str, float]) -> dict[str, float]:
    """Samples of each model of a chain over those of the truth."""
    steps, truth = _steps(chain, explained), prices[chain[0]]
    return {
        model: math.sqrt(truth * step / (prices[model] * steps[0])) for model, step in zip(chain, steps, strict=True)
    }


def _variance(chain: list[str], samples: Mapping[str, int], explained: Mapping[str, float]) -> float:
    """Variance of a mean over the variance of the output."""
    return sum(step / samples[model] for model, step in zip(chain, _steps(chain, explained), strict=True))
