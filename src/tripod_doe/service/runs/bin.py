"""Deleted runs: kept for some weeks with their results, so that each can be restored."""

import logging
import threading
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from tripod_doe.errors import StorageError
from tripod_doe.files.atomic_files import remove_tree
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.runs.run_end import is_exchanged
from tripod_doe.service.runs.run_table import Run, RunTable, now, stamp

_DELETED = ".deleted-"

log = logging.getLogger(__name__)


class Bin:
    """The runs in the bin; their rows stay in the table, marked as binned, and their directories are not moved."""

    def __init__(self, folder: Path, table: RunTable) -> None:
        self._folder, self._table = folder, table
        self._runs: dict[str, Run] = {}
        self._lock = threading.Lock()

    def __contains__(self, run_id: str) -> bool:
        return run_id in self._runs

    def all(self) -> list[Run]:
        """The runs in the bin, the last deleted first."""
        with self._lock:
            return sorted(self._runs.values(), key=lambda run: run.binned, reverse=True)

    def show(self, runs: Iterable[Run]) -> None:
        """Set the runs in the bin, from rows of the table."""
        with self._lock:
            self._runs = {run.id: run for run in runs}

    def add(self, run: Run) -> None:
        """Put a run into the bin; its Idempotency-Key may be used again."""
        with self._lock:
            binned = replace(run, key=None, binned=now())
            self._table.put(binned)
            self._runs[run.id] = binned

    def take(self, run_id: str) -> Run:
        """Take a run out of the bin; RefusedError 404 if it is not there."""
        with self._lock:
            if run_id not in self._runs:
                raise RefusedError(404, f"{run_id[:100]}: no run of this id in the bin")
            run = replace(self._runs[run_id], binned="")
            self._table.put(run)
            del self._runs[run_id]
            return run

    def remove(self, run_id: str) -> None:
        """Forget a run that is in the bin, and remove its directory."""
        directory = self._folder.absolute() / run_id
        doomed = directory.with_name(_DELETED + run_id)
        with self._lock:
            run = self._runs.pop(run_id, None)
            if run is None:
                return
            if directory.exists() and not is_exchanged(run, directory):
                directory.rename(doomed)  # a kill after this line leaves no directory that looks like a run
            self._table.remove(run_id)
        remove_tree(doomed)

    def remove_leftovers(self) -> None:
        """Remove what a kill left of removals."""
        for left in self._folder.glob(f"{_DELETED}*"):
            remove_tree(left)

    def empty(self, days: float) -> None:
        """Remove runs that were in the bin for more than `days`."""
        oldest = stamp(datetime.now(UTC) - timedelta(days=days))
        for run in [run for run in self.all() if run.binned < oldest]:
            try:
                self.remove(run.id)
            except (OSError, StorageError):
                log.exception("run %s stays in the bin", run.id)
