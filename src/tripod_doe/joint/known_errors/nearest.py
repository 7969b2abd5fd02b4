"""The known places that are nearest to others."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray

ALIKE = 10
"""Recorded points that a point is compared with."""

_FEW = 500
"""Places for which no compilation is worth its time."""


def nearest_rows(known: FloatArray, places: FloatArray, count: int) -> IntArray:
    """The known places nearest to some others, of equally near ones the first.

    Known places that are the same to the last bit are common: their points differ in what no coordinate depends on.

    Parameters
    ----------
    known, places
        Shapes (known, coordinate) and (place, coordinate).
    count
        How many of the known ones, or all if there are fewer.

    Returns
    -------
    ndarray, shape (place, count)
        Their rows, the nearest first.
    """
    if len(places) <= _FEW:
        apart = np.square(places[:, None] - known).sum(axis=2)
        return np.argsort(apart, axis=1, kind="stable")[:, :count]
    from tripod_doe.joint.known_errors.nearest_kernel import nearest_places  # compiles

    return nearest_places(known, places, min(count, len(known)))
