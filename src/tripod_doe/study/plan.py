"""Plan of a study before anything runs: points, blocks, CPU-hours with a spread, bytes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.number_text import duration, size, text_range
from tripod_doe.study.cube.model_records import model_records
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import Points, make_points, most_points, point_bytes
from tripod_doe.study.execution.timing import time_points
from tripod_doe.study.failure_summary import Failure, common_failures
from tripod_doe.study.study_points import StudyPoints

RECORDED = "recorded on another machine for usual points; others may cost twenty times as much"
"""Source of a cost without timing."""

_TIMING_SECONDS = 10.0
_BLOCK_SECONDS = 1.0
_PRICED = 100  # points whose recorded costs are averaged
_CHUNK = 10_000  # points that are checked together
_WORD, _COSTS = 4, 6  # bytes of a whole number, a text or the number of a point; numbers of a point in cost.nc
_MOST_CHECKED = 200_000  # points that are checked one by one; of more, a sample
_OF_MANY = "models and failures are judged by {:,} points drawn at random; repeated points are not detected"
_NOTABLE_BYTES = 100_000_000  # least memory that a plan states


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Counts and prices of a study."""

    points: int  # points of the design, repeated and excluded ones included
    unique: int  # points to compute: repeated ones count once
    excluded: int  # cells that a constraint excludes
    blocks: int | None  # tasks, estimated; None without a price
    # lower quartile, mean and upper quartile of the total; None without a price
    cpu_hours: tuple[float, float, float] | None
    cube_bytes: int | None  # size of the cube, where the outputs' shapes are known beforehand
    timed: int  # timed batches of points; 0 where the price is recorded or unknown
    chosen: bool  # whether a pilot chooses the models: no point can be timed before
    warnings: tuple[str, ...]  # warnings of the study, and ranges of the models that points leave
    # points that are known to fail before anything is solved, by outcome and reason
    foreseen: tuple[Failure, ...] = ()
    models: tuple[str, ...] = ()  # the models of the points, with the errors known for them
    design: tuple[str, ...] = ()  # notes on the design
    memory_bytes: int = 0  # memory for the list of points, without results
    # size of cube and costs before compression; None where the size of the cube is not known
    written_bytes: int | None = None
    most_points: int = 0  # upper limit of points with a pilot, including its own; 0 if the number is known
    confirming: int = 0  # upper limit of points beyond these, which confirm what an analysis proposes

    @property
    def most(self) -> int:
        """The most points that can run."""
        return max(self.points, self.most_points) + self.confirming

    @property
    def able(self) -> int:
        """Number of points to compute that are not known to fail."""
        return self.unique - sum(failure.count for failure in self.foreseen)

    def describe(self, workers: int = 2) -> str:
        """The plan as text, with the wall time on a number of workers."""
        lines = [f"points       {self.points:,}"]
        if self.unique + self.excluded != self.points:
            lines[0] += f" ({self.points - self.unique - self.excluded:,} of them repeated and computed once)"
        if self.most_points:
            lines[0] += (
                f" of a pilot, then at most {self.most_points:,} in all; the price below is the price of the pilot"
            )
        if self.excluded:
            lines.append(f"excluded     {self.excluded:,} by constraints")
        lines += [f"{f.outcome.label:12} {f.count:,} of {self.unique:,}: {f.reason}" for f in self.foreseen]
        if not self.able:
            lines.append("price        none: no point can be run")
        elif self.cpu_hours is None and self.chosen:
            lines.append("price        known after the choice of model")
        elif self.cpu_hours is None:
            lines.append("price        not known: nothing was timed")
        else:
            low, mean, high = (duration(hours * 3600) for hours in self.cpu_hours)
            source = f"{text_range(low, high)}, from {self.timed} timed points" if self.timed else RECORDED
            lines.append(f"blocks       about {self.blocks:,}")
            lines.append(f"CPU time     {mean} ({source})")
            busy = min(workers, self.blocks or 1)
            lines.append(f"wall time    {duration(self.cpu_hours[1] * 3600 / busy)} on {workers} workers")
        if self.memory_bytes > _NOTABLE_BYTES:
            lines.append(f"memory       {size(self.memory_bytes)} for the list of points")
        if self.cube_bytes is not None:
            whole = f", {size(self.written_bytes)} with factors and costs" if self.written_bytes else ""
            lines.append(f"cube         {size(self.cube_bytes)} of results{whole}, before compression")
        if self.confirming:
            what = "where a tolerance analysis proposes a change"
            lines.append(f"confirmation at most {self.confirming:,} points beyond these, {what}")
        lines += [f"design       {text}" for text in self.design]
        lines += [f"{text.split()[0].lower():12} {text.split(maxsplit=1)[1]}" for text in self.models]
        return "\n".join(lines + [f"warning      {text}" for text in self.warnings])


