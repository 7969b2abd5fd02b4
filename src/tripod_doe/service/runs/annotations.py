"""Annotations of runs: changed over HTTP, and read again where the command line has changed it."""

import logging
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from tripod_doe.errors import InputError
from tripod_doe.service.runs.table import Run
from tripod_doe.study.results.annotation import FILE, Annotation, read_annotation

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

    def changed(self, runs: Iterable[tuple[Run, Path]]) -> Iterator[Run]:
        """Runs whose file has changed since the last look, as it is now; nothing where that was just now."""
        if time.monotonic() < self._due:
            return
        self._due = time.monotonic() + _PAUSE
        for run, directory in runs:
            try:
                written = (directory / FILE).lstat().st_mtime_ns
            except OSError:
                written = 0
            if written == self._times.get(run.id, 0):
                continue
            self._times[run.id] = written
            try:
                annotation = read_annotation(directory)
            except InputError as error:  # the file is left as it is, and the run shown without it
                log.warning("%s", error)
                continue
            if annotation != run.annotation:
                yield with_annotation(run, annotation)
