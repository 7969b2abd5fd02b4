"""What a study will cost before anything runs: points, blocks, CPU-hours with a spread, bytes."""

from __future__ import annotations

import math
import multiprocessing
import queue
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tripod_doe.quantities import duration, size
from tripod_doe.study.definition import Study, load_study, parse_study
from tripod_doe.study.designs import Points, make_points, point_keys
from tripod_doe.study.task import make_task, run_task

__all__ = ["Plan", "cube_bytes", "plan"]

_TIMING_SECONDS = 10.0
_SAMPLES = 12
_BATCH_SECONDS = 0.2
_BLOCK_SECONDS = 1.0


@dataclass(frozen=True)
class Plan:
    """Counts and prices of a study.

    Attributes
    ----------
    points
        Points of the design, repeated and excluded ones included.
    unique
        Points to compute: repeated ones are computed once.
    excluded
        Cells that a constraint leaves out.
    blocks
        Tasks of about a second each; None without timing.
    cpu_hours
        Lower quartile, mean and upper quartile of the total; None without timing.
    cube_bytes
        Size of the cube, where the outputs' shapes are known beforehand.
    timed
        Points that were timed.
    chosen
        Whether a pilot chooses the models, so that nothing can be timed before it has run.
    warnings
        What the user should know.
    """

    points: int
    unique: int
    excluded: int
    blocks: int | None
    cpu_hours: tuple[float, float, float] | None
    cube_bytes: int | None
    timed: int
    chosen: bool
    warnings: tuple[str, ...]

    def describe(self, workers: int = 2) -> str:
        """The plan as text, with the wall time on so many workers."""
        lines = [f"points       {self.points:,}"]
        if self.unique + self.excluded != self.points:
            lines[0] += f" ({self.points - self.unique - self.excluded:,} of them repeated and computed once)"
        if self.excluded:
            lines.append(f"excluded     {self.excluded:,} by constraints")
        if self.cpu_hours is None and self.chosen:
            lines.append("price        follows from the choice of model")
        elif self.cpu_hours is None:
            lines.append("price        not timed" if self.timed == 0 else "price        no point ended within 10 s")
        else:
            low, mean, high = (duration(hours * 3600) for hours in self.cpu_hours)
            lines.append(f"blocks       {self.blocks:,} of about a second")
            lines.append(f"CPU time     {mean} ({low} to {high}, from {self.timed} timed points)")
            lines.append(f"wall time    {duration(self.cpu_hours[1] * 3600 / workers)} on {workers} workers")
        if self.cube_bytes is not None:
            lines.append(f"cube         {size(self.cube_bytes)}")
        return "\n".join(lines + [f"warning      {text}" for text in self.warnings])


def plan(study: Study | str | Path, timing: bool = True) -> Plan:
    """Count the points of a study and time a few of them, for at most ten seconds.

    Parameters
    ----------
    study
        What is planned: a study or its file. Nothing is written and no cluster is started.
    timing
        Whether to time points, in a process of its own.
    """
    if not isinstance(study, Study):
        study = load_study(study)
    points = make_points(study)
    unique = np.unique(point_keys(study, points)[points.allowed]).size
    seconds = _time_points(study, points) if timing and study.accuracy is None else []
    hours, blocks = None, None
    if seconds:
        total = unique / 3600
        hours = (
            float(np.quantile(seconds, 0.25)) * total,
            float(np.mean(seconds)) * total,
            float(np.quantile(seconds, 0.75)) * total,
        )
        blocks = max(1, round(hours[1] * 3600 / _BLOCK_SECONDS))
    return Plan(
        points.count,
        unique,
        int((~points.allowed).sum()),
        blocks,
        hours,
        cube_bytes(study, points),
        len(seconds),
        study.accuracy is not None,
        study.warnings,
    )


def cube_bytes(study: Study, points: Points) -> int | None:
    """Size of outcome and outputs in the cube, texts left out; a function's outputs are not known beforehand."""
    if not study.simulator.outputs:
        return None
    first = {name: column[:1].tolist()[0] for name, column in points.columns.items()}
    values = study.simulator.effective({**study.base, **first})  # lengths that differ between points are refused
    numbers = sum(math.prod(study.simulator.outputs[name].shape(values)) for name in study.keep)
    return points.count * (8 * numbers + 1)


def _time_points(study: Study, points: Points) -> list[float]:
    """Seconds a point, for points spread over the design, measured in a process that can be stopped in time."""
    context = multiprocessing.get_context("spawn")
    answers: Any = context.Queue()
    arguments = (study.text, study.origin, study.folder, answers)
    process = context.Process(target=_timing_process, args=arguments, daemon=True)
    process.start()
    seconds: list[float] = []
    deadline = time.monotonic() + _TIMING_SECONDS
    while (left := deadline - time.monotonic()) > 0:
        try:
            answer = answers.get(timeout=min(left, 0.2))
        except queue.Empty:
            if not process.is_alive():
                break
            continue
        if answer is None:
            break
        seconds.append(answer)
    process.kill()
    process.join()
    return seconds


def _timing_process(text: str, origin: str, folder: Any, answers: Any) -> None:
    study = parse_study(text, origin, folder)
    points = make_points(study)
    allowed = np.flatnonzero(points.allowed)
    columns = {name: column[allowed] for name, column in points.columns.items()}
    study.simulator.prepare(study.simulator.columns(study.base, columns, allowed.size))
    run_task(make_task(study, points, allowed[:1]))  # the first call of a process is no measure
    random, batch = np.random.default_rng(0), 1
    for _ in range(_SAMPLES):
        chosen = random.choice(allowed, min(batch, allowed.size), replace=False)
        seconds = run_task(make_task(study, points, chosen))[1] / chosen.size
        wanted = int(np.clip(_BATCH_SECONDS / max(seconds, 1e-6), 1, min(allowed.size, 10_000)))
        if 2 * batch >= wanted:  # smaller batches are mostly overhead, and no measure of a block
            answers.put(seconds)
        batch = wanted
    answers.put(None)