def plan(
    study: Study | Mapping[str, Any] | str | Path,
    timing: bool = True,
    recorded: bool = False,
    among: IntArray | None = None,
) -> Plan:
    """Count the points of a study and time a few of them, for at most ten seconds.

    Args:
        study: A study, its file or its tables as a dict. Nothing is written and no cluster is started.
        timing: Whether to time points, in a process of its own.
        recorded: Whether recorded prices are used where nothing is timed.
        among: The points to compute; None for all of them.
    """
    study = study if isinstance(study, Study) else load_study(study)
    return plan_points(study, make_points(study), timing, recorded, among)


def plan_points(
    study: Study, points: Points, timing: bool, recorded: bool, among: IntArray | None = None, judged: bool = True
) -> Plan:
    """Plan a study whose points are known; see `plan`. Not `judged`: without verdicts on models, most of its time."""
    excluded = int((~points.allowed).sum())
    if among is not None:
        wanted = np.zeros(points.count, bool)
        wanted[among] = True
        points = replace(points, allowed=points.allowed & wanted)
    checked, able = points, points.allowed.copy()
    if many := points.count > _MOST_CHECKED:
        checked = points.chosen_rows(np.unique(np.random.default_rng(0).integers(0, points.count, _MOST_CHECKED)))
        unique, able = int(points.allowed.sum()), checked.allowed.copy()
    else:
        able = StudyPoints(study, points).to_compute
        unique = int(able.sum())
    looked_at = int(able.sum())
    foreseen = common_failures(_known_failures(study, checked, able))
    share = unique / max(looked_at, 1)
    foreseen = [replace(each, count=round(each.count * share)) for each in foreseen] if many else foreseen
    count = unique - sum(each.count for each in foreseen)
    timed, prices = 0, np.array([])
    if count and study.auto_model is None and (timing or recorded):
        seconds = time_points(study, _TIMING_SECONDS) if timing else []
        timed, prices = len(seconds), np.array(seconds) if seconds else _recorded_prices(study, checked, able)
    hours = _cpu_hours(prices, count) if prices.size else None
    models = model_records(study, checked, able if judged else np.zeros_like(able))
    return Plan(
        points=points.count,
        unique=unique,
        excluded=excluded,
        blocks=_blocks(study.file.run.block, count, hours[1] * 3600) if hours else None,
        cpu_hours=hours,
        cube_bytes=cube_bytes(study, points),
        timed=timed,
        chosen=study.auto_model is not None,
        warnings=(*study.warnings, *models.warnings),
        foreseen=tuple(foreseen),
        models=(*models.verdict, *models.error_sentences),
        design=(*points.notes, *([_OF_MANY.format(looked_at)] if many else [])),
        memory_bytes=points.count * point_bytes(study),
        written_bytes=_written_bytes(study, points),
        most_points=most_points(study),
    )


