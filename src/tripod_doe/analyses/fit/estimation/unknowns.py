"""Unknowns and their scalars: one for all records, one a group of records, or one a record; searched on a unit cube."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray


@dataclass(frozen=True)
class Unknown:
    """A parameter that is fitted."""

    name: str  # of the parameter
    # low, high: its bounds
    low: float
    high: float
    log: bool = False  # whether its range is searched on a logarithmic scale
    per: str = "all"  # all, record, or the column whose values group the records
    # mean, std: what is known before; None where nothing is
    mean: float | None = None
    std: float | None = None

    def physical(self, place: FloatArray) -> FloatArray:
        """Values at places from 0 (low) to 1 (high)."""
        if self.log:
            return np.asarray(self.low * (self.high / self.low) ** place, float)
        return np.asarray(self.low + (self.high - self.low) * place, float)

    def place(self, value: FloatArray | float) -> FloatArray:
        """Places of values, the inverse of `physical`."""
        if self.log:
            return np.asarray(np.log(np.asarray(value) / self.low) / np.log(self.high / self.low), float)
        return np.asarray((np.asarray(value) - self.low) / (self.high - self.low), float)


@dataclass(frozen=True)
class Layout:
    """The scalars of all unknowns, and which records each one touches."""

    unknowns: tuple[Unknown, ...]
    index: IntArray  # the scalar of each unknown in each record, shape (unknown, record)
    groups: tuple[str, ...]  # what each scalar belongs to: a record, a group, or empty for all, shape (scalar,)

    @cached_property
    def owner(self) -> IntArray:
        """The unknown of each scalar, shape (scalar,)."""
        owner = np.empty(self.count, np.int64)
        for which, row in enumerate(self.index):
            owner[row] = which
        return owner

    @property
    def count(self) -> int:
        """Number of scalars."""
        return len(self.groups)

    @cached_property
    def touched(self) -> NDArray[np.bool_]:
        """Whether a scalar touches a record, shape (record, scalar)."""
        touched = np.zeros((self.index.shape[1], self.count), bool)
        for row in self.index:
            touched[np.arange(row.size), row] = True
        return touched

    def names(self) -> list[str]:
        """Names of the scalars for people."""
        own = [self.unknowns[which].name for which in self.owner]
        return [f"{name} of {group}" if group else name for name, group in zip(own, self.groups, strict=True)]

    def values(self, places: FloatArray) -> FloatArray:
        """Values of the unknowns in every record, shape (trial, record, unknown), from places (trial, scalar)."""
        spread = [u.physical(places[:, row]) for u, row in zip(self.unknowns, self.index, strict=True)]
        return np.stack(spread, axis=-1)

    def physical(self, place: FloatArray) -> FloatArray:
        """Values of the scalars, shape (scalar,)."""
        return np.array([float(self.unknowns[u].physical(p)) for u, p in zip(self.owner, place, strict=True)])

    def priors(self) -> tuple[FloatArray, FloatArray]:
        """Places that are expected, and their deviations; infinite where nothing is known. Shape (scalar,) each."""
        mean, std = np.full(self.count, 0.5), np.full(self.count, np.inf)
        for scalar, which in enumerate(self.owner):
            unknown = self.unknowns[which]
            if unknown.mean is not None and unknown.std is not None:
                mean[scalar] = unknown.place(unknown.mean)
                std[scalar] = float(unknown.place(unknown.mean + unknown.std)) - mean[scalar]
        return mean, std


def make_layout(unknowns: Sequence[Unknown], records: Sequence[str], groups: Sequence[Sequence[str]]) -> Layout:
    """Number the scalars.

    Args:
        groups: For each unknown the group of each record; names of the records where each has its own value, and empty
            for one value in all.
    """
    index, labels = np.empty((len(unknowns), len(records)), np.int64), list[str]()
    for which, own in enumerate(groups):
        known = list(dict.fromkeys(own))
        index[which] = [len(labels) + known.index(group) for group in own]
        labels += known
    return Layout(tuple(unknowns), index, tuple(labels))
