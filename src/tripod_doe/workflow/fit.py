"""Run a fit: read the records, compute points with the engine of studies, write fit.nc, base.toml and a page."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.fit.base_file import base_text, tolerance_text
from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.fit.model_error import Needles
from tripod_doe.analyses.fit.next_record import next_record
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.analyses.fit.result import fit_dataset, found_unknowns
from tripod_doe.array_types import ComplexArray
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.joint.orders import ORDERS
from tripod_doe.model_interface import Outcome, check_parameters
from tripod_doe.process.one_thread import one_thread
from tripod_doe.reports.fit_report import write_fit_page
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.definition.toml_text import toml_text
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failure_summary import Failure
from tripod_doe.study.result_directory.directory import ResultDirectory, make_directory
from tripod_doe.study.result_directory.open_cube import FIT_FILE
from tripod_doe.workflow.point_batches import POINTS, TABLE, Batch, PointBatches
from tripod_doe.workflow.steps_file import Stages, begin_search

_ORDERS = ("thrust_amplitude", "thrust_phase_deg")
_NEEDLES = ("groove_thrust_amplitude", "groove_thrust_phase_deg", "needle_skew_summary_deg")


@dataclass(frozen=True)
class FitSummary:
    """Results of a fit: where they are, and what they say."""

    directory: Path  # with fit.nc, base.toml, tolerance.toml, report/index.html and steps/points
    # computed, reused: points of this run and of earlier ones
    computed: int
    reused: int
    failures: Sequence[Failure]  # points that failed, by outcome and reason
    result: xr.Dataset  # as in fit.nc
    found: str  # sentence on the unknowns that the fit looks for; empty where it looks for none

    @property
    def good(self) -> bool:
        """Whether only points of impossible joints failed, which the search may also have tried."""
        return all(failure.outcome is Outcome.JAMMED for failure in self.failures)


def fit(
    file: str | Path,
    out: str | Path,
    *,
    workers: int | None = None,
    retry_failed: bool = False,
    progress: bool = True,
    oversubscribe: bool = False,
    untrusted: bool = False,
    take_over: bool = False,
) -> FitSummary:
    """Fit unknown parameters of the joint to measured records.

    Args:
        file: The fit file.
        out: Result directory: fit.nc, base.toml, tolerance.toml, report/index.html, and all points in steps/points. A
            fit that was stopped goes on where it was. Results of an earlier fit are removed when this one begins.
        workers: Worker processes, see `run`.
        retry_failed: Compute points that failed again.
        progress: Whether stages are printed to standard error.
        oversubscribe: Allow more workers than this machine has processors.
        untrusted: For a file from a stranger: refuse files outside of its folder.
        take_over: Take the lock of a process that is known to be dead.

    Raises:
        InputError: If the file, a record or the directory cannot be used.
        StorageError: If writing fails; finished points are kept.
    """
    request = load_fit(file, untrusted)
    rig = FitProblem(request)
    directory = make_directory(out)
    place = make_directory(directory / "steps" / POINTS)
    stages = Stages(directory)
    with ResultDirectory(place, take_over) as kept:  # until the page is written: no other fit writes here meanwhile
        with one_thread(), Execution(workers, None, oversubscribe) as execution:
            points = PointBatches(_points_study(rig, place), kept, execution, retry_failed, progress)
            begin_search(directory, "fit.toml", request.text)

            def answers(columns: Mapping[str, NDArray[Any]]) -> tuple[ComplexArray, Needles]:
                batch = points(columns)
                return _orders(batch), _needles(batch)

            def tell(stage: str) -> None:
                stages.begin(stage)
                if progress:
                    print(f"fit: {stage}, {points.count:,} points", file=sys.stderr)

            solution, error = rig.fit(answers, tell)
            if rig.candidates:
                stages.begin("what to measure next")
            following, doubts = next_record(rig, answers, solution), rig.doubts(answers)
            points.write(f"tripod-doe fit: {points.computed} points computed")
            failures, computed, count = points.failures, points.computed, points.count
        kept.end_journal()
        stages.begin("report")
        result = fit_dataset(rig, solution, error, following, doubts)
        result = result.assign_attrs(points=count, failed_points=sum(failure.count for failure in failures))
        result = stamp_history(result, f"tripod-doe fit: {computed} points computed")
        write_dataset(result, directory / FIT_FILE, listed=True)
        known = check_parameters(rig.simulator.parameters, rig.file.base)
        write_listed(directory / "base.toml", base_text(result, known))
        write_listed(directory / "tolerance.toml", tolerance_text(result, known))
        found = found_unknowns(request, result)
        stages.end(found)
        write_fit_page(directory, result)
        return FitSummary(directory, computed, count - computed, failures, result, found)


def _points_study(rig: FitProblem, folder: Path) -> Study:
    """The study of all points of a fit, whose table is in a folder."""
    content = {
        "study": {"name": f"{rig.file.fit.name}: points"},
        "base": rig.base,
        "design": {"kind": "table", "table": TABLE},
        "keep": {"outputs": [*_ORDERS, *_NEEDLES]},
    }
    return parse_study(toml_text(content), rig.request.origin, StudyFolder(folder))


def _orders(batch: Batch) -> ComplexArray:
    """Complex orders 0 to 12 in N, shape (point, order); NaN where the point failed."""
    blank = np.full((batch.points.count, ORDERS.size), np.nan)
    amplitude, phase = (batch.outputs[name][1] if name in batch.outputs else blank for name in _ORDERS)
    return np.where(batch.finished[:, None], amplitude * np.exp(1j * np.radians(phase)), np.nan)


def _needles(batch: Batch) -> Needles:
    """Second orders at the grooves and mean skews in the last revolution; NaN where there are none."""
    known = [batch.outputs[name][1] for name in _NEEDLES if name in batch.outputs]
    if len(known) < len(_NEEDLES):
        blank = np.full((batch.points.count, 3), np.nan)
        return Needles(blank.astype(complex), blank)
    amplitude, phase, skew = known
    return Needles(amplitude[..., 2] * np.exp(1j * np.radians(phase[..., 2])), skew[:, :, -1, 0])
