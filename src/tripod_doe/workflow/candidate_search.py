"""The search of an optimisation as it runs: candidates tried, judged, confirmed and refined, and its progress."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tripod_doe.analyses.optimisation.confirmation import confirmation_batches, first_confirmed, next_confirmed
from tripod_doe.analyses.optimisation.correction import Correction
from tripod_doe.analyses.optimisation.measures import Ends, Judged
from tripod_doe.analyses.optimisation.neighbours import Neighbours, around
from tripod_doe.analyses.optimisation.pareto_front import Archive, front_rows, places_of
from tripod_doe.analyses.optimisation.problem import Problem, Sample
from tripod_doe.analyses.optimisation.result import Solved
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
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.definition.study import Study
from tripod_doe.workflow.point_batches import PointBatches
from tripod_doe.workflow.steps_file import Stages

_EVERY = 5.0  # seconds between lines of progress
_MOST_GENERATIONS = 30  # generations written for programs that watch the run


class _NoneLeftError(Exception):
    """No candidate is left to try."""


class CandidateSearch:
    """A running search over the candidates of a problem."""

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
        """Judge candidates; runs no point of one that cannot be."""
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


def _thinned(course: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """At most `_MOST_GENERATIONS` generations, including the first and the last."""
    rows = np.unique(np.linspace(0, len(course) - 1, min(len(course), _MOST_GENERATIONS)).round().astype(int))
    return [course[row] for row in rows.tolist()]
