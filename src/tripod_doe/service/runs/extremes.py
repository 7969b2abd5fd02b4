"""Best and worst point of each run at one order of the thrust, for the list of runs; cached per state of a run."""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from tripod_doe.service.runs.run_table import Run

_PAUSE = 2.0  # seconds between two looks into the cube of a run at work


class Extremes:
    """Known extremes of runs.

    Args:
        find: (run, order) -> extremes of the run's cube, or None if it has none.
    """

    def __init__(self, find: Callable[[Run, int], Mapping[str, Any] | None]) -> None:
        self._find = find
        self._known: dict[tuple[str, int], tuple[tuple[int, str], float, Mapping[str, Any] | None]] = {}
        self._lock = threading.Lock()

    def known(self, runs: list[Run], order: int) -> dict[str, Mapping[str, Any]]:
        """The extremes so far, by the ids of the runs."""
        entries = {run.id: self._known.get((run.id, order)) for run in runs}
        return {run_id: entry[2] for run_id, entry in entries.items() if entry and entry[2]}

    def update(self, runs: list[Run], order: int, there: list[Run]) -> bool:
        """Read the cubes of runs that have changed since the last call; return whether anything is new.

        Args:
            runs: Runs to update.
            order: Order of the thrust.
            there: All existing runs; cached extremes of other runs are dropped.
        """
        if not self._lock.acquire(blocking=False):  # another page is updating; its result serves this page, too
            return False
        try:
            stale = [run for run in runs if self._is_stale(run, order)]
            for run in stale:
                self._known[run.id, order] = (_state(run), time.monotonic(), self._find(run, order))
            ids = {run.id for run in there}
            for key in [key for key in self._known if key[0] not in ids]:
                del self._known[key]
            return bool(stale)
        finally:
            self._lock.release()

    def _is_stale(self, run: Run, order: int) -> bool:
        if run.kind != "study" or not run.counts.finished:
            return False
        state, at, _ = self._known.get((run.id, order), (None, -_PAUSE, None))
        return state != _state(run) and (run.state.at_rest or time.monotonic() - at > _PAUSE)


def _state(run: Run) -> tuple[int, str]:
    """What changes with the cube of a run."""
    return run.counts.finished, run.updated
