"""Progress of a run: a bar on a terminal, sparse lines in a log; the time left follows from recorded prices."""

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import numpy as np
from tqdm import tqdm

from tripod_doe.array_types import IntArray
from tripod_doe.number_text import count_of, duration
from tripod_doe.study.study_points import StudyPoints

_BAR = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}, {rate_fmt}{postfix}]"  # tqdm's own without its time left
_FIRST_LINE = 30.0  # seconds after which a log gets a first line; shorter runs print only their end
_LONGEST_GAP = 600.0  # seconds between two lines, to which the gaps grow
_PRICED = 10_000  # points with a computed price; each stands for the points up to the next one


class Progress:
    """Points that are done, printed on standard error.

    On a terminal and in a notebook a bar is drawn. A log gets a line after half a minute, and then whenever the time
    since the start has doubled, at least every ten minutes: a run of a day takes some 150 lines.

    Args:
        shown: Whether anything is printed at all.
        work: Work of the first n points, in any unit; the time left is estimated from it.
    """

    def __init__(self, total: int, shown: bool, work: Callable[[int], float] = float) -> None:
        self._total, self._done, self._at_first, self._work = total, 0, 0, work
        ipython: Any = sys.modules.get("IPython")  # a notebook has imported it
        is_notebook = ipython is not None and hasattr(ipython.get_ipython(), "kernel")
        disable = not shown or (False if is_notebook else None)  # None: only on a terminal
        self._bar = tqdm(total=total, unit="point", disable=disable, file=sys.stderr, smoothing=0.05, bar_format=_BAR)
        self._logged = shown and bool(self._bar.disable)
        self._started = self._first = time.monotonic()
        self._next_line = _FIRST_LINE

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.close()

    def add(self, points: int) -> None:
        """Count points that are done."""
        now = time.monotonic()
        if not self._done:
            self._first, self._at_first = now, points
        self._done += points
        self._bar.set_postfix_str(self._left(now).removeprefix(", "), refresh=False)
        self._bar.update(points)
        passed = now - self._started
        if self._logged and passed >= self._next_line and self._done < self._total:
            share = f"{100 * self._done / self._total:.0f} %"
            print(
                f"{self._done:,} of {count_of(self._total, 'point')} ({share}) after {duration(passed)}"
                f"{self._left(now)}",
                file=sys.stderr,
                flush=True,
            )
            self._next_line = passed + min(passed, _LONGEST_GAP)

    def _left(self, now: float) -> str:
        """The time left, from the pace after the first points, which may have waited for compiled kernels."""
        since = self._work(self._done) - self._work(self._at_first)
        left = self._work(self._total) - self._work(self._done)
        return f", about {duration((now - self._first) * left / since)} left" if since else ""


def work_of(asked: StudyPoints, missing: IntArray) -> Callable[[int], float]:
    """Work of the first n of the points to run.

    Uses the design's prices of models, or recorded prices; without prices, or if all points are alike, each counts one.

    Args:
        asked, missing: The study, and the points of it that run, in this order.
    """
    names, prices = _kinds(asked), dict[tuple[Any, ...], float]()
    if not names or not missing.size:
        return float
    begins = np.unique(np.linspace(0, missing.size - 1, min(missing.size, _PRICED)).astype(np.int64))
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
    """Factors that distinguish the kinds of points: the fidelity, else all with words as values."""
    if asked.study.file.design.kind == "multifidelity":
        return [asked.study.file.design.fidelity]
    first = asked.points.at(slice(0, 1))
    return [name for name, column in first.items() if column.dtype == object]


def _price(asked: StudyPoints, row: int, kind: tuple[Any, ...]) -> float | None:
    """CPU seconds of a point of a kind; None without a record."""
    study = asked.study
    given = study.file.design.prices.get(str(kind[0])) if study.file.design.kind == "multifidelity" else None
    return given or study.simulator.recorded_price({**study.base, **asked.points.settings_of(row)})
