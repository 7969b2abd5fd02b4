"""The scale by which one scatter, or two together, must shrink to keep a limit, from the existing points.

Each point counts by how much more often it would occur if the scatter were s times as wide about its centre,
w = f(c + (x - c) / s) / (s f(x)) with the density f of the factor; of two factors by the product.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.sample import Sample
from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.distributions import scatter_density
from tripod_doe.study.definition.study_file import FactorTable

_SCALES = np.arange(0.95, 0.075, -0.05)  # tried from the widest
FEWEST = 100
"""Effective points below which a share of 1 % is not resolved."""


def scale_to_keep(sample: Sample, values: FloatArray, limit: FloatArray, keep: float) -> FloatArray:
    """The largest scale of the scatter of two factors by which a limit is kept, shape (factor, factor, component).

    The diagonal holds the scales of single factors. NaN without a limit, where it is kept already, where no scale that
    the points resolve keeps it, and for factors of listed values.

    Args:
        values: Shape (point, component).
        keep: Share of the joints that must keep the limit.
    """
    columns = [np.asarray(sample.columns[name]) for name in sample.tables]
    weights = [_weights(table, column) for table, column in zip(sample.tables.values(), columns, strict=True)]
    count, above = len(weights), (values > limit).astype(float)
    answers = np.full((count, count, limit.size), np.nan)
    wanted = np.isfinite(limit) & (above.mean(axis=0) > 1 - keep)
    if not wanted.any():
        return answers
    for first in range(count):
        for second in range(first + 1):
            both = weights[first] * (weights[second] if second != first else 1.0)
            total = both.sum(axis=1)
            with np.errstate(invalid="ignore", divide="ignore"):
                share = (both @ above[:, wanted]) / total[:, None]
                effective = total**2 / (both**2).sum(axis=1)
            kept = (share <= 1 - keep) & (effective >= FEWEST)[:, None]  # shape (scale, component)
            best = np.where(kept.any(axis=0), _SCALES[kept.argmax(axis=0)], np.nan)
            answers[first, second, wanted] = answers[second, first, wanted] = best
    return answers


def cheapest_to_keep(
    sample: Sample, values: FloatArray, limit: FloatArray, keep: float, costs: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """The cheapest scales of one scatter or two by which a limit is kept, and what they cost.

    A scale s of a scatter costs 1 / s - 1 times what it costs to halve it.

    Args:
        values: Shape (point, component).
        keep: Share of the joints that must keep the limit.
        costs: What it costs to halve each scatter; others stay as they are.

    Returns:
        scales : ndarray, shape (factor, component): 1 where a scatter stays; NaN as in `scale_to_keep`.
        cost : ndarray, shape (component,)
    """
    names, above = list(sample.tables), (values > limit).astype(float)
    scales, cost = np.full((len(names), limit.size), np.nan), np.full(limit.size, np.inf)
    wanted = np.isfinite(limit) & (above.mean(axis=0) > 1 - keep)
    sizes = np.array([1.0, *_SCALES])
    own = {
        name: np.concatenate(
            [np.ones((1, len(values))), _weights(sample.tables[name], np.asarray(sample.columns[name]))]
        )
        for name in names
        if name in costs and wanted.any()
    }
    pairs = [(first, second) for first in own for second in own if names.index(second) < names.index(first)]
    for first, second in pairs or [(name, name) for name in own]:
        for size, weights in zip(sizes.tolist(), own[first], strict=True):
            both = weights if first == second else weights * own[second]
            both = np.atleast_2d(both)
            total = both.sum(axis=1)
            with np.errstate(invalid="ignore", divide="ignore"):
                share, effective = (both @ above) / total[:, None], total**2 / (both**2).sum(axis=1)
            other = sizes if first != second else np.ones(1)
            price = costs[first] * (1 / size - 1) + costs[second] * (1 / other - 1)
            kept = (share <= 1 - keep) & (effective >= FEWEST)[:, None] & wanted
            priced = np.where(kept, price[:, None], np.inf)
            best = priced.argmin(axis=0)
            for at in np.flatnonzero(priced.min(axis=0) < cost):
                cost[at], scales[:, at] = priced[best[at], at], 1.0
                scales[names.index(first), at] = size
                if first != second:
                    scales[names.index(second), at] = other[best[at]]
    return scales, np.where(np.isfinite(cost), cost, np.nan)


def _weights(table: FactorTable, column: NDArray[np.generic]) -> FloatArray:
    """Weights of the points for all scales, shape (scale, point); NaN where the factor has no scatter."""
    scatter = scatter_density(table)
    if scatter is None:
        return np.full((_SCALES.size, column.size), np.nan)
    x = np.log(column.astype(float)) if scatter.logarithmic else column.astype(float)
    now = scatter.density(x)
    return np.stack([scatter.density(scatter.centre + (x - scatter.centre) / s) / (s * now) for s in _SCALES.tolist()])
