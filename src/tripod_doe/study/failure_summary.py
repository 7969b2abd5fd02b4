"""Failed points grouped by outcome and reason, with their counts and a remedy."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tripod_doe.errors import option
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.slabs import box, slabs

if TYPE_CHECKING:  # for their names only
    import xarray as xr

    from tripod_doe.study.study_points import StudyPoints

_SHOWN = 3
_SLAB_BYTES, _END_BYTES = 32_000_000, 100  # of the ends that are read together, and of one of them

_NUMBER = re.compile(r"-?\d+\.?\d*(e[+-]?\d+)?")
_CHANCE = {Outcome.WORKER_LOST, Outcome.TIME_LIMIT, Outcome.ERROR}
"""Outcomes that may change when the same point runs again: they depend on the machine, or on a function's source."""
_NUMERICS = {Outcome.DIVERGED, Outcome.INACCURATE, Outcome.STEP_LIMIT}


@dataclass(frozen=True)
class Failure:
    """Points that failed in the same way."""

    outcome: Outcome  # their outcome
    reason: str  # their reason; the first one where reasons differ in numbers only
    count: int  # their number

    def __str__(self) -> str:
        points = "1 point" if self.count == 1 else f"{self.count:,} points"
        return f"{points} ended as {self.outcome.label}" + (f": {self.reason}" if self.reason else "")


def common_failures(ends: Iterable[tuple[int, str]], good: Collection[int] = (Outcome.FINISHED,)) -> list[Failure]:
    """Group points by outcome and reason, the most frequent first.

    Args:
        ends: Outcome and detail of every point.
    """
    counts: Counter[tuple[int, str]] = Counter()
    first: dict[tuple[int, str], str] = {}
    for (outcome, detail), count in Counter((int(o), d) for o, d in ends if int(o) not in good).items():
        kind = outcome, _NUMBER.sub("0", detail)
        counts[kind] += count
        first.setdefault(kind, detail)
    return [Failure(Outcome(kind[0]), first[kind], count) for kind, count in counts.most_common()]


def failures_in(cube: xr.Dataset, asked: StudyPoints) -> list[Failure]:
    """Points of a cube whose outcome is not good, grouped by outcome and reason, the most frequent first."""
    return common_failures(_bad_ends(cube["outcome"].variable, cube["outcome_detail"].variable, asked))


def _bad_ends(outcome: xr.Variable, detail: xr.Variable, asked: StudyPoints) -> Iterator[tuple[int, str]]:
    """Outcomes and reasons of the points that did not end well."""
    for slab in slabs(outcome.shape, box(outcome.shape, _END_BYTES, _SLAB_BYTES)):
        ends = outcome[slab.place].values.ravel()
        bad = ~np.isin(ends, list(asked.good_outcomes)) & asked.points.allowed[slab.start : slab.stop]
        if bad.any():
            reasons = detail[slab.place].values.ravel()[bad]
            yield from zip(ends[bad].tolist(), reasons.tolist(), strict=True)


def failure_lines(failures: Sequence[Failure], retried: bool = False) -> list[str]:
    """The most frequent failures, one per line, then remedies.

    Args:
        retried: Whether the study has retries.
    """
    lines = [str(failure) for failure in failures[:_SHOWN]]
    if left := sum(failure.count for failure in failures[_SHOWN:]):
        lines.append(f"{left:,} more failed for other reasons: see outcome_detail in the cube")
    return lines + _advice({failure.outcome for failure in failures}, retried)


def _advice(outcomes: set[Outcome], retried: bool) -> list[str]:
    """Remedies for outcomes; they include running again only if the outcome may change."""
    remedies = []
    if again := sorted(outcome.label for outcome in outcomes & _CHANCE):
        remedies.append(
            f"{option('retry_failed', True)} runs failed points again: {' and '.join(again)} may then end differently"
        )
    if outcomes & _NUMERICS and not retried:
        remedies.append(
            '[run] retry = ["smaller-step"] in the study file tries smaller steps or tolerances, in another directory'
        )
    if Outcome.EVALUATION_LIMIT in outcomes:
        remedies.append("evaluation_budget in the study file sets the limit of evaluation_limit, in another directory")
    return remedies
