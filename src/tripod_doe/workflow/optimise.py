"""Run an optimisation: the engine of studies computes generations of candidates, from which front and page follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from tripod_doe.analyses.optimisation.optimisation_file import load_optimisation
from tripod_doe.analyses.optimisation.pareto_front import knee
from tripod_doe.analyses.optimisation.problem import Problem, Sample, make_problem, pasted
from tripod_doe.analyses.optimisation.result import (
    Solved,
    base_values,
    candidates_dataset,
    found_candidates,
    front_dataset,
)
from tripod_doe.analyses.optimisation.stored_candidates import FINDINGS
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.reports.optimisation_report import optimisation_lines, write_optimisation_page
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failure_summary import Failure
from tripod_doe.study.result_directory.directory import ResultDirectory, make_directory
from tripod_doe.workflow.candidate_search import CandidateSearch
from tripod_doe.workflow.point_batches import POINTS, TABLE, PointBatches
from tripod_doe.workflow.steps_file import Stages, begin_search

_WAVEFORMS = ("thrust", "thrust_amplitude")


@dataclass(frozen=True)
class OptimisationSummary:
    """Results of an optimisation: where they are, and what they say."""

    directory: Path  # with front.nc, candidates.nc, base.toml, report/index.html and steps/points
    front: xr.Dataset  # as front.nc
    # computed, reused: points of this run and of earlier ones
    computed: int
    reused: int
    failures: Sequence[Failure]  # points that failed, by outcome and reason: their candidates are left out
    lines: Sequence[str]  # sentences on the answer
    found: str  # sentence on the candidates that the search looks for; empty where it looks for none

    @property
    def good(self) -> bool:
        """Whether any candidate is feasible."""
        return self.front.sizes["candidate"] > 0


def optimise(
    file: str | Path,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    progress: bool = True,
    oversubscribe: bool = False,
    untrusted: bool = False,
    take_over: bool = False,
) -> OptimisationSummary:
    """Search for the parameters that make objectives as small or as large as possible within limits.

    Args:
        file: The optimisation file.
        out: Result directory: front.nc, candidates.nc, base.toml, report/index.html, and all points in steps/points. A
            search that was stopped goes on where it was, and ends with the same front. Results of an earlier search
            are removed when this one begins.
        workers, scheduler, oversubscribe: Where points run, see `run`.
        retry_failed: Compute points that failed again.
        progress: Whether the progress is printed to standard error.
        untrusted: For a file from a stranger: refuse functions, and files outside of its folder.
        take_over: Take the lock of a process that is known to be dead.

    Raises:
        InputError: If the file or the directory cannot be used; nothing is started.
        StorageError: If writing fails; finished points are kept.
    """
    request = load_optimisation(file, untrusted)
    problem = make_problem(request)
    directory = make_directory(out)
    place = make_directory(directory / "steps" / POINTS)
    study, stages = problem.study(request.origin, place, TABLE), Stages(directory)
    existing = ExistingScheduler(scheduler, None, None, None) if scheduler else None
    with ResultDirectory(place, take_over) as kept:  # until the page is written: no other search writes here meanwhile
        with Execution(workers, existing, oversubscribe) as execution:
            points = PointBatches(study, kept, execution, retry_failed, progress)
            begin_search(directory, "optimise.toml", request.text)
            run = CandidateSearch(problem, study, points, progress, stages)
            solved = run.solved(run.search())
            solved = replace(solved, around=run.around(solved.front))
            points.write(f"tripod-doe optimise: {points.computed} points computed")
            failures, computed, count = points.failures, points.computed, points.count
            kept.end_journal()
            stages.begin("waveforms")
            waves = _waveforms(problem, solved, directory, execution, take_over)
        stages.begin("report")
        failed = sum(failure.count for failure in failures)
        solved = replace(solved, counts={"points": count, "failed_points": failed})
        lines = optimisation_lines(problem, solved)
        front = front_dataset(problem, solved).assign_attrs({FINDINGS: "\n".join(lines)})
        candidates = candidates_dataset(problem, solved)
        action = f"tripod-doe optimise: {computed} points computed"
        write_dataset(stamp_history(front, action), directory / "front.nc", listed=True)
        write_dataset(stamp_history(candidates, action), directory / "candidates.nc", listed=True)
        if len(solved.front.units):
            best = solved.front.units[knee(solved.front.judged.objectives * problem.signs)]
            write_listed(directory / "base.toml", pasted(base_values(problem, best), problem.confirmed_base))
        found = found_candidates(problem, front)
        stages.end(found)
        write_optimisation_page(directory, problem, solved, failures, waves)
        return OptimisationSummary(directory, front, computed, count - computed, failures, lines, found)


def _waveforms(
    problem: Problem, solved: Solved, directory: Path, execution: Execution, take_over: bool
) -> xr.Dataset | None:
    """The thrust of the start, and of the ends and the knee of the front, at each operating point; None if none."""
    if not set(_WAVEFORMS) <= problem.simulator.outputs.keys() or not len(solved.front.units):
        return None
    aims = solved.front.judged.objectives * problem.signs
    shown = list(dict.fromkeys([*(int(at) for at in aims.argmin(axis=0)), knee(aims)]))
    start = solved.archive.units[: 0 if problem.misfits(solved.archive.units[:1])[0] else 1]
    units = np.concatenate([start, solved.front.units[shown]])
    place = make_directory(directory / "steps" / "waveforms")
    study = problem.study(problem.request.origin, place, TABLE, _WAVEFORMS)
    with ResultDirectory(place, take_over) as kept:
        points = PointBatches(study, kept, execution, progress=False)
        batch = points(problem.columns(units, _nominal(problem), problem.model))
        points.write(f"tripod-doe optimise: {points.computed} points computed")
    if "thrust" not in batch.outputs:
        return None
    shape = len(units), problem.operating.count
    names = [*["start"] * len(start), *(f"candidate {at}" for at in shown)]
    return xr.Dataset(
        {
            "thrust": (("joint", "place", "rotation_deg"), batch.outputs["thrust"][1].reshape(*shape, -1)),
            "thrust_amplitude": (("joint", "place", "order"), batch.outputs["thrust_amplitude"][1].reshape(*shape, -1)),
        },
        coords={"joint": names, "rotation_deg": batch.labels["rotation_deg"], "order": batch.labels["order"]},
    )


def _nominal(problem: Problem) -> Sample:
    """The joint without scatter, as a sample of one: variables as chosen, other parameters in the middle."""
    sample = problem.scatter.sample(1024, 0)
    relative = problem.scatter.relative
    return {
        name: np.zeros(1) if name in relative else np.median(column, keepdims=True) for name, column in sample.items()
    }
