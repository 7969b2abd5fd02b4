"""The known places that are nearest to many others, compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.mechanics.compilation import kernel

__all__ = ["nearest_places"]

FloatArray = NDArray[np.float64]


def nearest_places(known: FloatArray, places: FloatArray, count: int) -> NDArray[np.int64]:
    """As `nearest.nearest_rows`."""
    found = np.empty((len(places), count), np.int64)
    _find(np.ascontiguousarray(known.T), places, found)
    return found


@kernel
def _find(known: Any, places: Any, found: Any) -> None:
    """All distances to a place, in a loop that is vectorised; then the nearest by insertion."""
    width, size = known.shape
    count = found.shape[1]
    apart, nearest = np.empty(size), np.empty(count)
    for row in range(len(places)):
        apart[:] = 0.0
        for axis in range(width):
            for each in range(size):
                along = known[axis, each] - places[row, axis]
                apart[each] += along * along
        nearest[:] = np.inf
        for each in range(size):
            if apart[each] >= nearest[count - 1]:
                continue
            at = count - 1
            while at > 0 and apart[each] < nearest[at - 1]:
                nearest[at], found[row, at] = nearest[at - 1], found[row, at - 1]
                at -= 1
            nearest[at], found[row, at] = apart[each], each
