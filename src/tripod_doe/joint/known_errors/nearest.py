"""Nearest neighbours among recorded places."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray

ALIKE = 10
"""Number of recorded points that each point is compared with."""

_FEW = 500
"""Up to this number of places, all distances (30 us a place) cost less than SciPy's tree (8 us, import 0.3 s)."""
_MORE = 4
"""Additional neighbours, to order equally near ones by their rows."""


def nearest_rows(known: FloatArray, places: FloatArray, count: int) -> IntArray:
    """Find the known places nearest to each place; of equally near ones take the first rows.

    Identical known places are common: their points differ in parameters that affect no coordinate.

    Args:
        known, places: Shapes (known, coordinate) and (place, coordinate).
        count: Number of neighbours; all known places if there are fewer.

    Returns:
        shape (place, count): Their rows, the nearest first.
    """
    if len(places) <= _FEW or len(known) <= count + _MORE:
        return _nearest_of(known, places, count)
    from scipy.spatial import cKDTree

    candidates = np.sort(cKDTree(known).query(places, k=count + _MORE)[1], axis=1)
    apart = np.square(places[:, None] - known[candidates]).sum(axis=2)
    order = np.argsort(apart, axis=1, kind="stable")
    rows = np.take_along_axis(candidates, order[:, :count], axis=1)
    farthest = np.take_along_axis(apart, order[:, [count - 1, -1]], axis=1)
    undecided = farthest[:, 0] == farthest[:, 1]  # more places are equally near than the tree returned
    rows[undecided] = _nearest_of(known, places[undecided], count)
    return np.asarray(rows, np.int64)


def _nearest_of(known: FloatArray, places: FloatArray, count: int) -> IntArray:
    """Compare all distances."""
    apart = np.square(places[:, None] - known).sum(axis=2)
    return np.argsort(apart, axis=1, kind="stable")[:, :count]
