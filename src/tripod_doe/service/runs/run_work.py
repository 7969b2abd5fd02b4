"""The work of runs: their queue, the start of a process, and what is known of it until its end is stored."""

import time
from collections.abc import Iterable
from pathlib import Path

from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.runs import processes
from tripod_doe.service.runs.progress import RunProgress
from tripod_doe.service.runs.run_end import remove_report, remove_stages
from tripod_doe.service.runs.run_table import Run, State
from tripod_doe.service.settings import Settings

_PATIENCE = 20.0  # seconds that a run has to end in order after a stop


def refuse_full_queue(runs: Iterable[Run], coming: int, limits: Limits) -> None:
    """Refuse (413) another run where the most are waiting, or are being changed to wait (`coming`)."""
    if sum(run.state is State.QUEUED for run in runs) + coming >= limits.queued:
        raise RefusedError(413, f"{limits.queued:,} runs are waiting, which is the limit: try again later")


def next_to_start(runs: Iterable[Run], limits: Limits) -> list[Run]:
    """The runs that have waited longest, as many as may start now."""
    known = list(runs)
    free = limits.running - sum(run.state.alive for run in known)
    return [run for run in known if run.state is State.QUEUED][: max(0, free)]


def start_work(run: Run, directory: Path, settings: Settings) -> None:
    """Start the process of a run; InputError if it cannot be started."""
    remove_report(directory)
    if run.is_search:
        remove_stages(directory)
    words = processes.run_words(run, directory, settings.workers)
    processes.start_run(directory, words, settings.limits.run_memory_bytes)


class RunWork:
    """The process of a run.

    Attributes:
        progress: Its points so far.
        ending: Its ending, where a full disk has kept it from the table.
    """

    def __init__(self, run: Run, directory: Path) -> None:
        self.progress = RunProgress(run, directory)
        self.ending: tuple[State, str] | None = None
        self._directory, self._asked = directory, False
        self._kill_at: float | None = None

    def stop(self) -> None:
        """Ask the process to stop, also if it had just started, and kill it if it does not stop in time."""
        now = time.monotonic()
        self._kill_at = self._kill_at or now + _PATIENCE
        self._asked = self._asked or processes.stop_run(self._directory)  # a second signal would end it at once
        if now > self._kill_at:
            self._kill_at = now + _PATIENCE
            processes.kill_run(self._directory)
