"""Intervals by resampling: the bootstrap for blocks that stand alone, random halves where repeated points count."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

__all__ = ["bootstrap_weights", "half_width", "part_half_width", "part_weights", "random_halves"]

FloatArray = NDArray[np.float64]


def bootstrap_weights(count: int, resamples: int, seed: int) -> FloatArray:
    """How often each block is drawn, over their number, shape (resample, block); SALib's draws with this seed."""
    drawn = np.random.default_rng(seed).integers(count, size=(count, resamples))
    weights = np.zeros((resamples, count))
    for row, column in zip(weights, drawn.T, strict=True):
        row[:] = np.bincount(column, minlength=count)
    return weights / count


def part_weights(part: NDArray[np.int64]) -> FloatArray:
    """How much each block counts in the estimate of each independent part, shape (part, block)."""
    inside = part == np.unique(part)[:, None]
    weights: FloatArray = inside / inside.sum(axis=1, keepdims=True)
    return weights


def part_half_width(estimates: FloatArray, confidence: float) -> FloatArray:
    """Half width of the interval of a mean from the estimates of independent parts along the first axis."""
    from scipy.special import stdtrit  # slow to import: every study would wait for it

    count = len(estimates)
    width: FloatArray = stdtrit(count - 1, 0.5 + confidence / 2) * estimates.std(axis=0, ddof=1) / np.sqrt(count)
    return width


def random_halves(count: int, resamples: int, seed: int) -> list[NDArray[np.int64]]:
    """Random halves of `count` points, ascending, each without repetition.

    The scatter of a statistic over halves is its standard error over all points: of a mean, 1/m - 1/n is 1/n for
    m = n/2 (delete-half jackknife, Shao and Wu 1989). Ranks and neighbours, which repeated points would spoil, stay
    what they are.
    """
    random = np.random.default_rng(seed)
    return [np.sort(random.permutation(count)[: count // 2]) for _ in range(resamples)]


def half_width(estimates: FloatArray, confidence: float) -> FloatArray:
    """Half width of an interval from estimates of resamples along the first axis."""
    width: FloatArray = NormalDist().inv_cdf(0.5 + confidence / 2) * np.asarray(estimates).std(axis=0, ddof=1)
    return width
