"""The one run that a link opens, in place of all runs: every request for another run gets 404."""

from pathlib import Path

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.runs.events import Events
from tripod_doe.service.runs.run_table import Run
from tripod_doe.service.runs.supervisor import Supervisor


class OneRun:
    """The reading methods of a `Supervisor`, for one run; no method writes.

    Args:
        runs: All runs.
        run_id: The visible run.
    """

    def __init__(self, runs: Supervisor, run_id: str) -> None:
        self._runs, self._id = runs, run_id

    @property
    def events(self) -> Events:
        """Changes of all runs."""
        return self._runs.events

    def find(self, run_id: str) -> Run:
        """The run.

        Raises:
            RefusedError: 404 for any other run.
        """
        if run_id != self._id:
            raise RefusedError(404, f"{run_id[:100]}: no run of this id")
        return self._runs.find(run_id)

    def all(self) -> list[Run]:
        """The run alone."""
        return [run for run in self._runs.all() if run.id == self._id]

    def in_bin(self) -> list[Run]:
        """None."""
        return []

    def directory(self, run_id: str) -> Path:
        """Its result directory."""
        return self._runs.directory(self.find(run_id).id)
