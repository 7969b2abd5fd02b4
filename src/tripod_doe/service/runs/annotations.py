"""Annotations of runs: changed over HTTP, and read again after the command line has changed them."""

import logging
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from tripod_doe.errors import InputError
from tripod_doe.service.runs.run_table import Run
from tripod_doe.study.result_directory.annotation import FILE, Annotation, read_annotation

_PAUSE = 2.0  # seconds between two checks

log = logging.getLogger(__name__)


def with_annotation(run: Run, annotation: Annotation) -> Run:
    """A run with the given annotation."""
    return run.changed(label=annotation.name, owner=annotation.owner, tags=annotation.tags, note=annotation.note)


class AnnotationFiles:
    """The annotation files of runs, read when they change."""

    def __init__(self) -> None:
        self._times: dict[str, int] = {}
        self._due = 0.0

    def changed(self, runs: Iterable[tuple[str, Path]]) -> Iterator[tuple[str, Annotation]]:
        """Annotations, by run id, whose file has changed since the last check; nothing right after a check.

        Reading may be slow: do not hold a lock meanwhile.
        """
        if time.monotonic() < self._due:
            return
        self._due = time.monotonic() + _PAUSE
        for run_id, directory in runs:
            written = self._time_of(directory)
            if written == self._times.get(run_id, 0):
                continue
            self._times[run_id] = written
            try:
                annotation = read_annotation(directory)
            except InputError as error:  # leave the file unchanged, and show the run without it
                log.warning("%s", error)
                continue
            yield run_id, annotation

    def is_current(self, run_id: str, directory: Path) -> bool:
        """Whether a run's file is unchanged since it was read; if not, the next check reads it again."""
        return self._time_of(directory) == self._times.get(run_id, 0)

    @staticmethod
    def _time_of(directory: Path) -> int:
        try:
            return (directory / FILE).lstat().st_mtime_ns
        except OSError:
            return 0
