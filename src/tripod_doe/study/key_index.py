"""Fingerprints in order: where given ones stand among many, in six bytes a point besides the fingerprints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray

Words = NDArray[np.uint64]
Places = IntArray

_BITS = 64  # of a word, of which a fingerprint has two
_PART_BITS = 8  # by which fingerprints are parted before each part is sorted alone
_NEIGHBOURS = 4  # fingerprints that have their first bits in common, about
_CHUNK = 1_000_000  # fingerprints that are looked at together


class KeyIndex:
    """Fingerprints of the points of a study, in an order in which they are found quickly.

    Fingerprints are evenly spread, as all hashes: a table of their first bits leads to a few neighbours, among which
    one is found by halving.

    Parameters
    ----------
    keys
        Fingerprints, shape (point,), 16 bytes each; fewer than 2^31.
    """

    def __init__(self, keys: NDArray[np.void]) -> None:
        self._head, self._tail = _words(keys)
        self._order = _order(self._head, self._tail)
        bits = max((keys.size // _NEIGHBOURS).bit_length(), 1)
        self._shift = np.uint64(_BITS - bits)
        self._begins = np.zeros((1 << bits) + 1, np.int32)  # where the fingerprints with these first bits begin
        for start in range(0, keys.size, _CHUNK):
            np.add.at(self._begins, self._first_bits(self._head[start : start + _CHUNK]) + 1, 1)
        np.cumsum(self._begins, out=self._begins)

    def first_of_each(self) -> NDArray[np.bool_]:
        """Whether a point is the first one with its fingerprint, shape (point,)."""
        first = np.ones(self._order.size, bool)
        for start in range(0, self._order.size, _CHUNK):
            own = self._order[start : start + _CHUNK + 1]
            same = (self._head[own[1:]] == self._head[own[:-1]]) & (self._tail[own[1:]] == self._tail[own[:-1]])
            first[own[1:][same]] = False
        return first

    def places(self, wanted: NDArray[np.void]) -> tuple[Places, Places]:
        """Rows of some fingerprints and the indices where they stand; a strange one stands nowhere."""
        head, tail = _words(wanted)
        bits = self._first_bits(head)
        stop = self._begins[bits + 1].astype(np.int64)
        first = self._bisect(head, self._begins[bits].astype(np.int64), stop)
        rows = np.arange(head.size)
        found_rows, found = [rows[:0]], [rows[:0]]
        while rows.size:  # once, but for fingerprints that stand there several times
            rows = rows[first[rows] < stop[rows]]
            places = self._order[first[rows]]
            alike = self._head[places] == head[rows]
            rows, places = rows[alike], places[alike]
            same = self._tail[places] == tail[rows]
            found_rows.append(rows[same])
            found.append(places[same].astype(np.int64))
            first[rows] += 1
        return np.concatenate(found_rows), np.concatenate(found)

    def _first_bits(self, head: Words) -> Places:
        return (head >> self._shift).astype(np.int64)

    def _bisect(self, head: Words, low: Places, high: Places) -> Places:
        """The first positions in the order, from `low` to `high`, from which on the words are not smaller."""
        high = high.copy()
        rows = np.flatnonzero(low < high)
        while rows.size:
            middle = (low[rows] + high[rows]) // 2
            smaller = self._head[self._order[middle]] < head[rows]
            low[rows[smaller]] = middle[smaller] + 1
            high[rows[~smaller]] = middle[~smaller]
            rows = rows[low[rows] < high[rows]]
        return low


def _words(keys: NDArray[np.void]) -> tuple[Words, Words]:
    """Both halves of some fingerprints; views."""
    words = np.ascontiguousarray(keys).view(np.uint64).reshape(-1, 2)
    return words[:, 0], words[:, 1]


def _order(head: Words, tail: Words) -> NDArray[np.int32]:
    """Indices of fingerprints in ascending order, equal ones as they stand.

    They are parted by their first bits, so that no more than a part is sorted at a time.
    """
    order = np.empty(head.size, np.int32)
    shift, parts = np.uint64(_BITS - _PART_BITS), 1 << _PART_BITS
    chunks = range(0, head.size, _CHUNK)

    def parts_of(start: int) -> NDArray[np.uint8]:
        return (head[start : start + _CHUNK] >> shift).astype(np.uint8)

    counts = sum((np.bincount(parts_of(start), minlength=parts) for start in chunks), np.zeros(parts, np.int64))
    ends = np.cumsum(counts)
    filled = ends - counts
    for start in chunks:
        own = parts_of(start)
        by_part, count = np.argsort(own, kind="stable"), np.bincount(own, minlength=parts)
        shifted = np.repeat(filled - (np.cumsum(count) - count), count)
        order[shifted + np.arange(own.size)] = start + by_part
        filled += count
    for first, end in zip(ends - counts, ends, strict=True):
        own_part = order[first:end]
        order[first:end] = own_part[_ascending(head[own_part], tail[own_part])]
    return order


def _ascending(head: Words, tail: Words) -> Places:
    """Rows of a few fingerprints in ascending order."""
    order = np.argsort(head, kind="stable")
    same_head = head[order[1:]] == head[order[:-1]]
    if (same_head & (tail[order[1:]] != tail[order[:-1]])).any():  # two of 64 bits in common by chance
        return np.lexsort((tail, head))
    return order
