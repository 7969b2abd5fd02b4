"""Fingerprints in order: where given ones stand among many, in 20 bytes a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["KeyIndex"]

_WORD = np.uint64


class KeyIndex:
    """Fingerprints of the points of a study, in an order in which they are found quickly.

    Parameters
    ----------
    keys
        Fingerprints, shape (point,), 16 bytes each.
    among
        Indices of those to be found; all if omitted.
    """

    def __init__(self, keys: NDArray[np.void], among: NDArray[np.int64] | None = None) -> None:
        head, self._tail = _halves(keys)
        self._order = (
            np.argsort(head, kind="stable") if among is None else among[np.argsort(head[among], kind="stable")]
        )
        self._head = head[self._order]

    def first_of_each(self) -> NDArray[np.int64]:
        """Index of the first point of each different fingerprint, ascending."""
        same_head = self._head[1:] == self._head[:-1]
        tail = self._tail[self._order]
        order, same = self._order, same_head & (tail[1:] == tail[:-1])
        if (same != same_head).any():  # two of 64 bits in common by chance
            by_both = np.lexsort((self._order, tail, self._head))
            order, tail, head = self._order[by_both], tail[by_both], self._head[by_both]
            same = (head[1:] == head[:-1]) & (tail[1:] == tail[:-1])
        return np.sort(order[np.concatenate([[True], ~same])[: order.size]])

    def places(self, wanted: NDArray[np.void]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows of some fingerprints and the indices where they stand; a strange one stands nowhere."""
        if not self._head.size:
            return (np.array([], np.int64),) * 2
        head, tail = _halves(wanted)
        ascending = np.argsort(head)  # neighbours are searched for one after the other: the cache holds their way
        first, last = np.empty(head.size, np.int64), self._head.size - 1
        first[ascending] = np.searchsorted(self._head, head[ascending], side="left")
        count = (self._head[np.minimum(first, last)] == head).astype(np.int64)
        several = np.flatnonzero(count & (first < last) & (self._head[np.minimum(first + 1, last)] == head))
        count[several] = np.searchsorted(self._head, head[several], side="right") - first[several]
        rows = np.repeat(np.arange(head.size), count)
        within = np.arange(rows.size) - np.repeat(np.cumsum(count) - count, count)
        places = self._order[first[rows] + within]
        known = self._tail[places] == tail[rows]
        return rows[known], places[known]


def _halves(keys: NDArray[np.void]) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    words = np.ascontiguousarray(keys).view(_WORD).reshape(-1, 2)
    return words[:, 0].copy(), words[:, 1]
