"""Progress of a run: points by outcome and CPU seconds, from its journal or those of its steps; steps of a workflow."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from tripod_doe.errors import CubeError
from tripod_doe.model_interface import Outcome
from tripod_doe.names import path_within
from tripod_doe.service.problems import among_runs
from tripod_doe.service.runs.run_table import PointCounts, Run
from tripod_doe.study.journal import Journal, Mark, journal_path
from tripod_doe.workflow.steps_file import read_steps

_PACE = 0.5  # seconds between two counts: each count is sent to all watchers


class RunProgress:
    """Counts of a run's finished points, and their pace."""

    def __init__(self, run: Run, directory: Path) -> None:
        self._directory = directory
        self._kind, self._plan = run.kind, run.plan
        self._journals = _journals(run, directory)
        self._first: tuple[float, int] | None = None
        self._read_at = -math.inf

    def is_due(self) -> bool:
        """Whether the last count is old enough for a new one."""
        return time.monotonic() > self._read_at + _PACE

    def read(self) -> tuple[PointCounts, tuple[Mapping[str, Any], ...]]:
        """Current counts of points, and current steps of a workflow."""
        self._read_at = time.monotonic()
        counts = _sum([journal.read() for journal in self._journals])
        if self._first is None:
            self._first = time.monotonic(), counts.total - counts.missing
        return counts, () if self._kind == "study" else self._read_steps()

    def eta_seconds(self, counts: PointCounts) -> float | None:
        """Seconds until the last point, from the pace since the first count; None without a pace."""
        if self._first is None:
            return None
        started, before = self._first
        done = counts.total - counts.missing - before
        return (time.monotonic() - started) * counts.missing / done if done > 0 else None

    def _read_steps(self) -> tuple[Mapping[str, Any], ...]:
        """Records of steps and stages, in order, with paths in the directory; steps without a record are waiting."""
        stored = read_steps(self._directory)
        said = [step | {"detail": among_runs(str(step.get("detail", "")), self._directory)} for step in stored]
        if self._kind != "workflow":
            return tuple(said)
        by_name = {step["name"]: step for step in said}
        waiting = {"state": "waiting", "seconds": None, "detail": ""}
        return tuple(
            {"name": name, "kind": step["kind"], "inputs": step["inputs"]} | waiting | by_name.get(name, {})
            for name, step in self._plan["steps"].items()
        )


def _journals(run: Run, directory: Path) -> list[Progress]:
    if run.kind == "study":
        return [Progress(directory, run.plan["unique"], run.plan["expected_outcomes"])]
    return [
        Progress(path_within(directory, "steps", name), step["unique"], step["expected_outcomes"])
        for name, step in run.plan["steps"].items()
        if "unique" in step
    ]


def _sum(counts: Sequence[PointCounts]) -> PointCounts:
    outcomes: Counter[str] = Counter()
    for count in counts:
        outcomes.update(count.outcomes or {})
    return PointCounts(
        sum(max(count.total, count.finished + count.failed) for count in counts),
        sum(count.finished for count in counts),
        sum(count.failed for count in counts),
        dict(outcomes),
        sum(count.cpu_seconds for count in counts),
    )


class Progress:
    """The points of one result directory; reads only new entries of its journal.

    Args:
        expected: Outcomes that do not count as failures, besides finished.
    """

    def __init__(self, directory: Path, total: int, expected: Collection[str] = ()) -> None:
        self._directory, self._total = directory, total
        self._good = {"finished", *expected}
        self._mark = Mark()
        self._ends: dict[bytes, int] = {}
        self._counts: Counter[int] = Counter()
        self._cpu_seconds = 0.0

    def read(self) -> PointCounts:
        """Count the points now; if the journal is missing, busy or damaged, the last count stays."""
        if journal_path(self._directory).is_file():
            try:
                with Journal(self._directory, read_only=True) as journal:
                    self._add(journal)
                    self._total = max(self._total, journal.points())  # a plan counts the pilot of several models
            except CubeError:
                pass
        outcomes = {Outcome(number).label: count for number, count in self._counts.items() if count}
        good = sum(count for label, count in outcomes.items() if label in self._good)
        return PointCounts(self._total, good, sum(outcomes.values()) - good, outcomes, self._cpu_seconds)

    def _add(self, journal: Journal) -> None:
        again, news, self._mark = journal.news(self._mark)
        if again:
            self._ends, self._counts, self._cpu_seconds = {}, Counter(), 0.0
        for ends in news:
            for key, outcome in zip(ends.keys, ends.outcomes.tolist(), strict=True):
                fingerprint = key.tobytes()
                if (earlier := self._ends.get(fingerprint)) is not None:
                    self._counts[earlier] -= 1
                self._ends[fingerprint] = outcome
                self._counts[outcome] += 1
            self._cpu_seconds += ends.cpu_seconds
