"""Points of a fit, computed by the engine of studies: in blocks, on workers if worth it, each kept in a journal.

The search asks for batches of points, always in the same order. What the journal has is not computed again, so a fit
that was killed goes on where it was. In the end all points stand in a cube of their own.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import ComplexArray, FloatArray, IntArray
from tripod_doe.atomic_files import replace_text
from tripod_doe.interrupts import check_interrupt
from tripod_doe.simulator import Outcome, Value
from tripod_doe.study.definition.study import Study, parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import Points, make_points
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failures import Failure, common_failures
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.results.directory import ResultDirectory
from tripod_doe.study.study_points import StudyPoints
from tripod_doe.workflow.progress import Progress, work_of

_TABLE = "points.csv"
_OUTPUTS = ("thrust_amplitude", "thrust_phase_deg", "thrust_amplitude_scatter", "thrust_amplitude_error")


def points_study(name: str, base: Mapping[str, Value], origin: str, folder: Path) -> Study:
    """The study of all points of a fit; its table is written when all are known.

    Raises:
        InputError: If a base value is wrong.
    """
    lines = [f"{key} = {json.dumps(value)}" for key, value in base.items()]
    text = "\n".join(
        [
            "[study]",
            f"name = {json.dumps(name)}",
            "",
            "[base]",
            *lines,
            "",
            "[design]",
            'kind = "table"',
            f'table = "{_TABLE}"',
            "",
            "[keep]",
            f"outputs = {json.dumps(list(_OUTPUTS))}",
            "",
        ]
    )
    return parse_study(text, origin, StudyFolder(folder))


class FitPoints:
    """The points of a fit: asked for in batches, computed once, and kept.

    Args:
        study: From `points_study`.
        directory: Where they are kept, held by this process.
        execution: Where they run.
        retry_failed: Whether points that failed in an earlier run are computed again.
        progress: Whether a bar is shown.
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
        directory.refuse_other_kernels(study)
        self._known: dict[bytes, tuple[int, str, ComplexArray, FloatArray]] = {}
        for block in directory.blocks():
            self._learn(block)
        if retry_failed:
            self._known = {key: row for key, row in self._known.items() if row[0] == Outcome.FINISHED}
        self._asked: dict[bytes, tuple[Value, ...]] = {}
        self._names: tuple[str, ...] = ()
        self.computed = 0

    def __call__(self, columns: Mapping[str, NDArray[Any]]) -> tuple[ComplexArray, FloatArray]:
        """Complex orders 0 to 12 of some points, and the numerical errors that their runs report.

        Args:
            columns: Values of all that differs between points, by name, shape (point,) each; the same names in every
                call.

        Returns:
            orders : ndarray, shape (point, order): NaN where a point failed.
            reported : ndarray, shape (point, order): In N.
        """
        count = len(next(iter(columns.values())))
        asked = StudyPoints(self._study, Points(dict(columns), (count,), ("point",), np.ones(count, bool)))
        keys = [bytes(key) for key in asked.keys]
        self._names = tuple(columns)
        for key, *values in zip(keys, *(column.tolist() for column in columns.values()), strict=True):
            self._asked.setdefault(key, tuple(values))
        missing = np.array([at for at in np.flatnonzero(asked.to_compute) if keys[at] not in self._known], np.int64)
        if missing.size:
            self._compute(asked, missing)
        answers = [self._known[key] for key in keys]
        return np.array([row[2] for row in answers]), np.array([row[3] for row in answers])

    def _compute(self, asked: StudyPoints, missing: IntArray) -> None:
        with (
            Progress(int(missing.size), self._progress and missing.size > 1000, work_of(asked, missing)) as shown,
            self._directory.computing() as died_before,
            closing(self._execution.run(asked, missing, careful=died_before)) as finished,
        ):
            for block in finished:
                self._directory.commit(block)
                self._learn(block)
                self.computed += block.keys.size
                shown.add(block.keys.size)
        check_interrupt()

    def _learn(self, block: FinishedBlock) -> None:
        """Keep the orders of a block."""
        outputs, count = block.result.outputs, block.keys.size
        blank = np.full((count, 13), np.nan)
        amplitude, phase, scatter, error = (outputs[name].data if name in outputs else blank for name in _OUTPUTS)
        orders = amplitude * np.exp(1j * np.radians(phase))
        reported = np.hypot(np.nan_to_num(scatter), np.nan_to_num(error))
        good = block.result.outcome == Outcome.FINISHED
        orders = np.where(good[:, None], orders, np.nan)
        for row, key in enumerate(block.keys):
            outcome = int(block.result.outcome[row])
            self._known[bytes(key)] = outcome, block.result.detail[row], orders[row], reported[row]

    @property
    def failures(self) -> list[Failure]:
        """Points that were asked for and failed, by outcome and reason."""
        rows = (self._known[key] for key in self._asked if key in self._known)
        return list(common_failures((row[0], row[1]) for row in rows if row[0] != Outcome.FINISHED))

    @property
    def count(self) -> int:
        """Number of different points that were asked for."""
        return len(self._asked)

    def write(self, action: str) -> None:
        """Write all points that were asked for as the cube of a study.

        Raises:
            StorageError: If it cannot be written.
        """
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self._names)
        writer.writerows([value if isinstance(value, str) else repr(value) for value in row] for row in self._rows())
        replace_text(self._directory.path / _TABLE, stream.getvalue())
        study = parse_study(self._study.text, self._study.origin, StudyFolder(self._directory.path))
        asked = StudyPoints(study, make_points(study))
        self._directory.adopt(study)
        self._directory.write_cube(asked, action).close()

    def _rows(self) -> list[tuple[Value, ...]]:
        return list(self._asked.values())