def _cpu_hours(prices: FloatArray, count: int) -> tuple[float, float, float]:
    """CPU-hours of points by the lower quartile, mean and upper quartile of their prices in seconds."""
    mean, (low, high) = prices.mean(), np.quantile(prices, (0.25, 0.75))
    low, high = min(low, mean), max(high, mean)  # a few expensive points raise the mean above most costs
    return float(low * count / 3600), float(mean * count / 3600), float(high * count / 3600)


def _blocks(fixed: int | None, points: int, seconds: float) -> int:
    """Number of tasks: of `fixed` points each if given, else of about a second, and of one point at least."""
    return -(-points // fixed) if fixed else min(points, max(1, round(seconds / _BLOCK_SECONDS)))


def _known_failures(study: Study, points: Points, able: NDArray[np.bool_]) -> Iterator[tuple[int, str]]:
    """Outcome and reason of each point that is known to fail; `able`, shape (point,), is cleared there."""
    if study.auto_model:  # a pilot sets the deciding parameters
        return
    for start in range(0, points.count, _CHUNK):
        chosen = start + np.flatnonzero(able[start : start + _CHUNK])
        if not chosen.size:
            continue
        columns = study.simulator.columns(study.base, points.at(chosen), chosen.size)
        for row, outcome, reason in study.simulator.foreseen(columns):
            able[chosen[row]] = False
            yield outcome, reason


def _recorded_prices(study: Study, points: Points, able: NDArray[np.bool_]) -> FloatArray:
    """Recorded CPU seconds of points spread over the design; none if a point has no recorded cost."""
    rows = np.flatnonzero(able)
    rows = rows[np.unique(np.linspace(0, rows.size - 1, _PRICED).astype(int))]
    prices = [study.simulator.recorded_price({**study.base, **points.settings_of(row)}) for row in rows.tolist()]
    return np.array([price for price in prices if price is not None] if None not in prices else [])


def unshown_bytes(study: Study, points: Points) -> int:
    """Bytes in the journal of outputs that only formulas need."""
    values = study.simulator.effective({**study.base, **points.settings_of(0)})
    outputs, beside = study.simulator.outputs, set(study.stored).difference(study.keep)
    return points.count * sum(8 * math.prod(outputs[name].shape(values)) for name in beside & outputs.keys())


def cube_bytes(study: Study, points: Points) -> int | None:
    """Size of outcome and outputs in the cube, texts left out; a function's outputs are not known beforehand."""
    if not study.simulator.outputs:
        return None
    values = study.simulator.effective({**study.base, **points.settings_of(0)})  # all points have the same lengths
    numbers = sum(math.prod(study.simulator.outputs[name].shape(values)) for name in study.keep)
    numbers += sum(response.size for response in study.responses)
    return points.count * (8 * numbers + 1)


def _written_bytes(study: Study, points: Points) -> int | None:
    """Size of all numbers in cube and costs, without parameters that runs choose or retries change.

    A text counts as the number of its row in a table, as in large cubes.
    """
    if (results := cube_bytes(study, points)) is None:
        return None
    design = 0
    if not points.is_grid:  # the levels of a grid are negligible
        design = _WORD + sum(map(_stored_bytes, (*points.columns.values(), *points.labels.values())))
    cube, cost = design + _WORD, design + _WORD + _COSTS * 8  # with outcome_detail, and with worker
    if study.auto_model is None and study.simulator.model_errors(StudyPoints(study, points).columns(np.arange(1))):
        cube += 2 * 8 + 1  # the error to expect, its limit, and the verdict
    if study.retry.changes:
        cube += 2 + _WORD  # attempt, first_outcome and its detail
    return results + points.count * (cube + cost + points.has_excluded)


def _stored_bytes(column: NDArray[Any]) -> int:
    """Bytes of a value of a factor or label in a file, as `cube` writes them."""
    if column.dtype == np.bool_:
        return 1
    return _WORD if column.dtype.kind in "OUi" else column.dtype.itemsize
