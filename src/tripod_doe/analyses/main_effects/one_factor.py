"""Points that differ in one factor alone: what this factor does, whatever all others do.

Such points need no assumption on the response: the change between them is that of the factor, at this setting of the
others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray


def setting_of_others(codes: IntArray) -> IntArray:
    """For each factor, which points share the levels of all the others.

    Parameters
    ----------
    codes
        Number of the level, shape (point, factor).

    Returns
    -------
    numpy.ndarray
        Number of the setting of the other factors, same shape. From sums of random 64-bit keys, one per level, so
        that a million points take no sorting of rows; two settings share a sum with a probability below 1e-7.
    """
    random = np.random.default_rng(0)
    keys = np.empty(codes.shape, np.uint64)
    for factor in range(codes.shape[1]):
        words = random.integers(0, 2**64 - 1, int(codes[:, factor].max(initial=0)) + 1, np.uint64)
        keys[:, factor] = words[codes[:, factor]]
    others = keys.sum(axis=1, dtype=np.uint64)[:, None] - keys  # modulo 2^64
    settings = [np.unique(column, return_inverse=True)[1] for column in others.T]
    return np.stack(settings, axis=1).astype(np.int64)


@dataclass(frozen=True)
class Comparison:
    """A response at points that differ in one factor alone."""

    # response at every level, shape (setting of the others, level), of those settings at which there are all levels
    curves: FloatArray
    whole: IntArray  # numbers of these settings
    several: IntArray  # numbers of the settings at which there are at least two levels
    steps: FloatArray  # changes from each level to the next one that there is, over all settings, shape (pair,)
    largest: float  # largest change at one setting; 0 where no two points can be compared


def compare_settings(setting: IntArray, code: IntArray, response: FloatArray) -> Comparison:
    """Compare the points that share the setting of all other factors.

    Parameters
    ----------
    setting, code
        Setting of the other factors, and level of this one, in ascending order; shape (point,).
    response
        Finite values, shape (point,). Repeated points are averaged.
    """
    levels = int(code.max()) + 1
    cells, inverse = np.unique(setting * levels + code, return_inverse=True)
    mean = np.bincount(inverse, response) / np.bincount(inverse)
    owner, start, count = np.unique(cells // levels, return_index=True, return_counts=True)
    whole, several = count == levels, count > 1
    rows = start[whole][:, None] + np.arange(levels)
    same = np.diff(cells // levels) == 0
    spread = np.maximum.reduceat(mean, start) - np.minimum.reduceat(mean, start)
    return Comparison(
        curves=mean[rows] if levels > 1 else np.empty((0, 1)),
        whole=owner[whole & several],
        several=owner[several],
        steps=np.diff(mean)[same],
        largest=float(spread.max()),
    )
