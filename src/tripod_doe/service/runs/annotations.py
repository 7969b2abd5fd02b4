"""Annotations of runs: changed over HTTP, and read again where the command line has changed it."""

import logging
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from tripod_doe.errors import InputError
from tripod_doe.service.runs.run_table import Run
from tripod_doe.study.result_directory.annotation import FILE, Annotation, read_annotation

_PAUSE = 2.0  # seconds between two looks

log = logging.getLogger(__name__)


def with_annotation(run: Run, annotation: Annotation) -> Run:
    """A run with what people write about it."""
    return run.changed(label=annotation.name, owner=annotation.owner, tags=annotation.tags, note=annotation.note)


class AnnotationFiles:
    """The files in which people write about runs, read when they change."""

    def __init__(self) -> None:
        self._times: dict[str, int] = {}
        self._due = 0.0

    def changed(self, runs: Iterable[tuple[str, Path]]) -> Iterator[tuple[str, Annotation]]:
        """Annotations by the ids of runs whose file has changed since the last look; nothing where that was just now.

        Reading may take its time: nothing that others wait for is to be held meanwhile.
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
            except InputError as error:  # the file is left as it is, and the run shown without it
                log.warning("%s", error)
                continue
            yield run_id, annotation

    def is_current(self, run_id: str, directory: Path) -> bool:
        """Whether the file of a run is the one that was read; where it is not, the next look reads it again."""
        return self._time_of(directory) == self._times.get(run_id, 0)

    @staticmethod
    def _time_of(directory: Path) -> int:
        try:
            return (directory / FILE).lstat().st_mtime_ns
        except OSError:
            return 0
