"""How much of the work of a run its first points are, where the models of its points have different prices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tripod_doe.array_types import IntArray
from tripod_doe.study.study_points import StudyPoints

_LOOKED_AT = 10_000  # points, each of which stands for those up to the next one


def work_of(asked: StudyPoints, missing: IntArray) -> Callable[[int], float]:
    """How much work the first so many of some points are.

    Prices are those of the design, of several models at once, or recorded ones; where none are known, or all points are
    of one kind, each point counts one.

    Parameters
    ----------
    asked, missing
        The study, and the points of it that run, in this order.
    """
    names, prices = _kinds(asked), dict[tuple[Any, ...], float]()
    if not names or not missing.size:
        return float
    begins = np.unique(np.linspace(0, missing.size - 1, min(missing.size, _LOOKED_AT)).astype(np.int64))
    rows = missing[begins]
    columns = asked.points.at(rows)
    kinds = list(zip(*(columns[name].tolist() for name in names), strict=True))
    for kind in dict.fromkeys(kinds):
        price = _price(asked, int(rows[kinds.index(kind)]), kind)
        if price is None:
            return float
        prices[kind] = price
    if len(prices) < 2:
        return float
    ends = np.append(begins[1:], missing.size)
    work = np.cumsum(np.array([prices[kind] for kind in kinds]) * (ends - begins))
    return lambda count: float(np.interp(count, np.append(0, ends), np.append(0.0, work)))


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
