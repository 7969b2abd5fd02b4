"""How far a run is: one journal for a study; for a workflow those of its studies, and the states of its steps."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tripod_doe.names import path_within
from tripod_doe.service.progress import PointCounts, Progress
from tripod_doe.service.runs import Run
from tripod_doe.workflow.steps_file import STEPS

_PACE = 0.5  # seconds between two counts: each goes to all who watch


class RunProgress:
    """The points of a run, counted as they are finished, and the pace at which they are.

    Parameters
    ----------
    run
        The run.
    directory
        Its result directory.
    """

    def __init__(self, run: Run, directory: Path) -> None:
        self._steps = directory / STEPS
        self._kind, self._plan = run.kind, run.plan
        self._journals = _journals(run, directory)
        self._first: tuple[float, int] | None = None
        self._read_at = -math.inf

    def is_due(self) -> bool:
        """Whether the points were not counted of late."""
        return time.monotonic() > self._read_at + _PACE

    def read(self) -> tuple[PointCounts, tuple[Mapping[str, Any], ...]]:
        """Points, and the steps of a workflow, as they are now."""
        self._read_at = time.monotonic()
        counts = _sum([journal.read() for journal in self._journals])
        if self._first is None:
            self._first = time.monotonic(), counts.total - counts.missing
        return counts, self._read_steps() if self._kind == "workflow" else ()

    def eta_seconds(self, counts: PointCounts) -> float | None:
        """Seconds until the last point, by the pace since the first look; None as long as there is none."""
        if self._first is None:
            return None
        started, before = self._first
        done = counts.total - counts.missing - before
        return (time.monotonic() - started) * counts.missing / done if done > 0 else None

    def _read_steps(self) -> tuple[Mapping[str, Any], ...]:
        """What the chain said of its steps, the others as waiting, in the order in which they run."""
        try:
            told = {step["name"]: step for step in json.loads(self._steps.read_text(encoding="utf-8"))}
        except (OSError, ValueError):
            told = {}
        waiting = {"state": "waiting", "seconds": None, "detail": ""}
        return tuple(
            {"name": name, "kind": step["kind"], "inputs": step["inputs"]} | waiting | told.get(name, {})
            for name, step in self._plan["steps"].items()
        )


def _journals(run: Run, directory: Path) -> list[Progress]:
    if run.kind != "workflow":
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
        sum(count.total for count in counts),
        sum(count.finished for count in counts),
        sum(count.failed for count in counts),
        dict(outcomes),
        sum(count.cpu_seconds for count in counts),
    )
