"""What is asked of a result directory: a study with all its points, each known by the fingerprint of its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.simulator import Outcome
from tripod_doe.study.definition import Study
from tripod_doe.study.designs import Points, point_keys
from tripod_doe.study.failures import Failure, common_failures
from tripod_doe.study.key_index import KeyIndex
from tripod_doe.study.task import Task, make_task

if TYPE_CHECKING:  # for its name only
    import xarray as xr

__all__ = ["StudyPoints"]

_CHUNK = 100_000  # points whose settings are held at once


@dataclass(frozen=True)
class StudyPoints:
    """A study and its points.

    Attributes
    ----------
    study, points
        The study and all points of its design.
    """

    study: Study
    points: Points

    @cached_property
    def keys(self) -> NDArray[np.void]:
        """Fingerprints of all points, shape (point,), 16 bytes each."""
        return point_keys(self.study, self.points)

    @property
    def wanted_keys(self) -> NDArray[np.void]:
        """Fingerprints of the points that no constraint excludes; a repeated point stands more than once."""
        return self.keys[self.points.allowed]

    @cached_property
    def index(self) -> KeyIndex:
        """Where the fingerprints stand."""
        return KeyIndex(self.keys)

    @cached_property
    def different(self) -> NDArray[np.int64]:
        """Indices of the points to compute: of repeated ones the first, an excluded one not at all."""
        first = self.index.first_of_each()
        return first[self.points.allowed[first]]

    @property
    def good_outcomes(self) -> frozenset[int]:
        """Outcomes that do not count as failures: finished, and those that the study expects."""
        expected = self.study.file.run.expected_outcomes
        return frozenset(int(o) for o in Outcome if o is Outcome.FINISHED or o.label in expected)

    def without(self, done: NDArray[np.void]) -> NDArray[np.int64]:
        """Indices of the points to compute, each different one once, without those whose fingerprints are done."""
        there = np.zeros(self.points.count, bool)
        there[self.index.places(done)[1]] = True
        return self.undone(there)

    def undone(self, done: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Indices of the points to compute, each different one once, without those that are done, shape (point,)."""
        different = self.different
        return different[~done[different]]

    def columns(self, chosen: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """All parameters of some points, each of shape (len(chosen),)."""
        return self.study.simulator.columns(self.study.base, self.points.at(chosen), chosen.size)

    def of_each_kind(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of some points one for each combination of words (models, methods), which is all that a compiler looks at."""
        found: dict[tuple[Any, ...], int] = {}
        for start in range(0, chosen.size, _CHUNK):
            rows = chosen[start : start + _CHUNK]
            words = [column.tolist() for column in self.points.at(rows).values() if column.dtype == object]
            if not words:
                return chosen[:1]
            for row, kind in zip(rows.tolist(), zip(*words, strict=True), strict=True):
                found.setdefault(kind, row)
        return np.array(list(found.values()), np.int64)

    def task(self, chosen: NDArray[np.int64]) -> Task:
        """The task that simulates some points."""
        return make_task(self.study, self.points, chosen)

    def failures(self, cube: xr.Dataset) -> list[Failure]:
        """Points of the cube whose outcome is not good, grouped by outcome and reason, the most frequent first."""
        inside = self.points.allowed
        ends = (cube[name].values.ravel()[inside].tolist() for name in ("outcome", "outcome_detail"))
        return common_failures(zip(*ends, strict=True), self.good_outcomes)
