"""What the pilot of a study ran already, taken over as results of the study, so that nothing is run twice.

A point with the parameters that were chosen for it is the same point in pilot and study, so its results are the same
numbers. Only points that finished are taken: one that failed is the study's to run, with its own retries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.results import BlockResult, Outcome, Values
from tripod_doe.study.definition import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.journal import PER_POINT, PILOT, FinishedBlock, Journal
from tripod_doe.study.retry import untried
from tripod_doe.study.simulator import point_columns

__all__ = ["finished_in_pilot", "pilot_results"]


def finished_in_pilot(directory: Path) -> NDArray[np.void]:
    """Fingerprints of the points that finished in a pilot, shape (point,); none where there is no pilot.

    Parameters
    ----------
    directory
        The pilot's result directory.
    """
    keys = [block.keys[block.result.outcome == Outcome.FINISHED] for block in _blocks(directory)]
    return np.concatenate([np.array([], "V16"), *keys])


def pilot_results(
    study: Study, points: Points, keys: NDArray[np.void], missing: NDArray[np.int64], directory: Path
) -> Iterator[FinishedBlock]:
    """Those of a study's missing points that its pilot finished, as blocks of the study.

    Parameters
    ----------
    study, points
        The study, with what was chosen for its points.
    keys
        Fingerprints of all points.
    missing
        Indices of the points that are to be run, each different one once.
    directory
        The pilot's result directory.
    """
    waiting = {keys[index].tobytes(): int(index) for index in missing}
    for block in _blocks(directory):
        found = [
            (row, waiting.pop(key.tobytes()))
            for row, (key, outcome) in enumerate(zip(block.keys, block.result.outcome, strict=True))
            if outcome == Outcome.FINISHED and key.tobytes() in waiting
        ]
        if found:
            rows, indices = np.array(found).T
            columns = {name: column[indices] for name, column in points.settings.items()}
            full = point_columns(study.simulator, study.base, columns, indices.size)
            result = untried(study.simulator, full, _part(block.result, rows, study.keep), study.retry)
            share = rows.size / block.keys.size
            yield FinishedBlock(block.keys[rows], result, block.cpu_seconds * share, block.wall_seconds * share, PILOT)


def _blocks(directory: Path) -> Iterator[FinishedBlock]:
    if (directory / "journal.sqlite").exists():
        with Journal(directory) as journal:
            yield from journal.blocks()


def _part(result: BlockResult, rows: NDArray[np.int64], keep: tuple[str, ...]) -> BlockResult:
    """Some rows of a block, with the outputs that a study keeps (all where it names none)."""
    outputs = {
        name: Values(values.dims, values.data[rows])
        for name, values in result.outputs.items()
        if not keep or name in keep
    }
    along = {dim for values in outputs.values() for dim in values.dims}
    per_point: dict[str, Any] = {name: getattr(result, name)[rows] for name in PER_POINT}
    return replace(
        result, outputs=outputs, coordinates={name: v for name, v in result.coordinates.items() if name in along},
        detail=[result.detail[row] for row in rows], **per_point,
    )  # fmt: skip
