"""Intervals by resampling: the bootstrap for independent blocks, random halves if repeated points matter."""

from collections.abc import Iterator
from statistics import NormalDist

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.memory import refuse_too_much_memory

_DRAWN = 100_000  # blocks of every resample that are drawn together


FEWEST_DECIDING = 10
"""Blocks that make up a variance, for an interval by resampling: of fewer, those of 95 % held in 2 to 94 %."""


def bootstrap_weights(count: int, resamples: int, seed: int) -> FloatArray:
    """How often each block is drawn, over their number, shape (resample, block); SALib's draws with this seed.

    Raises:
        InputError: If they do not fit into the free memory.
    """
    needed = 2 * 8 * resamples * count  # their users add a row
    refuse_too_much_memory(needed, f"a bootstrap of {count:,} blocks or points", f"set resamples below {resamples}")
    random = np.random.default_rng(seed)
    weights = np.zeros((resamples, count))
    for start in range(0, count, _DRAWN):
        drawn = random.integers(count, size=(min(_DRAWN, count - start), resamples))
        for row, column in zip(weights, drawn.T, strict=True):
            row += np.bincount(column, minlength=count)
    weights /= count
    return weights


def deciding(squares: FloatArray) -> FloatArray:
    """How many blocks make up a sum of squares: as many equal ones would scatter as much; NaN of nothing.

    Args:
        squares: Shape (block, ...).
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(squares.sum(axis=0) ** 2 / (squares**2).sum(axis=0))


def random_halves(count: int, resamples: int, seed: int) -> Iterator[IntArray]:
    """Draw random halves of `count` points, ascending, each without repetition.

    The scatter of a statistic over halves is its standard error over all points: of a mean, 1/m - 1/n is 1/n for
    m = n/2 (delete-half jackknife, Shao and Wu 1989). Ranks and neighbours, which repeated points would spoil, stay
    what they are.
    """
    random = np.random.default_rng(seed)
    for _ in range(resamples):
        yield np.sort(random.permutation(count)[: count // 2])


def studentised_half_width(values: FloatArray, weights: FloatArray, confidence: float) -> FloatArray:
    """Half width of the interval of a mean over few blocks; NaN if the blocks are too few.

    Quantile of |mean* - mean| / s* over bootstrap resamples, times s (symmetric bootstrap t, Hall 1988): it widens for
    few and for skewed values, and is unbounded where resamples without any spread differ from the mean, as where the
    effect shows in two blocks of twenty. Student's factor over the normal one takes in that the spread of few blocks is
    not known. Values without spread say nothing of blocks to come.

    Args:
        values: Shape (block, component).
        weights: Of the bootstrap, shape (resample, block); a quantile needs a thousand resamples.
    """
    from scipy.special import stdtrit  # imported where it is used: every study would wait for it

    mean, spread = values.mean(axis=0), values.std(axis=0)
    nothing = 1e-9 * np.abs(values).max(axis=0, initial=0.0)  # rounding
    centred = values - mean
    ratios = np.empty((len(weights), values.shape[1]))
    for at in range(values.shape[1]):  # one by one: all at once are thousands of numbers for each number of the output
        drawn = weights @ np.stack([centred[:, at], centred[:, at] ** 2], axis=1)
        scatter = np.sqrt(np.maximum(drawn[:, 1] - drawn[:, 0] ** 2, 0))
        off = np.abs(drawn[:, 0])
        known = scatter > max(1e-6 * spread[at], nothing[at])
        ratios[:, at] = np.where(known, off / np.where(known, scatter, 1), np.where(off > nothing[at], np.inf, 0))
    few = float(stdtrit(len(values) - 1, 0.5 + confidence / 2)) / normal_factor(confidence)
    half = few * np.quantile(ratios, confidence, axis=0, method="higher") * spread
    return np.where((spread > nothing) & np.isfinite(half), half, np.nan)


def half_width(estimates: FloatArray, confidence: float) -> FloatArray:
    """Half width of an interval from estimates of resamples along the first axis."""
    return normal_factor(confidence) * np.asarray(estimates).std(axis=0, ddof=1)


def normal_factor(confidence: float) -> float:
    """Half width of an interval over the standard error, of a normal distribution."""
    return NormalDist().inv_cdf(0.5 + confidence / 2)
