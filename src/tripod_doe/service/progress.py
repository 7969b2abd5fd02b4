"""How far runs are: points by outcome and CPU seconds, counted from the journals as blocks are committed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from tripod_doe.errors import CubeError
from tripod_doe.simulator import Outcome
from tripod_doe.study.journal import Journal, Mark, journal_path


@dataclass(frozen=True)
class PointCounts:
    """Points of a run."""

    total: int  # points to compute: repeated ones count once, excluded ones not at all
    finished: int = 0  # points that ended well: finished, or with an outcome that the study expects
    failed: int = 0  # all others that have ended
    outcomes: Mapping[str, int] | None = None  # points by the label of their outcome
    cpu_seconds: float = 0.0  # time of all of them, those that ran again counted each time

    @property
    def missing(self) -> int:
        """Points that have not ended."""
        return max(0, self.total - self.finished - self.failed)


class Progress:
    """The points of one result directory, read from its journal as far as they are new.

    Parameters
    ----------
    directory
        The result directory of a study.
    total
        Points to compute.
    expected
        Outcomes besides finished that do not count as failures.
    """

    def __init__(self, directory: Path, total: int, expected: Collection[str] = ()) -> None:
        self._directory, self._total = directory, total
        self._good = {"finished", *expected}
        self._mark = Mark()
        self._ends: dict[bytes, int] = {}
        self._counts: Counter[int] = Counter()
        self._cpu_seconds = 0.0

    def read(self) -> PointCounts:
        """Count what is there now; a journal that is not there yet, busy or damaged leaves what was counted before."""
        if journal_path(self._directory).is_file():
            try:
                with Journal(self._directory, read_only=True) as journal:
                    self._add(journal)
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
