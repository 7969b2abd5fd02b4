"""The pilot of a study with model = "auto": a few of its own points, each with several candidates, as a study.

A point with the parameters that were chosen for it is the same point in pilot and study, so no point runs twice. Only
points that finished are taken over: one that failed is the study's to run, with its own retries.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.encoding import in_unit_cube
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.model_interface import Candidate, Outcome
from tripod_doe.study.definition.accuracy_table import AutoModel
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.toml_text import toml_text
from tripod_doe.study.designs import Points
from tripod_doe.study.designs.ablation import HALF
from tripod_doe.study.execution.retry import untried
from tripod_doe.study.journal import PILOT, FinishedBlock, Journal, journal_path
from tripod_doe.study.study_points import StudyPoints


def finished_in_pilot(directory: Path) -> NDArray[np.void]:
    """Fingerprints of the points that finished in a pilot, shape (point,); empty without a pilot."""
    keys = [block.keys[block.result.outcome == Outcome.FINISHED] for block in _blocks(directory)]
    return np.concatenate([np.array([], "V16"), *keys])


def pilot_results(asked: StudyPoints, missing: IntArray, directory: Path) -> Iterator[FinishedBlock]:
    """Those of a study's missing points that its pilot finished, as blocks of the study.

    Args:
        asked: The study, with what was chosen for its points.
        missing: Indices of the points that are to be run, each different one once.
    """
    study = asked.study
    waiting = {asked.keys[index].tobytes(): int(index) for index in missing}
    for block in _blocks(directory):
        pairs = [
            (row, waiting.pop(key.tobytes()))
            for row, (key, outcome) in enumerate(zip(block.keys, block.result.outcome, strict=True))
            if outcome == Outcome.FINISHED and key.tobytes() in waiting
        ]
        if pairs:
            rows, indices = np.array(pairs).T
            part = block.result.take(rows, study.stored)
            result = untried(study.simulator, asked.columns(indices), part, study.retry)
            share = rows.size / block.keys.size
            yield FinishedBlock(block.keys[rows], result, block.cpu_seconds * share, block.wall_seconds * share, PILOT)


def _blocks(directory: Path) -> Iterator[FinishedBlock]:
    if journal_path(directory).exists():
        with Journal(directory, read_only=True) as journal:
            yield from journal.blocks()


_POINTS_A_FACTOR = 4


def pilot_points(study: Study, points: Points, count: int | None = None) -> IntArray:
    """Indices of the points at which candidates are compared: the middle of the design, then always the farthest one.

    So the edges are included early, and all other points lie between pilot points. Their number, if omitted, is the
    larger of what the confidence needs and four per factor plus one; none where that would be more than half of the
    study.
    """
    places, usable = usable_points(study, points)
    wanted = count or _wanted(study, points.columns)
    if 2 * wanted > usable.size:
        return np.array([], np.int64)
    chosen = [int(usable[np.argmin(((places[usable] - 0.5) ** 2).sum(axis=1))])]
    distance = np.full(usable.size, np.inf)
    while len(chosen) < wanted:
        distance = np.minimum(distance, ((places[usable] - places[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(usable[np.argmax(distance.round(12))]))  # rounded: equal distances are taken in order
    return np.array(sorted(chosen))


def usable_points(study: Study, points: Points) -> tuple[FloatArray, IntArray]:
    """Places of all points in the unit cube, and indices of those usable for a pilot: different, no friction halved."""
    columns = points.columns
    places = in_unit_cube(columns, columns)
    halved = [column == HALF for name, column in columns.items() if name in study.switches]  # of an ablation alone
    usable = np.flatnonzero(points.allowed & ~np.any([np.zeros(points.count, bool), *halved], axis=0))
    _, first = np.unique(places[usable], axis=0, return_index=True)
    return places, usable[np.sort(first)]


def least_points(study: Study, points: Points) -> int:
    """Usable points that a study must have for a pilot without a record."""
    return 2 * _wanted(study, points.columns)


def _wanted(study: Study, factors: Mapping[str, object]) -> int:
    assert study.auto_model is not None
    return max(study.auto_model.least_points, _POINTS_A_FACTOR * len(factors) + 1)


def pilot_study(study: Study, points: Points, runs: Sequence[tuple[Candidate, IntArray]]) -> Study:
    """The pilot: each candidate at some points, by their indices. With more runs it is the same study, grown."""
    auto = study.auto_model
    assert auto is not None
    chosen = np.concatenate([indices for _, indices in runs])
    places = {name: column[chosen].tolist() for name, column in points.columns.items()}
    ways = {name: [candidate.values[name] for candidate, indices in runs for _ in indices] for name in auto.parameters}
    head, policy = study.file.study, study.file.run
    content: dict[str, Any] = {
        "study": {
            "name": f"{head.name}: pilot",
            "question": "How large is the error of each candidate, and what does it cost?",
            **({"function": head.function} if head.function else {"scene": head.scene}),
        },
        "base": dict(study.base),
        "factors": {name: {"values": values} for name, values in (places | ways).items()},
        "design": {"kind": "zip"},
        "keep": {"outputs": _kept(study, auto)},
        # a candidate that fails is an answer
        "run": {
            "expected_outcomes": [outcome.label for outcome in Outcome if outcome is not Outcome.WORKER_LOST],
            "exclusive": policy.exclusive,
            **({"block": policy.block} if policy.block else {}),
        },
    }
    return parse_study(toml_text(content), f"{study.origin}: pilot", study.folder)


def _kept(study: Study, auto: AutoModel) -> list[str]:
    """What the study keeps, so that it need not run these points again, and what its accuracy is judged by.

    All outputs of a function, whose names are its own.
    """
    if not study.simulator.outputs:
        return []
    wanted = {name for quantity in auto.accuracy.quantities for name in (quantity.output, quantity.error)} | set(
        study.stored
    )
    return [name for name in study.simulator.outputs if name in wanted]
