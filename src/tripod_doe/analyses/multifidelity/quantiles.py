"""Multifidelity quantiles of the truth: its distribution function by control variates, inverted with its interval.

The control variate of "the truth is at most t" is "the truth as a cheaper model predicts it is at most t". Predictions
are straight lines through the truth's samples; as in `estimates`, each fold gets lines and coefficients from others.
The interval holds all t at which the distribution function may equal the probability (Woodruff 1952).
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.multifidelity.estimates import folds_of, shares_of
from tripod_doe.array_types import FloatArray

_LEVELS = 400  # places at which the distribution function is evaluated
_MOST_NUMBERS = 4_000_000  # of the truth's points times places at once
_ADDED = 2  # points that are taken to disagree besides those that do, of four more (Agresti and Coull 1998)


def quantiles(values: list[FloatArray], probabilities: list[float], normal: float) -> FloatArray:
    """Quantiles of one component with their intervals, shape (3, probability): value, low end, high end.

    Args:
        values: Of the truth and of each cheaper model, shape (sample, point); the points of a sample are independent.
            Every model has the samples of those before it.
        normal: Standard errors that half an interval has. An end is NaN where the samples do not bound the quantile.
    """
    at = _support(values)
    chance, error = _distribution(values, at)
    wanted = np.asarray(probabilities)[:, None]
    above, below = chance + normal * error >= wanted, chance - normal * error <= wanted
    low = np.where(above[:, 0], np.nan, at[above.argmax(axis=1)])
    first = at.size - below[:, ::-1].argmax(axis=1)  # the first of all higher places that are surely above
    high = np.where(below[:, -1], np.nan, at[np.minimum(first, at.size - 1)])
    rising = np.sort(np.clip(chance, 0, 1))  # rearranged: differences of estimates need not be monotonic
    middle = np.interp(probabilities, *_strictly(rising, at))
    return np.stack([np.fmin(np.fmax(middle, low), high), low, high])


def _strictly(rising: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The steps of a distribution function, each at its middle."""
    level, first, repeats = np.unique(rising, return_index=True, return_counts=True)
    return level, (at[first] + at[first + repeats - 1]) / 2


def _lines(truth: FloatArray, cheap: FloatArray) -> tuple[float, float]:
    """Slope and offset of the straight line from a cheaper model to the truth."""
    spread = float(cheap.var())
    slope = float(((truth - truth.mean()) * (cheap - cheap.mean())).mean()) / spread if spread > 0 else 0.0
    return slope, float(truth.mean()) - slope * float(cheap.mean())


def _support(values: list[FloatArray]) -> FloatArray:
    """Values over the whole range of the truth and of its predictions, where most of them are."""
    truth = values[0]
    seen = [truth.ravel()]
    for cheap in values[1:]:
        slope, offset = _lines(truth, cheap[: len(truth)])
        seen.append((offset + slope * cheap).ravel())
    largest = np.concatenate([seen[0], seen[-1]])
    tails = np.geomspace(1e-4, 0.1, 40)
    levels = np.unique(np.concatenate([[0, 1], tails, 1 - tails, np.linspace(0.1, 0.9, _LEVELS - 80)]))
    return np.unique(np.concatenate([seen[0], np.quantile(largest, levels)]))


def _at_most(values: FloatArray, at: FloatArray) -> FloatArray:
    """Share of the points that are at most as large, shape (place,)."""
    return np.searchsorted(np.sort(values.ravel()), at, side="right") / values.size


