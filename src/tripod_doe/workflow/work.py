"""How much of the work of a run its first points are, where the models of its points have different prices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.study.study_points import StudyPoints

__all__ = ["work_of"]

_CHUNK = 100_000  # points that are looked at together
_APART = 100  # points between two at which the work is kept, unless the kind changes less often


def work_of(asked: StudyPoints, missing: NDArray[np.int64]) -> Callable[[int], float]:
    """How much work the first so many of some points are.

    Prices are those of the design, of several models at once, or recorded ones; where none are known, or all points are
    of one kind, each point counts one.

    Parameters
    ----------
    asked, missing
        The study, and the points of it that run, in this order.
    """
    names, prices = _kinds(asked), dict[tuple[Any, ...], float]()
    ends: list[NDArray[np.float64]] = [np.zeros(1)]
    work: list[NDArray[np.float64]] = [np.zeros(1)]
    for start in range(0, missing.size if names else 0, _CHUNK):
        rows = missing[start : start + _CHUNK]
        columns = asked.points.at(rows)
        kinds = list(zip(*(columns[name].tolist() for name in names), strict=True))
        for kind in set(kinds) - prices.keys():
            price = _price(asked, int(rows[kinds.index(kind)]), kind)
            if price is None:
                return float
            prices[kind] = price
        each = np.fromiter(map(prices.__getitem__, kinds), float, len(kinds))
        sums, at = work[-1][-1] + np.cumsum(each), np.flatnonzero(np.diff(each, append=np.nan))
        if at.size * _APART > rows.size:  # kinds alternate
            at = np.append(np.arange(_APART, rows.size, _APART), rows.size) - 1
        ends.append(start + 1.0 + at)
        work.append(sums[at])
    if len(prices) < 2:
        return float
    all_ends, all_work = np.concatenate(ends), np.concatenate(work)
    return lambda count: float(np.interp(count, all_ends, all_work))


def _kinds(asked: StudyPoints) -> list[str]:
    """Names of what tells points of one kind from others: the fidelity, else all words."""
    if asked.study.file.design.kind == "multifidelity":
        return [asked.study.file.design.fidelity]
    first = asked.points.at(slice(0, 1))
    return [name for name, column in first.items() if column.dtype == object]


def _price(asked: StudyPoints, row: int, kind: tuple[Any, ...]) -> float | None:
    """What a point of a kind costs, as far as that is known."""
    study = asked.study
    given = study.file.design.prices.get(str(kind[0])) if study.file.design.kind == "multifidelity" else None
    return given or study.simulator.recorded_price({**study.base, **asked.points.settings_of(row)})
