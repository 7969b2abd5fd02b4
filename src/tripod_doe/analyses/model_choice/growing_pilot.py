"""The pilot of a study with model = "auto", run in stages until it suffices for a choice.

Without a record of errors it starts with the cheapest candidate and the full model. A candidate between the two is
added if it could save more than it costs. Where errors on record suggest a choice (`choice_by_record`), it starts with
the middle of the design, which shows how fine the full model must be, and grows by doubling until the choice is
confirmed, or cannot be any more; then it goes on as one without a record.

In both, a full model of smaller numerical error is added where the error of the full model exceeds the accuracy at more
points than the confidence allows. Each time the pilot is the same study with more points, so no point runs twice.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.model_choice.choice_by_record import CONFIRMING, RecordedChoice
from tripod_doe.analyses.model_choice.pilot import pilot_points, pilot_study
from tripod_doe.analyses.model_choice.pilot_errors import PilotErrors, pilot_errors
from tripod_doe.analyses.model_choice.selection import choose
from tripod_doe.array_types import IntArray
from tripod_doe.model_interface import Candidate
from tripod_doe.study.definition.accuracy_table import AutoModel
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.result_directory.open_cube import open_cube
from tripod_doe.study.result_directory.stored_choice import auto_model_of

Runs = list[tuple[Candidate, IntArray]]
"""Candidates of a pilot, each with the points at which it runs."""


def first_candidates(auto: AutoModel) -> list[Candidate]:
    """First candidates of a pilot without a record: the cheapest candidate and the full model."""
    return [
        auto.candidates[0],
        next((candidate for candidate in auto.candidates[1:] if candidate.full), auto.candidates[-1]),
    ]


def confirming_sizes(study: Study, points: Points, record: RecordedChoice | None) -> list[int]:
    """Sizes of the pilots that could confirm a choice by record; the first only shows how fine the full model must be.

    Empty where none could: they must be smaller than the pilot without a record, and than half of the study. Empty,
    too, where the full model would then run at more points than in the pilot without a record, which may find better.
    """
    if record is None:
        return []
    most = pilot_points(study, points).size or int(points.allowed.sum()) // 2 + 1
    if CONFIRMING + (~record.cheap).sum() > most:
        return []
    sizes, confidence = [1], auto_model_of(study).confidence
    while max(CONFIRMING, 2 * sizes[-1]) < most:
        sizes.append(max(CONFIRMING, 2 * sizes[-1]))
    return sizes if record.expected(sizes[-1], sizes[-1]) >= confidence and len(sizes) > 1 else []


@dataclass(frozen=True)
class GrowingPilot:
    """A pilot of a study."""

    # study, points: A study with model = "auto"
    study: Study
    points: Points
    usable: dict[str, NDArray[Any]]  # factors of its points that may run, each of shape (point,)
    directory: Path  # where the pilot lies
    run: Callable[[Study, Path], object]  # runs what is missing of a pilot in a directory

    def choose(self, record: RecordedChoice | None) -> xr.Dataset | None:
        """Run as much of the pilot as a choice needs, and choose; None where a study is too small for a pilot.

        Args:
            record: What errors on record suggest.
        """
        places, runs = pilot_points(self.study, self.points), Runs()
        if record and (sizes := confirming_sizes(self.study, self.points, record)):
            choice, runs = self._confirm(record, sizes)
            if choice is not None:
                return choice
        return self._select(runs, places) if places.size else None

    def errors_so_far(self) -> PilotErrors:
        """The errors that the pilot has measured so far."""
        return pilot_errors(open_cube(self.directory), list(self.usable), auto_model_of(self.study))

    def confirmed(self, record: RecordedChoice, measured: PilotErrors) -> xr.Dataset | None:
        """The choice by record, if the requested number of points is expected to be within the accuracy."""
        record = record.among(measured.candidates)
        if not record.cheap.any():
            return None
        hits, known = record.hits(measured, self._allowed_places(measured))
        share = record.expected(hits, known)
        if known < CONFIRMING or share < auto_model_of(self.study).confidence:
            return None
        return record.labelled(measured, self.usable, self.study, share)

    def _confirm(self, record: RecordedChoice, sizes: list[int]) -> tuple[xr.Dataset | None, Runs]:
        """Let the pilot grow until it confirms a choice by record, or cannot; with what it ran."""
        runs = Runs()
        for size in sizes:
            places = pilot_points(self.study, self.points, size)
            runs = [(each, places) for each in record.chosen] + self._full_runs(runs, places)
            measured = self._as_fine_as_needed(runs, places)
            if size < CONFIRMING:
                continue
            if (choice := self.confirmed(record, measured)) is not None:
                return choice, runs
            hits, known = record.hits(measured, self._allowed_places(measured))
            more = sizes[-1] - size
            if record.expected(hits + more, known + more) < auto_model_of(self.study).confidence:
                break
        return None, runs

    def _select(self, ran: Runs, places: IntArray) -> xr.Dataset:
        """Run the whole pilot, extend it as long as that could pay, and select by its errors alone."""
        auto = auto_model_of(self.study)
        cheap = [each for each, _ in ran if not each.full and each != auto.candidates[0]]
        runs = [(each, places) for each in (auto.candidates[0], *cheap)] + self._full_runs(ran, places)
        while True:
            measured = self._as_fine_as_needed(runs, places)
            choice = choose(measured, self.usable, auto)
            between = _candidate_between(measured, choice, auto, [candidate for candidate, _ in runs])
            if between is None:
                return choice
            runs.append((between, places))

    def _full_runs(self, ran: Runs, places: IntArray) -> Runs:
        """What full candidates ran, and at the other places the one that ran at most, of equals the finest."""
        full = [each for each in ran if each[0].full]
        sizes = [sum(at.size for other, at in full if other == each) for each, _ in full]
        finest_first = [each for each, _ in full[::-1]]
        usual = finest_first[int(np.argmax(sizes[::-1]))] if full else first_candidates(auto_model_of(self.study))[-1]
        new = np.setdiff1d(places, np.concatenate([np.array([], np.int64), *(at for _, at in full)]))
        return [*full, (usual, new)] if new.size else full

    def _as_fine_as_needed(self, runs: Runs, places: IntArray) -> PilotErrors:
        """Run a pilot, with finer full candidates at those `places` where that needs be; they are added to `runs`."""
        given = {name: column[places] for name, column in self.points.columns.items()}
        while True:
            self.run(pilot_study(self.study, self.points, runs), self.directory)
            measured = self.errors_so_far()
            rows = np.flatnonzero(measured.known)
            sure = {_values(measured.columns, int(row)) for row in rows}
            unsure = np.array([at for row, at in enumerate(places) if _values(given, row) not in sure], np.int64)
            finer = _finer_candidate(measured, auto_model_of(self.study))
            if finer is None or not unsure.size:
                return measured
            runs.append((finer, unsure))

    def _allowed_places(self, measured: PilotErrors) -> IntArray:
        """Positions of the pilot's points among those of the study that may run."""
        known = [
            dict(zip(measured.columns, _values(measured.columns, row), strict=True)) for row in range(measured.count)
        ]
        same = (np.all([self.usable[name] == value for name, value in point.items()], axis=0) for point in known)
        return np.array([np.flatnonzero(each)[0] for each in same])


def _finer_candidate(measured: PilotErrors, auto: AutoModel) -> Candidate | None:
    """A finer candidate than all that ran; None if these are accurate at enough points, or none is finer."""
    finer = auto.candidates[auto.candidates.index(measured.candidates[-1]) + 1 :]
    return finer[0] if finer and 1 - measured.known.mean() > 1 - auto.confidence else None


def _candidate_between(
    measured: PilotErrors, choice: xr.Dataset, auto: AutoModel, tried: list[Candidate]
) -> Candidate | None:
    """A candidate that the pilot should run besides, since it could save more than it costs; None if there is none."""
    paid = measured.prices[choice["candidate"].values]
    for candidate in auto.candidates[: auto.candidates.index(measured.candidates[-1])]:
        saving = float(np.maximum(paid - candidate.price, 0).sum())
        if candidate not in tried and saving > candidate.price * measured.count:
            return candidate
    return None


def _values(columns: Mapping[str, NDArray[Any]], row: int) -> tuple[Any, ...]:
    """A point by the values of its factors."""
    return tuple(column[row : row + 1].tolist()[0] for column in columns.values())