def _distribution(values: list[FloatArray], at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distribution function of the truth and its standard error, shape (place,)."""
    counts = [len(each) for each in values]
    ends, shares, fold = [0, *counts], shares_of(counts), folds_of(counts[0])
    chance, own_variance, coefficients = np.zeros(at.size), np.zeros(at.size), np.zeros((len(values), at.size))
    lines = {
        (number, k): _lines(values[0][fold != number], cheap[: counts[0]][fold != number])
        for number in range(fold.max() + 1)
        for k, cheap in enumerate(values[1:], 1)
    }
    beside = {
        (number, k): [
            _at_most(offset + slope * values[k][start:stop], at)
            for start, stop in pairwise(ends[1:])
            if stop <= counts[k]
        ]
        for (number, k), (slope, offset) in lines.items()
    }
    most = max(_MOST_NUMBERS // values[0].size, 1)
    for start in range(0, at.size, most):
        part = slice(start, start + most)
        means = {key: [mean[part] for mean in own] for key, own in beside.items()}
        chance[part], own_variance[part], coefficients[:, part] = _of_truth(values, at[part], lines, means)
    return chance, np.sqrt(own_variance + _variance_of_others(values, coefficients, shares, at))


def _of_truth(
    values: list[FloatArray],
    at: FloatArray,
    lines: Mapping[tuple[int, int], tuple[float, float]],
    beside: Mapping[tuple[int, int], list[FloatArray]],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distribution function at some places, its variance over the truth's samples, and the mean coefficients.

    Args:
        values: As in `quantiles`.
        lines: Slope and offset from each cheaper model to the truth, by fold and model.
        beside: Shares of the predictions that are at most as large, in each stratum of samples that the truth lacks.
    """
    counts = [len(each) for each in values]
    shares, fold, truth = shares_of(counts), folds_of(counts[0]), values[0]
    below = truth[..., None] <= at  # (sample, point, place)
    chance, residual = np.zeros(at.size), below.astype(float)
    coefficients = np.zeros((len(values), at.size))
    for number in range(fold.max() + 1):
        own, rest = fold == number, fold != number
        part = below[own].mean(axis=(0, 1))
        for k, cheap in enumerate(values[1:], 1):
            slope, offset = lines[number, k]
            guess = (offset + slope * cheap[: counts[0]])[..., None] <= at
            coefficient = _coefficient(below[rest], guess[rest])
            means = [guess[own].mean(axis=(0, 1)), *beside[number, k]]
            part = part + coefficient * sum(share * mean for share, mean in zip(shares[k], means, strict=False))
            residual[own] += coefficient * shares[k, 0] * guess[own]
            coefficients[k] += coefficient * own.mean()
        chance += part * own.mean()
    return chance, _variance_of_truth(residual, below), coefficients


def _coefficient(truth: NDArray[np.bool_], guess: NDArray[np.bool_]) -> FloatArray:
    """Control-variate coefficient at each place, 0 if all predictions are equal."""
    both, one, other = (truth & guess).mean(axis=(0, 1)), truth.mean(axis=(0, 1)), guess.mean(axis=(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        coefficients: FloatArray = np.where(
            (other > 0) & (other < 1), (both - one * other) / (other * (1 - other)), 0.0
        )
    return coefficients


def _variance_of_truth(residual: FloatArray, below: NDArray[np.bool_]) -> FloatArray:
    """Variance of the mean over the truth's samples, never less than a few more points could show.

    Where no prediction was wrong, the points do not show how often one is; two of four further ones are assumed to be.
    """
    count = residual.shape[0] * residual.shape[1]
    scatter = residual.mean(axis=1).var(axis=0, ddof=1) / residual.shape[0]
    centred = residual - residual.mean(axis=(0, 1))
    wrong = (np.abs(centred) > 0.5).sum(axis=(0, 1))
    share = (wrong + _ADDED) / (count + 2 * _ADDED)
    return np.maximum(scatter, share * (1 - share) / count)


def _variance_of_others(
    values: list[FloatArray], coefficients: FloatArray, shares: FloatArray, at: FloatArray
) -> FloatArray:
    """Variance of the means over the samples that only cheaper models have; each stratum is independent."""
    counts = [len(each) for each in values]
    ends = [0, *counts]
    whole = np.zeros(at.size)
    lines = [_lines(values[0], each[: counts[0]]) for each in values]
    for stratum in range(1, len(values)):
        start, stop = ends[stratum], ends[stratum + 1]
        models = range(stratum, len(values))
        guess = {k: (lines[k][1] + lines[k][0] * values[k][start:stop]).ravel() for k in models}
        if stop == start:
            continue
        mean = {k: _at_most(guess[k], at) for k in models}
        variance = np.zeros(at.size)
        for k in models:
            for other in models:
                both = _at_most(np.maximum(guess[k], guess[other]), at)
                weight = coefficients[k] * shares[k, stratum] * coefficients[other] * shares[other, stratum]
                variance += weight * (both - mean[k] * mean[other])
        whole += np.maximum(variance, 0) / guess[stratum].size
    return whole
