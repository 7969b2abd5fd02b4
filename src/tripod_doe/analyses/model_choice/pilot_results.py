"""Points that the pilot of a study ran already, taken over as results of the study, so that no point runs twice.

A point with the parameters that were chosen for it is the same point in pilot and study, so its results are the same
numbers. Only points that finished are taken: one that failed is the study's to run, with its own retries.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.simulator import Outcome
from tripod_doe.study.journal import PILOT, FinishedBlock, Journal, journal_path
from tripod_doe.study.retry import untried
from tripod_doe.study.study_points import StudyPoints


def finished_in_pilot(directory: Path) -> NDArray[np.void]:
    """Fingerprints of the points that finished in a pilot, shape (point,); none where there is no pilot.

    Parameters
    ----------
    directory
        The pilot's result directory.
    """
    keys = [block.keys[block.result.outcome == Outcome.FINISHED] for block in _blocks(directory)]
    return np.concatenate([np.array([], "V16"), *keys])


def pilot_results(asked: StudyPoints, missing: IntArray, directory: Path) -> Iterator[FinishedBlock]:
    """Those of a study's missing points that its pilot finished, as blocks of the study.

    Parameters
    ----------
    asked
        The study, with what was chosen for its points.
    missing
        Indices of the points that are to be run, each different one once.
    directory
        The pilot's result directory.
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
            part = block.result.take(rows, study.keep)
            result = untried(study.simulator, asked.columns(indices), part, study.retry)
            share = rows.size / block.keys.size
            yield FinishedBlock(block.keys[rows], result, block.cpu_seconds * share, block.wall_seconds * share, PILOT)


def _blocks(directory: Path) -> Iterator[FinishedBlock]:
    if journal_path(directory).exists():
        with Journal(directory, read_only=True) as journal:
            yield from journal.blocks()
