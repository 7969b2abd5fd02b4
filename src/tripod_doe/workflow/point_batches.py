"""Points that a search requests in batches: the engine of studies computes them in blocks, and a journal keeps them.

A search requests the same batches in the same order each time. Points in the journal are not computed again, so a
killed search continues where it was, and ends with the same answer. At the end a separate cube holds all points.
"""

import csv
import io
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.model_interface import Outcome, Value, refuse_other_dims, take_labels
from tripod_doe.process.interrupts import check_interrupt
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import Points, make_points
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failure_summary import Failure, common_failures
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.study.study_points import StudyPoints
from tripod_doe.workflow.progress import Progress, work_of

POINTS = "points"
"""Folder of the steps of a search in which its points are kept."""

TABLE = "points.csv"
"""File of all requested points, which the study of their cube names as its table."""

_SHOWN_AFTER = 1000  # points of a batch; a larger batch shows a progress bar
_EVERY = 20.0  # seconds after which the table is written again, so that a search can be queried while it runs


@dataclass(frozen=True)
class Batch:
    """Answers to some points, in their order."""

    points: Points  # the points
    outcome: NDArray[np.int8]  # how each ended, shape (point,)
    detail: list[str]  # why it failed
    # outputs: the dimensions of a point's value, and values of all points; NaN where a point failed
    outputs: dict[str, tuple[tuple[str, ...], NDArray[Any]]]
    labels: dict[str, NDArray[Any]]  # labels along these dimensions

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Whether a point finished, shape (point,)."""
        return np.asarray(self.outcome == Outcome.FINISHED)


class PointBatches:
    """The points of a search: asked for in batches, computed once, and kept.

    Args:
        study: A study whose design is the table `TABLE`, which need not be there yet.
        directory: Directory that keeps them, locked by this process.
        retry_failed: Whether points that failed in an earlier run are computed again.
        progress: Whether bars are shown.

    Attributes:
        computed: Number of points that were computed by this process.
    """

    def __init__(
        self,
        study: Study,
        directory: ResultDirectory,
        execution: Execution,
        retry_failed: bool = False,
        progress: bool = True,
    ) -> None:
        self._study, self._directory, self._execution, self._progress = study, directory, execution, progress
        directory.resume.refuse_unknown_version(study)
        directory.resume.refuse_other_kernels(study)
        self._place: dict[bytes, tuple[int, int, int, str]] = {}  # block, row, outcome and reason by fingerprint
        self._read: list[Callable[[], FinishedBlock]] = directory.places()
        for number, read in enumerate(self._read):
            self._learn(number, read(), retry_failed)
        self._asked: dict[bytes, tuple[Value, ...]] = {}
        self._names: tuple[str, ...] = ()
        self._written = -_EVERY
        self.computed = 0

    def _learn(self, number: int, block: FinishedBlock, finished_only: bool = False) -> None:
        """Record where the points of a block are stored, unless it lacks an output."""
        good = block.result.outcome == Outcome.FINISHED
        if good.any() and not set(self._study.stored) <= {*block.result.outputs, *self._optional}:
            return
        for row, key in enumerate(block.keys):
            if good[row] or not finished_only:
                self._place[bytes(key)] = number, row, int(block.result.outcome[row]), block.result.detail[row]

    @property
    def _optional(self) -> Collection[str]:
        """Outputs that a model may not give."""
        return [name for name, output in self._study.simulator.outputs.items() if output.optional]

    def __call__(self, columns: Mapping[str, NDArray[Any]]) -> Batch:
        """Answers to some points.

        Args:
            columns: Values of all parameters that differ between points, by name, shape (point,) each; the same names
                in every call.
        """
        count = len(next(iter(columns.values())))
        points = Points(dict(columns), (count,), ("point",), np.ones(count, bool))
        asked = StudyPoints(self._study, points)
        keys = [bytes(key) for key in asked.keys]
        self._names = tuple(columns)
        for key, *values in zip(keys, *(column.tolist() for column in columns.values()), strict=True):
            self._asked.setdefault(key, tuple(values))
        missing = np.array([at for at in np.flatnonzero(asked.to_compute) if keys[at] not in self._place], np.int64)
        if missing.size:
            self._compute(asked, missing)
        return self._answers(points, keys)

    def _compute(self, asked: StudyPoints, missing: IntArray) -> None:
        known = len(self._read)
        with (
            Progress(
                int(missing.size), self._progress and missing.size > _SHOWN_AFTER, work_of(asked, missing)
            ) as shown,
            self._directory.computing() as died_before,
            closing(self._execution.run(asked, missing, careful=died_before)) as finished,
        ):
            for number, block in enumerate(finished, known):
                self._directory.commit(block)
                self._learn(number, block)
                self.computed += block.keys.size
                shown.add(block.keys.size)
        self._read = self._directory.places()
        check_interrupt()
        if time.monotonic() - self._written > _EVERY:
            self._store()

    def _answers(self, points: Points, keys: list[bytes]) -> Batch:
        """Answers of all points of a batch, block by block."""
        places = [self._place[key] for key in keys]
        numbers, rows = (np.array([place[at] for place in places]) for at in (0, 1))
        outputs: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {}
        labels: dict[str, NDArray[Any]] = {}
        for number in np.unique(numbers):
            result, own = self._read[number]().result, np.flatnonzero(numbers == number)
            for name, values in result.outputs.items():
                if name not in outputs:
                    outputs[name] = values.dims, np.full((len(keys), *values.data.shape[1:]), np.nan)
                refuse_other_dims(name, outputs[name][0], values.dims)
                outputs[name][1][own] = values.data[rows[own]]
            take_labels(labels, result.coordinates)
        outcome = np.array([place[2] for place in places], np.int8)
        return Batch(points, outcome, [place[3] for place in places], outputs, labels)

    @property
    def count(self) -> int:
        """Number of different requested points."""
        return len(self._asked)

    @property
    def failures(self) -> list[Failure]:
        """Requested points that failed, by outcome and reason, the most frequent first."""
        return list(common_failures(self._place[key][2:] for key in self._asked))

    def write(self, action: str) -> None:
        """Write all requested points as the cube of a study; writes nothing if no candidate is possible.

        Raises:
            StorageError: If it cannot be written.
        """
        if not self._asked:
            return
        study = self._store()
        self._directory.write_cube(StudyPoints(study, make_points(study)), action).close()

    def _store(self) -> Study:
        """Write the table of all points so far, and store its study in the directory."""
        write_table(self._directory.path / TABLE, self._names, self._asked.values())
        study = parse_study(self._study.text, self._study.origin, self._study.folder)
        self._directory.adopt(study)
        self._written = time.monotonic()
        return study


def write_table(path: Path, names: Iterable[str], rows: Iterable[Iterable[Value]]) -> None:
    """Write points as a table of a study: a column for each name, numbers with all their digits."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([value if isinstance(value, str) else _written(value) for value in row] for row in rows)
    write_listed(path, stream.getvalue())


def _written(value: Value) -> str:
    """A number with all its digits; empty where there is none."""
    return "" if value is None or value != value else repr(value)
