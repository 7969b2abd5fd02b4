"""Run an optimisation: the engine of studies computes generations of candidates, from which front and page follow."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.optimisation.confirmation import confirmation_batches, first_confirmed, next_confirmed
from tripod_doe.analyses.optimisation.correction import Correction
from tripod_doe.analyses.optimisation.measures import Ends, Judged
from tripod_doe.analyses.optimisation.neighbours import Neighbours, around
from tripod_doe.analyses.optimisation.optimisation_file import load_optimisation
from tripod_doe.analyses.optimisation.pareto_front import Archive, front_rows, knee, places_of
from tripod_doe.analyses.optimisation.problem import Problem, Sample, make_problem, pasted
from tripod_doe.analyses.optimisation.result import (
    Solved,
    base_values,
    candidates_dataset,
    found_candidates,
    front_dataset,
)
from tripod_doe.analyses.optimisation.search import (
    FAILED,
    NARROWEST,
    WIDEST,
    Search,
    first_generation,
    last_share,
    leading,
    population_of,
    refine,
    steps_around,
)
from tripod_doe.analyses.optimisation.stored_candidates import FINDINGS
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.reports.optimisation_report import optimisation_lines, write_optimisation_page
from tripod_doe.study.cube.netcdf import stamp_history, write_dataset
from tripod_doe.study.definition.study import Study
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.failure_summary import Failure
from tripod_doe.study.result_directory.directory import ResultDirectory, make_directory
from tripod_doe.workflow.point_batches import POINTS, TABLE, PointBatches
from tripod_doe.workflow.steps_file import Stages, begin_search

_EVERY = 5.0  # seconds between lines of progress
_MOST_GENERATIONS = 30  # generations written for programs that watch the run
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


class _NoneLeftError(Exception):
    """No candidate is left to try."""


class _Run:
    """A running search."""

    def __init__(self, problem: Problem, study: Study, points: PointBatches, progress: bool, stages: Stages) -> None:
        self.problem, self.study, self.points, self._progress = problem, study, points, progress
        self._stages = stages
        self._course: list[dict[str, Any]] = []  # candidates, feasible ones and best objectives after each generation
        self.table = problem.request.file.search
        self.sample = problem.search_sample
        self._rows: dict[bytes, int] = {}  # row of each candidate so far, by its place in the unit cube
        self._units: list[FloatArray] = []
        self._judged: list[Judged] = []
        self._starts: list[int] = []  # first row of each generation
        self._generation: list[int] = []
        self._best = np.full(len(problem.signs), np.inf)  # best feasible value of each objective, to minimise
        self._feasible = 0
        self._shown = time.monotonic()
        self._searches = 0  # begun so far
        self.ended: list[float] = []  # best first objective, to minimise, of each completed search

    @property
    def left(self) -> int:
        """Number of candidates that may still be tried."""
        return self.table.evaluations - len(self._rows)

    def archive(self) -> Archive:
        """All candidates so far."""
        return Archive(np.array(self._units), Judged.joined(self._judged), np.array(self._generation))

    def judge(self, units: FloatArray, sample: Sample, model: str) -> Judged:
        """Judge candidates; runs no point of a candidate with a follower out of range."""
        reasons = self.problem.misfits(units)
        able = np.array([not reason for reason in reasons], bool)
        if able.all():
            return self._judge_able(units, sample, model)
        counts = len(self.problem.objectives), len(self.problem.constraints)
        parts = [Judged.impossible(list(filter(None, reasons)), *counts)]
        if able.any():
            parts.insert(0, self._judge_able(units[able], sample, model))
        order = np.argsort(np.concatenate([np.flatnonzero(able), np.flatnonzero(~able)]))
        return Judged.joined(parts).take(order)

    def _judge_able(self, units: FloatArray, sample: Sample, model: str) -> Judged:
        batch = self.points(self.problem.columns(units, sample, model))
        detail = np.array(batch.detail, object).reshape(len(units), -1)
        ends = Ends(batch.outcome.reshape(len(units), -1), detail)
        return self.problem.judge(self.study, batch.points, ends, batch.outputs, batch.labels, sample)

    def try_out(self, units: FloatArray, generation: int) -> IntArray:
        """Judge new candidates while any are left to try; return the row of each candidate, -1 if it was not judged."""
        keys = [unit.tobytes() for unit in units]
        first = {key: at for at, key in reversed(list(enumerate(keys))) if key not in self._rows}
        new = sorted(first.values())[: self.left]  # the start of the search comes first
        if new:
            judged = self.judge(units[new], self.sample, self.problem.model)
            self._judged.append(judged)
            self._starts.append(len(self._units))
            aims = judged.objectives[judged.feasible] * self.problem.signs
            self._feasible += len(aims)
            self._best = np.minimum(self._best, aims.min(axis=0, initial=np.inf))
            for at in new:
                self._rows[keys[at]] = len(self._units)
                self._units.append(units[at])
                self._generation.append(generation)
        self._tell(generation)
        return self._known(units)

    def _known(self, units: FloatArray) -> IntArray:
        """The row of each candidate, -1 if it was not judged."""
        return np.array([self._rows.get(unit.tobytes(), -1) for unit in units])

    def judged_at(self, rows: IntArray) -> Judged:
        """Candidates at these rows, in this order; reads only the generations that contain them."""
        places = np.searchsorted(self._starts, rows, side="right") - 1
        parts = [self._judged[at].take(rows[places == at] - self._starts[at]) for at in np.unique(places)]
        return Judged.joined(parts).take(np.argsort(np.argsort(places, kind="stable")))

    def _tell(self, generation: int) -> None:
        """Report progress: after each generation for programs that watch, every few seconds on standard error."""
        best = [value if np.isfinite(value) else None for value in (self._best * self.problem.signs).tolist()]
        self._course.append(
            {
                "generation": generation,
                "candidates": len(self._rows),
                "feasible": self._feasible,
                "best": dict(zip(self.problem.objectives, best, strict=True)),
            }
        )
        text = (
            f"generation {generation}, {len(self._rows):,} of {self.table.evaluations:,} candidates, "
            f"{self._feasible:,} feasible"
        )
        self._stages.update(text, generations=_thinned(self._course))
        if self._progress and time.monotonic() - self._shown >= _EVERY:
            self._shown = time.monotonic()
            print(f"optimise: {text}, {self.points.count:,} points", file=sys.stderr)

    def search(self) -> float:
        """Try candidates until none is left or new; return the step at which the best one stays the best, or NaN."""
        self._stages.begin("search")
        share = last_share(self.problem.variables, len(self.problem.signs), self.problem.is_corrected)
        is_polished = len(self.problem.signs) == 1 and not self.problem.is_corrected
        kept = int(share * self.table.evaluations)
        generation, known, quiet = 0, -1, np.nan
        while self.left > kept and len(self._units) > known:  # until all candidates are known
            known = len(self._units)
            generation = self._search_once(generation, kept)
            if is_polished:
                quiet = self._polish(generation, self.judged_at)
                kept = int(share * self.left)
        return quiet

    def _search_once(self, generation: int, kept: int) -> int:
        """Search until only `kept` candidates are left to try, or no new one comes; return the generation."""
        problem, table, again = self.problem, self.table, self._searches
        self._searches += 1
        population = population_of(table.evaluations, table.population)
        start = problem.start_unit if not again else None
        first = first_generation(problem.variables, population, table.seed + again, start)
        search = Search(problem.variables, problem.signs, len(problem.constraints), first, table.seed + again)
        generation, best = self._evolve(search, generation, kept, self.judged_at)
        if search.is_over:
            self.ended.append(best)
        return generation

    def _evolve(
        self, search: Search, generation: int, kept: int, judgement: Callable[[IntArray], Judged]
    ) -> tuple[int, float]:
        """Let a search propose generations; returns the next one's number, and the best first objective, to minimise.

        Args:
            judgement: How candidates are judged, by their rows.
        """
        best = np.inf
        while self.left > kept and not search.is_over:
            units = search.ask()
            if not len(units):
                break
            before = self.left
            rows = self.try_out(units, generation)
            if (rows < 0).any():
                break
            judged = judgement(rows)
            search.tell(judged, before - self.left)
            values = (judged.objectives[:, 0] * self.problem.signs[0])[judged.feasible]
            best = min(best, float(values.min(initial=np.inf)))
            generation += 1
        return generation, best

    def _search_corrected(self, correction: Correction, rounds: int) -> None:
        """Search with the model as the better model corrects it, with a share of the candidates left to try.

        The correction moves limits, and the earlier search has not looked for candidates near the moved limits.

        Args:
            rounds: Number of such searches, this one included.
        """
        problem, archive = self.problem, self.archive()
        kept = self.left - self.left // rounds
        population = min(population_of(self.table.evaluations, self.table.population), max(self.left // rounds // 2, 4))
        better = correction(archive)
        first = archive.units[leading(better.objectives * problem.signs, better, population)]
        if len(first) < 4 or self.left == kept:
            return
        search = Search(problem.variables, problem.signs, len(problem.constraints), first, self.table.seed + rounds)

        def judgement(rows: IntArray) -> Judged:
            return correction.at(rows, np.array([self._units[row] for row in rows]), self.judged_at(rows))

        single = len(problem.signs) == 1
        generation, _ = self._evolve(
            search, int(archive.generation[-1]) + 1, kept + single * (self.left - kept) // 2, judgement
        )
        if single:
            self._polish(generation, judgement, kept)

    def _polish(self, generation: int, judgement: Callable[[IntArray], Judged], kept: int = 0) -> float:
        """Refine the best candidate of a single objective; return the step at which none around it is better, or NaN.

        Args:
            judgement: How candidates are judged, by their rows.
            kept: Number of candidates that are left for later.
        """
        judged = judgement(np.arange(len(self._units)))
        front = front_rows(judged.objectives * self.problem.signs, judged.feasible)
        if not front.size:
            return np.nan
        whole = np.isfinite(judged.objectives[:, 0])
        aims = judged.objectives[whole, 0] * self.problem.signs[0]
        worst, scale = float(aims.max()), float(np.abs(aims).max()) or 1.0
        best, radius = int(front[0]), WIDEST
        values: dict[int, float] = {}

        def tried(units: FloatArray) -> Judged:
            rows = self.try_out(units, generation) if self.left > kept else self._known(units)
            if (rows < 0).any():
                raise _NoneLeftError
            new = judgement(rows)
            aims = np.where(new.feasible, new.objectives[:, 0] * self.problem.signs[0], np.inf)
            values.update(zip(rows.tolist(), aims.tolist(), strict=True))
            return new

        def judge(unit: FloatArray) -> tuple[float, FloatArray]:
            one = tried(unit[None])
            value, limits = float(one.objectives[0, 0] * self.problem.signs[0]), one.violations[0]
            if not np.isfinite([value, *limits]).all():
                return worst / scale, np.append(np.zeros(limits.size), FAILED + one.failed[0])
            return value / scale, np.append(limits, -1.0)

        try:
            tried(self._units[best][None])
            while True:
                generation += 1
                refine(self.problem.variables, self._units[best], radius, judge, self.left - kept)
                best = min(values, key=lambda row: values[row])
                steps = [unit for _, unit in steps_around(self.problem.variables, self._units[best], NARROWEST)]
                if steps:
                    tried(self.problem.variables.snapped(np.array(steps)))
                better = min(values, key=lambda row: values[row])
                if values[better] >= values[best]:
                    return NARROWEST
                best, radius = better, WIDEST / 4
        except _NoneLeftError:
            return np.nan

    def solved(self, polished: float) -> Solved:
        """The front, confirmed by the requested model and by another sample."""
        problem, archive = self.problem, self.archive()
        aims = archive.judged.objectives * problem.signs
        rows = front_rows(aims, archive.judged.feasible)
        if problem.confirm == problem.model and not self.sample:
            front, start = archive.take(rows), archive.judged.take(np.array([0]))
            return Solved(archive, front, front.judged, start, 0, polished=polished, ended=tuple(self.ended))
        self._stages.begin(
            "confirmation", f"the best candidates once more{f' by {problem.confirm}' * bool(problem.confirm)}"
        )
        sample = problem.confirming_sample
        first, *batches = confirmation_batches(self.table.confirmed, len(problem.signs))
        chosen = first_confirmed(archive, problem.signs, first, problem.confirm != problem.model)
        fine = self.judge(archive.units[chosen], sample, problem.confirm) if chosen.size else None
        for at, count in enumerate(batches if fine else []):
            assert fine is not None
            correction = Correction.of(archive, chosen, fine)
            if self.left and problem.is_corrected:
                self._search_corrected(correction, len(batches) - at)
                archive = self.archive()
            new = next_confirmed(correction(archive), problem.signs, chosen, count)
            if not new.size:
                break
            chosen = np.concatenate([chosen, new])
            fine = Judged.joined([fine, self.judge(archive.units[new], sample, problem.confirm)])
        start = self.judge(archive.units[:1], sample, problem.confirm)
        if fine is None:
            front = archive.take(rows)
            return Solved(archive, front, front.judged, start, 0, polished=polished, ended=tuple(self.ended))
        confirmed = len(chosen)
        if 0 not in chosen:  # the start is judged anyway, and may be better than all of them
            chosen, fine = np.append(chosen, 0), Judged.joined([fine, start])
        order = front_rows(fine.objectives * problem.signs, fine.feasible)
        front = Archive(archive.units[chosen[order]], fine.take(order), archive.generation[chosen[order]])
        nearest = fine.nearest()
        return Solved(
            archive,
            front,
            archive.judged.take(chosen[order]),
            start,
            confirmed,
            polished=polished,
            ended=tuple(self.ended),
            nearest=None if nearest is None else (archive.units[chosen[nearest]], fine.reasons[nearest]),
        )

    def around(self, front: Archive) -> Neighbours | None:
        """The neighbours of the ends and the knee of a front, as the search judges them; None for an empty front."""
        if not len(front.units):
            return None
        self._stages.begin("sensitivity", "candidates one step away from the ends of the front")
        places = places_of(front.judged.objectives * self.problem.signs, list(self.problem.objectives))
        centres, centre, variable, units = around(front, list(places.values()), self.problem.variables)
        judged = self.judge(np.concatenate([front.units[centres], units]), self.sample, self.problem.model)
        at_centre, beside = (
            judged.take(np.arange(centres.size)),
            judged.take(np.arange(centres.size, len(judged.reasons))),
        )
        return Neighbours(centres, centre, variable, units, beside, at_centre)


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
            run = _Run(problem, study, points, progress, stages)
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


def _thinned(course: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """At most `_MOST_GENERATIONS` generations, including the first and the last."""
    rows = np.unique(np.linspace(0, len(course) - 1, min(len(course), _MOST_GENERATIONS)).round().astype(int))
    return [course[row] for row in rows.tolist()]


def _nominal(problem: Problem) -> Sample:
    """The joint without scatter, as a sample of one: variables as chosen, other parameters in the middle."""
    sample = problem.scatter.sample(1024, 0)
    relative = problem.scatter.relative
    return {
        name: np.zeros(1) if name in relative else np.median(column, keepdims=True) for name, column in sample.items()
    }
