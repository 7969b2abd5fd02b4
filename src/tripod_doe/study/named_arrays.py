"""Values with named dimensions and labels, which expressions index, reduce and combine.

Why not xarray: a query of a small cube would wait 0.7 s for its import, and constraints are made of plain columns.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.number_text import level

MATCH = 1e-9
"""Relative difference up to which a number is a label."""
_LISTED = 14  # labels that a message names one by one: all orders

Pick = float | str | tuple[float | None, float | None]
"""A label, or a range of labels with both its ends, either of which may be missing."""


@dataclass(frozen=True)
class NamedArray:
    """An array with a name for each of its dimensions."""

    dims: tuple[str, ...]  # their names
    data: NDArray[Any]  # the values
    labels: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # along dimensions; positions without labels

    def labels_along(self, dim: str) -> NDArray[Any]:
        """Labels along a dimension, shape (length,)."""
        known = self.labels.get(dim)
        return np.arange(self.data.shape[self.dims.index(dim)]) if known is None else known

    def without(self, dims: Collection[str]) -> tuple[str, ...]:
        """Its other dimensions."""
        return tuple(dim for dim in self.dims if dim not in dims)

    def picked(self, picks: Sequence[Pick], rows: Collection[str]) -> NamedArray:
        """Values at labels along its dimensions, in their order.

        Args:
            picks: A label or a range for each dimension; a label removes its dimension.

        Raises:
            InputError: If there are other dimensions than picks, or no such label.
        """
        own = self.without(rows)
        if len(picks) != len(own):
            raise InputError(_wrong_count(own, self))
        place: list[Any] = [slice(None)] * self.data.ndim
        labels = {dim: known for dim, known in self.labels.items() if dim not in own}
        for dim, pick in zip(own, picks, strict=True):
            known, axis = self.labels_along(dim), self.dims.index(dim)
            at = _positions(dim, known, pick)
            if isinstance(pick, tuple):
                place[axis], labels[dim] = at, known[at]
            else:
                place[axis] = slice(int(at[0]), int(at[0]) + 1)
        data = self.data
        for axis, part in enumerate(place):
            data = data[(slice(None),) * axis + (part,)]
        gone = tuple(self.dims.index(dim) for dim, pick in zip(own, picks, strict=True) if not isinstance(pick, tuple))
        dims = tuple(dim for axis, dim in enumerate(self.dims) if axis not in gone)
        return NamedArray(dims, data.squeeze(gone), labels)

    def reduced(self, reduce: Any, dims: Collection[str]) -> NamedArray:
        """Reduce some dimensions to one number; `reduce` is a function such as `numpy.max`."""
        axes = tuple(self.dims.index(dim) for dim in dims)
        labels = {dim: known for dim, known in self.labels.items() if dim not in dims}
        return NamedArray(self.without(dims), reduce(self.data, axis=axes), labels)


def _wrong_count(own: tuple[str, ...], array: NamedArray) -> str:
    """The reason why values cannot be picked by the labels that were given."""
    if not own:
        return "it has one value for a point and is not indexed"
    first = [_text(array.labels_along(dim).tolist()[0]) for dim in own]
    one = f"; write one label for each, as [{', '.join(first)}], or : for all" if len(own) > 1 else ""
    return f"it has the dimension{'s' * (len(own) > 1)} {', '.join(own)}{one}"


def _positions(dim: str, labels: NDArray[Any], pick: Pick) -> NDArray[np.intp]:
    """Positions of a label, or of a range of labels."""
    numbers = labels.dtype.kind in "fiu"
    if isinstance(pick, tuple):
        if pick == (None, None):
            return np.arange(labels.size)
        if not numbers:
            raise InputError(f"{dim} has texts, so no range; it has {_listed(labels)}")
        low, high = (default if end is None else end for end, default in zip(pick, (-math.inf, math.inf), strict=True))
        slack = MATCH * np.abs(labels)
        at = np.flatnonzero((labels >= low - slack) & (labels <= high + slack))
    elif isinstance(pick, str):
        at = np.flatnonzero(labels.astype(str) == pick)
    else:
        at = np.flatnonzero(meant(labels, pick)) if numbers else np.zeros(0, np.intp)
    if not at.size:
        shown = f"{_text(pick[0])}:{_text(pick[1])}" if isinstance(pick, tuple) else _text(pick)
        raise InputError(f"no {dim} {shown}; it has {_listed(labels)}")
    return at


def meant(labels: NDArray[Any], written: float) -> NDArray[np.bool_]:
    """Which labels a number means: those that it is to 1e-9, else the only one that `level` prints so."""
    slack = MATCH * max(abs(written), 1e-300)
    means = (labels >= np.float64(written - slack)) & (labels <= np.float64(written + slack))
    if not means.any() and labels.dtype.kind == "f" and float(f"{written:.5e}") == written:
        near = np.unique(labels[np.abs(labels - written) <= 1e-5 * abs(written)])
        printed = [label for label in near.tolist() if level(label) == level(written)]
        means = labels == printed[0] if len(printed) == 1 else means
    return np.asarray(means)


def _text(label: object) -> str:
    """A label as an index is written."""
    if label is None:
        return ""
    return level(float(label)) if isinstance(label, int | float) else repr(label)


def _listed(labels: NDArray[Any]) -> str:
    """Labels in words: few one by one, many by their ends."""
    texts = [_text(label) for label in labels.tolist()]
    return ", ".join(texts) if len(texts) <= _LISTED else f"{texts[0]} to {texts[-1]} in {len(texts):,} places"


def aligned(arrays: Sequence[NamedArray], rows: Collection[str], most: int) -> list[NamedArray]:
    """Arrays with the union of their dimensions; missing dimensions get length one.

    Args:
        rows: Dimensions that do not count in the limit.
        most: Largest number of values that their combination may have for each row.

    Raises:
        InputError: If their labels along a common dimension differ, or the combination is too large.
    """
    labels: dict[str, NDArray[Any]] = {}
    lengths: dict[str, int] = {}
    for array in arrays:
        for dim, length in zip(array.dims, array.data.shape, strict=True):
            if lengths.setdefault(dim, length) != length or not _same(labels.get(dim), array.labels.get(dim)):
                raise InputError(
                    f"values at different {dim} are combined: {_listed(labels.get(dim, np.arange(lengths[dim])))}, and "
                    f"{_listed(array.labels_along(dim))}; reduce each by max, min, mean or sum first"
                )
            if dim in array.labels:
                labels[dim] = array.labels[dim]
    if (count := math.prod(length for dim, length in lengths.items() if dim not in rows)) > most:
        raise InputError(
            f"{count:,} values for each point ({' x '.join(dim for dim in lengths if dim not in rows)}); at most "
            f"{most:,} are allowed: index or reduce before you combine"
        )
    dims = tuple(lengths)
    return [_spread(array, dims, labels) for array in arrays]


def _same(one: NDArray[Any] | None, other: NDArray[Any] | None) -> bool:
    return one is None or other is None or one is other or bool(np.array_equal(one, other))


def _spread(array: NamedArray, dims: tuple[str, ...], labels: Mapping[str, NDArray[Any]]) -> NamedArray:
    if array.dims == dims:
        return NamedArray(dims, array.data, labels)
    order = [array.dims.index(dim) for dim in dims if dim in array.dims]
    missing = tuple(axis for axis, dim in enumerate(dims) if dim not in array.dims)
    return NamedArray(dims, np.expand_dims(array.data.transpose(order), missing), labels)
