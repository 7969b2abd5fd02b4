"""How far a run is: a bar on a terminal, a line now and then in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from tqdm import tqdm

from tripod_doe.quantities import count_of, duration

_BAR = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}, {rate_fmt}{postfix}]"  # tqdm's own without its time left
_FIRST_LINE = 30.0  # seconds after which a log gets a first line; shorter runs print only their end
_LONGEST_GAP = 600.0  # seconds between two lines, to which the gaps grow


class Progress:
    """Points that are done, printed on standard error.

    On a terminal a bar is drawn. A log gets a line after half a minute, and then whenever the time since the start has
    doubled, at least every ten minutes: a run of a day takes some 150 lines.

    Parameters
    ----------
    total
        Points to compute.
    shown
        Whether anything is printed at all.
    work
        How much work the first so many points are, in any unit; by it the time left is estimated.
    """

    def __init__(self, total: int, shown: bool, work: Callable[[int], float] = float) -> None:
        self._total, self._done, self._at_first, self._work = total, 0, 0, work
        self._bar = tqdm(
            total=total, unit="point", disable=None if shown else True, file=sys.stderr, smoothing=0.05, bar_format=_BAR
        )  # None: only on a terminal
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
        """The time still to come, by the points since the first ones, which may have waited for compiled kernels."""
        since = self._work(self._done) - self._work(self._at_first)
        left = self._work(self._total) - self._work(self._done)
        return f", about {duration((now - self._first) * left / since)} left" if since else ""
