"""A study with all its points and their fingerprints, for runs in a result directory."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.fingerprints import KeyIndex, point_keys

_LOOKED_AT = 1000  # points that are checked together until one can run


@dataclass(frozen=True)
class StudyPoints:
    """A study and its points."""

    # study, points: the study and all points of its design
    study: Study
    points: Points

    @cached_property
    def keys(self) -> NDArray[np.void]:
        """Fingerprints of all points, shape (point,), 16 bytes each."""
        return point_keys(self.study, self.points)

    @cached_property
    def index(self) -> KeyIndex:
        """Places of the fingerprints."""
        return KeyIndex(self.keys)

    @cached_property
    def to_compute(self) -> NDArray[np.bool_]:
        """Whether a point is computed, shape (point,): the first of repeated ones, and no excluded one."""
        return self.index.first_of_each() & self.points.allowed

    @property
    def good_outcomes(self) -> frozenset[int]:
        """Outcomes that do not count as failures: finished, and those that the study expects."""
        expected = self.study.file.run.expected_outcomes
        return frozenset(int(o) for o in Outcome if o is Outcome.FINISHED or o.label in expected)

    def done(self, keys: Iterable[NDArray[np.void]]) -> tuple[NDArray[np.bool_], bool]:
        """Points with given fingerprints, shape (point,), and whether all fingerprints belong to allowed points."""
        there, known = np.zeros(self.points.count, bool), True
        for block in keys:
            rows, at = self.index.places(block)
            there[at] = True
            inside = np.zeros(block.size, bool)
            inside[rows[self.points.allowed[at]]] = True
            known &= bool(inside.all())
        return there, known

    def without(self, done: Iterable[NDArray[np.void]]) -> IntArray:
        """Indices of the points to compute, each different one once, without finished fingerprints."""
        return self.undone(self.done(done)[0])

    def undone(self, done: NDArray[np.bool_]) -> IntArray:
        """Indices of the points to compute, each different one once, without the points of `done`, shape (point,)."""
        return np.flatnonzero(self.to_compute & ~done)

    def refuse_impossible(self) -> None:
        """Refuse (InputError) a study whose every point is known to be jammed, unless it expects that."""
        if Outcome.JAMMED in self.good_outcomes or self.study.auto_model:  # a pilot completes the values of points
            return
        chosen, ends = np.flatnonzero(self.points.allowed), Counter[str]()
        for start in range(0, chosen.size, _LOOKED_AT):
            rows = chosen[start : start + _LOOKED_AT]
            foreseen = self.study.simulator.foreseen(self.columns(rows))
            jammed = [reason for _, outcome, reason in foreseen if outcome is Outcome.JAMMED]
            if len(jammed) < rows.size:
                return
            ends.update(jammed)
        if ends:
            (reason, _), *_ = ends.most_common(1)
            which = "the point" if chosen.size == 1 else f"all {chosen.size:,} points"
            raise InputError(f"parts do not fit or cannot move at {which} of the study, so nothing is run: {reason}")

    def columns(self, chosen: IntArray) -> dict[str, NDArray[Any]]:
        """All parameters of some points, each of shape (len(chosen),)."""
        return self.study.simulator.columns(self.study.base, self.points.at(chosen), chosen.size)

    def kinds(self, chosen: IntArray) -> IntArray | None:
        """Number of the combination of words (models, methods) of each of some points; None if all have the same.

        The words determine which kernels are compiled, and most of the cost of a point.
        """
        import pandas as pd  # slow to import: a plan does without

        kinds: IntArray | None = None
        for name in self.points.setting_names:
            column = self.points.chosen[name] if name in self.points.chosen else self.points.columns[name]
            if column.dtype == object:
                codes, words = pd.factorize(column[chosen])
                kinds = codes if kinds is None else kinds * len(words) + codes
        return kinds

    def of_each_kind(self, chosen: IntArray) -> IntArray:
        """One of the chosen points for each combination of words (models, methods)."""
        kinds = self.kinds(chosen)
        return chosen[:1] if kinds is None else chosen[np.sort(np.unique(kinds, return_index=True)[1])]
