"""Which candidates of a search are judged once more, by a better model or with another sample."""

import numpy as np

from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.analyses.optimisation.pareto_front import Archive, apart, front_rows, scaled
from tripod_doe.analyses.optimisation.search import leading
from tripod_doe.array_types import FloatArray, IntArray

_REFERENCE = 2.0  # of hypervolumes, where a front is from 0 to 1: far enough for its ends to count as its middle does
_LEAST = 1.001  # times the hypervolume: less is as good as the joint next to it


def confirmation_batches(confirmed: int, objectives: int) -> list[int]:
    """Numbers of candidates that are judged once more, one batch after the other: each learns from those before.

    The first ones of a single objective only teach; of several, they are on the front if its limits hold. One at least
    is left for what the search finds with what they teach.
    """
    first, each = max(confirmed // 3, 2 if objectives > 1 else 4), max(confirmed // 6, 1)
    first = min(first, max(confirmed - 1, 1))
    rest = confirmed - first
    return [first, *(min(each, rest - done) for done in range(0, rest, each))]


def first_confirmed(archive: Archive, signs: FloatArray, count: int, by_better: bool) -> IntArray:
    """Candidates that promise most; of a single objective that a better model judges, leading ones far apart.

    Args:
        signs: 1 for an objective to minimise, -1 for one to maximise.
        by_better: Whether a better model judges them.
    """
    some = archive.judged.feasible.any()
    if not by_better or (some and signs.size > 1):
        none = np.empty(0, int)
        return next_confirmed(archive.judged, signs, none, count) if some else none
    aims = archive.judged.objectives * signs
    rows = leading(aims, archive.judged, max(len(aims) // 4, count))
    return rows[apart(archive.units[rows], count)]


def next_confirmed(better: Judged, signs: FloatArray, chosen: IntArray, count: int) -> IntArray:
    """The most promising candidates that are not confirmed yet; none if none is promising.

    If no candidate is feasible after a correction, the candidates closest to feasible.

    Args:
        better: All candidates, as corrected; those in `chosen` as they were judged once more.
        signs: 1 for an objective to minimise, -1 for one to maximise.
    """
    aims = better.objectives * signs
    if not better.feasible.any():
        far = np.maximum(better.violations, 0).sum(axis=1)
        far[chosen] = np.inf
        near = np.flatnonzero(np.isfinite(far) & np.isfinite(aims).all(axis=1))
        return np.asarray(near[np.argsort(far[near], kind="stable")][:count])
    if signs.size == 1:
        values = np.where(better.feasible, aims[:, 0], np.inf)
        best = values[chosen].min(initial=np.inf)
        values[chosen] = np.inf
        able = np.flatnonzero(np.isfinite(values) & (values < best))
        return np.asarray(able[np.argsort(values[able], kind="stable")][:count])
    rows = front_rows(aims, better.feasible)
    places, new = scaled(aims[rows]), ~np.isin(rows, chosen)
    return rows[new][largest_gains(places[~new], places[new], count)]


def largest_gains(known: FloatArray, new: FloatArray, count: int) -> IntArray:
    """The points that enlarge the hypervolume of known ones most, one after the other; none that hardly does.

    Args:
        known: Aims from 0 to 1, shape (point, aim).
        new: The points to choose from, likewise.
    """
    from moocore import hypervolume

    reference = np.full(new.shape[1], _REFERENCE)
    front, chosen = known, list[int]()
    for _ in range(min(count, len(new))):
        volumes = np.array([hypervolume(np.vstack([front, point]), ref=reference) for point in new])
        best = int(volumes.argmax())
        if len(front) and volumes[best] <= _LEAST * hypervolume(front, ref=reference):
            break
        chosen.append(best)
        front = np.vstack([front, new[best]])
    return np.array(chosen, int)
