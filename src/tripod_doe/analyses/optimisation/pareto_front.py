"""The front: candidates than which none is better in every objective, its ends and its knee."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.array_types import FloatArray, IntArray


@dataclass(frozen=True)
class Archive:
    """Candidates that were judged."""

    units: FloatArray  # on the unit cube, shape (candidate, variable)
    judged: Judged
    generation: IntArray  # in which each was tried, shape (candidate,)

    def take(self, rows: IntArray) -> Archive:
        """Some of them."""
        return Archive(self.units[rows], self.judged.take(rows), self.generation[rows])


def front_rows(aims: FloatArray, feasible: NDArray[np.bool_]) -> IntArray:
    """The feasible candidates that no other one dominates, ascending in the first aim; of equal ones the first.

    Args:
        aims: Objectives to minimise, shape (candidate, objective).
        feasible: Shape (candidate,).
    """
    rows = np.flatnonzero(feasible & np.isfinite(aims).all(axis=1))
    if not rows.size:
        return rows
    _, first = np.unique(aims[rows], axis=0, return_index=True)
    rows = rows[np.sort(first)]
    if aims.shape[1] == 1:
        return rows[[int(np.argmin(aims[rows, 0]))]]
    from moocore import is_nondominated

    rows = rows[is_nondominated(np.ascontiguousarray(aims[rows]))]
    return np.asarray(rows[np.lexsort(aims[rows].T[::-1])])


def scaled(aims: FloatArray) -> FloatArray:
    """Aims from 0 to 1 over some candidates."""
    low, high = aims.min(axis=0), aims.max(axis=0)
    return np.asarray((aims - low) / np.where(high > low, high - low, 1.0))


def knee(aims: FloatArray) -> int:
    """The candidate of a front whose worst aim is best, each from 0 to 1 over the front; of equal ones the first.

    The nearest to the best of all aims would be an end where the front bends the other way.
    """
    return int(np.argmin(scaled(aims).max(axis=1)))


def apart(places: FloatArray, count: int, first: Sequence[int] = (0,)) -> IntArray:
    """Some points far apart from each other, shape (point,): the first ones, then always the farthest from all before.

    Args:
        places: Shape (point, dimension).
    """
    chosen = list(first)[: min(count, len(places))]
    while len(chosen) < min(count, len(places)):
        distance = np.min([((places - places[k]) ** 2).sum(axis=1) for k in chosen], axis=0)
        if distance.max() == 0:
            break
        chosen.append(int(np.argmax(distance)))
    return np.array(chosen, int)


def places_of(aims: FloatArray, names: Sequence[str]) -> dict[str, int]:
    """The ends of a front and, of several objectives, its knee: what each is called, and its row; one where it has one.

    Args:
        aims: Objectives to minimise, shape (candidate, objective).
        names: Names of the objectives.
    """
    if len(aims) == 1:
        return {"best": 0}
    places = {f"best {name}": int(aims[:, at].argmin()) for at, name in enumerate(names)}
    return places | ({"knee": knee(aims)} if aims.shape[1] > 1 else {})
