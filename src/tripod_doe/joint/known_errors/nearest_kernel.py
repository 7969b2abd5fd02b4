"""The known places that are nearest to many others, compiled.

The others are parted into runs that lie close together. A known place that is farther from all of a run than enough
others are is near none of it, and is left out there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.mechanics.compilation.kernels import inner_kernel, kernel

_RUN, _MOST_RUNS = 64, 1024
"""Places of a run, about, and number of runs."""


def nearest_places(known: FloatArray, places: FloatArray, count: int) -> IntArray:
    """As `nearest.nearest_rows`."""
    found, cells = np.zeros((len(places), count), np.int64), _cells(places)
    order = np.argsort(cells, kind="stable")
    begins = np.concatenate([[0], np.flatnonzero(np.diff(cells[order])) + 1, [len(places)]])
    _find(np.ascontiguousarray(known.T), places, order, begins, found)
    return found


def _cells(places: FloatArray) -> NDArray[np.uint16]:
    """The cell of each place in a grid over all of them, whose axes are divided where they are widest."""
    along_axes = np.ascontiguousarray(places.T)
    low = along_axes.min(axis=1)
    width, parts = along_axes.max(axis=1) - low, np.ones(places.shape[1], np.int64)
    while 2 * parts.prod() <= min(len(places) // _RUN, _MOST_RUNS):
        parts[np.argmax(width / parts)] *= 2
    cells = np.zeros(len(places), np.int64)
    for axis in np.flatnonzero((parts > 1) & (width > 0)):
        along = (along_axes[axis] - low[axis]) / width[axis] * parts[axis]
        cells = cells * parts[axis] + np.minimum(along.astype(np.int64), parts[axis] - 1)
    return cells.astype(np.uint16)


@kernel
def _find(known: Any, places: Any, order: Any, begins: Any, found: Any) -> None:
    """For each run all distances to what may be near it, in a loop that is vectorised; then the nearest."""
    width, size = known.shape
    chosen, near, apart = np.empty(size, np.int64), np.empty((width, size)), np.empty(size)
    least = np.empty(found.shape[1])
    for run in range(len(begins) - 1):
        own = order[begins[run] : begins[run + 1]]
        kept = _near_run(known, places, own, least, chosen)
        for axis in range(width):
            for each in range(kept):
                near[axis, each] = known[axis, chosen[each]]
        for row in own:
            apart[:kept] = 0.0
            for axis in range(width):
                for each in range(kept):
                    along = near[axis, each] - places[row, axis]
                    apart[each] += along * along
            least[:] = np.inf
            for each in range(kept):
                if apart[each] < least[-1]:
                    _insert(apart[each], chosen[each], least, found[row])


@inner_kernel
def _near_run(known: Any, places: Any, own: Any, least: Any, chosen: Any) -> int:
    """How many known places may be near some of a run; their rows are the first of `chosen`, ascending.

    A place in the run's box has a distance between those to the nearest and the farthest point of the box, also after
    rounding: every step of the sums is monotonic.
    """
    width, size = known.shape
    closest, farthest, rows = np.zeros(size), np.zeros(size), np.empty(least.size, np.int64)
    for axis in range(width):
        low, high = np.inf, -np.inf
        for row in own:
            low, high = min(low, places[row, axis]), max(high, places[row, axis])
        for each in range(size):
            below, above = low - known[axis, each], known[axis, each] - high
            outside, across = max(below, above, 0.0), min(below, above)
            closest[each] += outside * outside
            farthest[each] += across * across
    least[:] = np.inf
    for each in range(size):
        if farthest[each] < least[-1]:
            _insert(farthest[each], each, least, rows)
    kept = 0
    for each in range(size):
        if closest[each] <= least[-1]:
            chosen[kept] = each
            kept += 1
    return kept


@inner_kernel
def _insert(distance: float, row: int, least: Any, rows: Any) -> None:
    """Put a row among those with the least distances, which are ascending, behind equal ones."""
    at = least.size - 1
    while at > 0 and distance < least[at - 1]:
        least[at], rows[at] = least[at - 1], rows[at - 1]
        at -= 1
    least[at], rows[at] = distance, row
