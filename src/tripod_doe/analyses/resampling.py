"""Intervals by resampling: the bootstrap for blocks that stand alone, random halves where repeated points count."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.memory import refuse_too_much_memory

_DRAWN = 100_000  # blocks of every resample that are drawn together


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
            np.add.at(row, column, 1)
    weights /= count
    return weights


def random_halves(count: int, resamples: int, seed: int) -> list[IntArray]:
    """Random halves of `count` points, ascending, each without repetition.

    The scatter of a statistic over halves is its standard error over all points: of a mean, 1/m - 1/n is 1/n for
    m = n/2 (delete-half jackknife, Shao and Wu 1989). Ranks and neighbours, which repeated points would spoil, stay
    what they are.
    """
    random = np.random.default_rng(seed)
    return [np.sort(random.permutation(count)[: count // 2]) for _ in range(resamples)]


def half_width(estimates: FloatArray, confidence: float) -> FloatArray:
    """Half width of an interval from estimates of resamples along the first axis."""
    return NormalDist().inv_cdf(0.5 + confidence / 2) * np.asarray(estimates).std(axis=0, ddof=1)
