"""Best and worst point of each run by one order of the thrust, for the list of runs: found once per state of a run."""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from tripod_doe.service.runs.run_table import Run

_PAUSE = 2.0  # seconds between two looks into the cube of a run at work


class Extremes:
    """Known extremes of runs.

    Args:
        find: (run, order) -> extremes of its cube, or None where it has none to tell.
    """

    def __init__(self, find: Callable[[Run, int], Mapping[str, Any] | None]) -> None:
        self._find = find
        self._known: dict[tuple[str, int], tuple[int, float, Mapping[str, Any] | None]] = {}
        self._lock = threading.Lock()

    def known(self, runs: list[Run], order: int) -> dict[str, Mapping[str, Any]]:
        """The extremes so far, by the ids of the runs."""
        found = {run.id: self._known.get((run.id, order)) for run in runs}
        return {run_id: entry[2] for run_id, entry in found.items() if entry and entry[2]}

    def update(self, runs: list[Run], order: int, there: list[Run]) -> bool:
        """Look into the cubes of runs that have more points than at the last look; gives whether anything is new.

        Args:
            runs: Those to look at.
            order: Of the thrust.
            there: All runs; what is known of others is forgotten.
        """
        if not self._lock.acquire(blocking=False):  # another page has asked, and its answer is this one's
            return False
        try:
            stale = [run for run in runs if self._is_stale(run, order)]
            for run in stale:
                self._known[run.id, order] = (run.counts.finished, time.monotonic(), self._find(run, order))
            gone = self._known.keys() - {(run.id, known) for run in there for _, known in self._known}
            for key in gone:
                del self._known[key]
            return bool(stale)
        finally:
            self._lock.release()

    def _is_stale(self, run: Run, order: int) -> bool:
        if run.kind != "study" or not run.counts.finished:
            return False
        count, at, _ = self._known.get((run.id, order), (0, -_PAUSE, None))
        return count != run.counts.finished and (run.state.at_rest or time.monotonic() - at > _PAUSE)
