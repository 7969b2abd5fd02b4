"""Resumed runs: missing points of a study, and the check whether a changed study may use the results."""

import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import CubeError, InputError, option
from tripod_doe.files.checksum_list import refuse_other_results
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.lazy_dataset import lazy_dataset
from tripod_doe.study.definition.study import Study, canonical
from tripod_doe.study.journal import KERNELS, PILOT, Journal, journal_path, text_digest
from tripod_doe.study.result_directory.stored_study import STORED, known_texts, read_again, stored_study
from tripod_doe.study.study_points import StudyPoints


class Resume:
    """Missing points of a result directory.

    Args:
        path: The directory.
        journal: Its finished blocks.
    """

    def __init__(self, path: Path, journal: Journal) -> None:
        self._path = path
        self._journal = journal

    def refuse_changes(
        self, asked: StudyPoints, done: Iterable[NDArray[np.void]] | None = None, fewer: bool = False
    ) -> None:
        """Refuse a study that differs from the study of the results, unless it only grew.

        Args:
            done: Fingerprints of the points with results; by default of the points in the journal.
            fewer: Whether it may lack points that have results: those stay in the journal.

        Raises:
            InputError: With every key that changed, its old and its new value.
            CubeError: If the file of that study was edited and no cube has its text either.
        """
        study, stored = asked.study, self._path / STORED
        is_here = stored.exists() and Path(study.origin).resolve() == stored.resolve()
        if is_here:
            refuse_other_results(self._path)
        there, grew = asked.done(self._journal.key_blocks() if done is None else done)
        if not there.any() and grew:
            return
        self.refuse_other_kernels(study)
        if not stored.exists():
            return
        same = text_digest(study.text.encode()) in known_texts(self._journal)  # the file there may be damaged
        before = study if same else self._before()
        _refuse_unstored(before, study, self._path)
        old, new = canonical(before), canonical(study)
        changed = sorted(key for key in old.keys() | new.keys() if old.get(key) != new.get(key))
        if (grew or fewer) and not any(key.startswith(("keep", "run")) for key in changed):
            if is_here and not same:  # damage, too, would become its study
                print(
                    f"{stored}: edited since it ran: {', '.join(changed) or 'no key that sets points'}", file=sys.stderr
                )
            return
        listed = [f"  {key}: {old.get(key, 'not set')} -> {new.get(key, 'not set')}" for key in changed]
        raise InputError(
            f"{study.origin}: the study differs from the study of the results in {self._path}; choose another "
            f"{option('out')}, or undo these changes\n" + "\n".join(listed or ["  the points of the table"])
        )

    def _before(self) -> Study:
        """The study of the results: as stored, or, where that file was edited, as the cube holds it."""
        try:
            return stored_study(self._path)
        except CubeError:
            with suppress(CubeError), lazy_dataset(self._path / "cube.nc") as cube:
                text = str(cube.attrs["study"])
                if text_digest(text.encode()) in known_texts(self._journal):
                    return read_again(self._path, text, str(self._path / STORED))
            raise

    def refuse_unknown_version(self, study: Study) -> None:
        """Refuse (InputError) a function without a file where points, or those of a pilot, were computed before."""
        function = study.file.study.function
        if function and not study.simulator.source_hash and any(map(_has_points, (self._path, self._path / PILOT))):
            raise InputError(
                f"{self._path}: it holds points already, and no file shows whether they are of this version of "
                f"{function}: choose another {option('out')}; points of a function in a module can be used again"
            )

    def refuse_other_kernels(self, study: Study) -> None:
        """Refuse (InputError) a study whose points another version of the code has begun; else note the version."""
        kernels = self._journal.recall(KERNELS)
        if kernels is None:
            self._journal.remember({KERNELS: study.simulator.source_hash})
        elif kernels != study.simulator.source_hash:
            code = study.file.study.function or "the kernels"
            raise InputError(
                f"{self._path}: its points were computed by another version of {code} ({kernels or 'not on record'}, "
                f"now {study.simulator.source_hash}); run the study into another directory"
            )

    def missing(self, asked: StudyPoints, retry_failed: bool = False) -> IntArray:
        """Indices of the points to compute, each different one once.

        Args:
            retry_failed: Whether failed points count as missing.
        """
        if not retry_failed:
            return asked.without(self._journal.key_blocks())
        last = np.full(asked.points.count, Outcome.NOT_RUN, np.int8)
        for block in self._journal.blocks():
            rows, at = asked.index.places(block.keys)
            last[at] = block.result.outcome[rows]
        return asked.undone(np.isin(last, list(asked.good_outcomes)))


def _has_points(directory: Path) -> bool:
    if not journal_path(directory).exists():
        return False
    with Journal(directory, read_only=True) as journal:
        return journal.state() != "0"


def _refuse_unstored(before: Study, study: Study, path: Path) -> None:
    """Refuse formulas of outputs that earlier runs did not compute."""
    if not before.keep:  # a function, all of whose outputs are there
        return
    for response in study.responses:
        if missing := sorted(set(response.outputs).difference(before.stored)):
            raise InputError(
                f"{study.origin}: [responses.{response.name}]: {', '.join(missing)}: not among the outputs that the "
                f"results in {path} hold ({', '.join(before.stored)}); run the study with it into another directory"
            )
