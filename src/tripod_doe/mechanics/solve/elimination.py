"""Block elimination: the matrix of an implicit step as 6 x 6 blocks over the graph of bodies that touch each other.

Minimum degree gives the order of elimination, once per assembly: the needles of a ring go first, each leaving one block
of fill between its neighbours; the bodies that all needles touch go last. Work and memory grow linearly with the
needles. Pivot blocks are inverted without looking at other blocks: M + a D + b K with a D and b K mostly semidefinite
leaves them regular.

Bodies named as last ones, and all that take part in constraints, are the tail of the order. Elimination can be done in
parts: once `eliminate` has gone through the pivots before the tail, the blocks of the tail, which stand together at the
end of the matrix, hold the reduced system of the tail. Then

    eliminate(pattern, matrix, 0, pattern.tail)         reduce_right_side(pattern, matrix, x, 0, pattern.tail)
    ... the tail, pivots pattern.tail to pattern.order.size, as often as wanted ...
    substitute_back(pattern, matrix, x, 0, pattern.tail)
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.mechanics.arithmetic.simd_lanes import everywhere, load, pick, replace, row_of_sums, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.tables import Pattern

_CANCELLED = 1e-6
"""Pivot over its original diagonal entry, below which elimination repeats with row exchanges."""


def elimination_pattern(block_of_body: IntArray, elements: Iterable[NDArray[Any]], last: Iterable[int] = ()) -> Pattern:
    """Work out blocks and order of elimination, and write each element's four blocks into its ``pair``.

    Args:
        block_of_body: Row of each body in the block matrix, -1 for none.
        elements: Tables with ``body_a``, ``body_b`` and ``pair``.
        last: Bodies that are eliminated last.
    """
    elements = list(elements)
    ends = [(block_of_body[table["body_a"]].tolist(), block_of_body[table["body_b"]].tolist()) for table in elements]
    touching = tuple(tuple(zip(*blocks, strict=True)) for blocks in ends)
    tail = frozenset(int(block_of_body[body]) for body in last) - {-1}
    pattern, pairs = _pattern(int(block_of_body.max(initial=-1)) + 1, touching, tail)
    for table, blocks in zip(elements, pairs, strict=True):
        table["pair"] = blocks
    return pattern


@lru_cache(maxsize=16)
def _pattern(
    count: int, touching: tuple[tuple[tuple[int, int], ...], ...], tail: frozenset[int]
) -> tuple[Pattern, list[IntArray]]:
    """Pattern of `count` rows, and blocks of each table's elements; kept, since joints differ in numbers only."""
    graph: list[set[int]] = [set() for _ in range(count)]
    for a, b in chain.from_iterable(touching):
        if a >= 0 and b >= 0:
            graph[a].add(b)
            graph[b].add(a)
    order, neighbours = _minimum_degree(graph, tail)
    number: dict[tuple[int, int], int] = {}
    for pivot, others in zip(order, neighbours, strict=True):
        for place in ((pivot, pivot), *((i, pivot) for i in others), *((pivot, i) for i in others)):
            number.setdefault(place, len(number))
    pairs = [
        np.array([[number.get(place, -1) for place in ((a, a), (a, b), (b, a), (b, b))] for a, b in table], np.int64)
        for table in touching
    ]
    places = np.array(list(number), np.int64).reshape(-1, 2)
    lengths = np.array([len(others) for others in neighbours], np.int64)

    def flat(values: Iterable[int]) -> IntArray:
        return np.fromiter(values, np.int64)

    pattern = Pattern(
        diagonal=flat(number[pivot, pivot] for pivot in order),
        order=flat(order),
        start=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        neighbour=flat(i for others in neighbours for i in others),
        lower=flat(number[i, pivot] for pivot, others in zip(order, neighbours, strict=True) for i in others),
        upper=flat(number[pivot, i] for pivot, others in zip(order, neighbours, strict=True) for i in others),
        target_start=np.concatenate([[0], np.cumsum(lengths**2)]).astype(np.int64),
        target=flat(number[i, j] for others in neighbours for i in others for j in others),
        own=flat(number[i, i] for i in range(count)),
        row=np.ascontiguousarray(places[:, 0]),
        column=np.ascontiguousarray(places[:, 1]),
        tail=count - len(tail),
        tail_block=number[order[-len(tail)], order[-len(tail)]] if tail else len(number),
    )
    return pattern, [blocks.reshape(-1, 4) for blocks in pairs]


def _minimum_degree(graph: list[set[int]], tail: frozenset[int]) -> tuple[list[int], list[list[int]]]:
    """Order of elimination, the tail last, and the neighbours that each pivot still has when its turn comes."""
    left = {i: set(others) for i, others in enumerate(graph)}
    order, neighbours = [], []
    while left:
        pivot = min(left, key=lambda i: (i in tail, len(left[i]), i))
        others = sorted(left.pop(pivot))
        for i in others:
            left[i].update(others)
            left[i] -= {i, pivot}
        order.append(pivot)
        neighbours.append(others)
    return order, neighbours


@inlined_kernel
def _invert(block, scratch):
    """Invert a 6 x 6 block in place; False if it is singular."""
    rows = _rows(block)
    safe = 1.0
    for k in range(6):
        store(scratch, k, rows[k])
    rows, safe = _sweep(rows, 0, block[0, 0], safe)
    rows, safe = _sweep(rows, 1, block[1, 1], safe)
    rows, safe = _sweep(rows, 2, block[2, 2], safe)
    rows, safe = _sweep(rows, 3, block[3, 3], safe)
    rows, safe = _sweep(rows, 4, block[4, 4], safe)
    rows, safe = _sweep(rows, 5, block[5, 5], safe)
    if not safe > _CANCELLED:
        return _invert_with_exchanges(scratch, block)
    for k in range(6):
        store(block, k, rows[k])
    return True


@inlined_kernel
def _sweep(rows, k, diagonal, safe):
    """Gauss-Jordan step for unknown k, whose row comes first and is last in the answer; the least pivot's share too."""
    pivot = pick(rows[0], k)
    scaled = (1.0 / pivot) * replace(rows[0], k, 1.0)
    rows = (
        _swept(rows[1], k, scaled),
        _swept(rows[2], k, scaled),
        _swept(rows[3], k, scaled),
        _swept(rows[4], k, scaled),
        _swept(rows[5], k, scaled),
        scaled,
    )
    share = abs(pivot / diagonal)
    return rows, share if not share > safe else safe


@inlined_kernel
def _swept(lanes, k, scaled):
    return replace(lanes, k, 0.0) - pick(lanes, k) * scaled


@kernel
def _invert_with_exchanges(block, inverse):
    """Inverse of a 6 x 6 block by Gauss-Jordan elimination with row pivots; destroys `block`, False if singular."""
    for i in range(6):
        for j in range(8):
            inverse[i, j] = 1.0 if i == j else 0.0
    for k in range(6):
        best = k
        for i in range(k + 1, 6):
            if abs(block[i, k]) > abs(block[best, k]):
                best = i
        if not abs(block[best, k]) > 0.0:
            return False
        factor = 1.0 / block[best, k]
        for array in (block, inverse):
            pivot, other = factor * load(array, best), load(array, k)
            store(array, best, other)
            store(array, k, pivot)
        for i in range(6):
            if i != k:
                factor = block[i, k]
                for array in (block, inverse):
                    store(array, i, load(array, i) - factor * load(array, k))
    return True


@inlined_kernel
def _rows(block):
    return load(block, 0), load(block, 1), load(block, 2), load(block, 3), load(block, 4), load(block, 5)


@inlined_kernel
def _times(block, i, rows):
    """Row i of the product of a block with the block of `rows`."""
    first = block[i, 0] * rows[0] + block[i, 1] * rows[1] + block[i, 2] * rows[2]
    return first + (block[i, 3] * rows[3] + block[i, 4] * rows[4] + block[i, 5] * rows[5])


@inlined_kernel
def _is_empty(block):
    """Whether a block is zero, as between bodies without present contact."""
    rows = _rows(block)
    size = (abs(rows[0]) + abs(rows[1]) + abs(rows[2])) + (abs(rows[3]) + abs(rows[4]) + abs(rows[5]))
    return everywhere(size <= 0.0)


@inlined_kernel
def _product(block, x):
    """A 6 x 6 block times the first six of lanes."""
    return row_of_sums(
        load(block, 0) * x,
        load(block, 1) * x,
        load(block, 2) * x,
        load(block, 3) * x,
        load(block, 4) * x,
        load(block, 5) * x,
    )


@kernel
def eliminate(pattern, matrix, first, last, scratch):
    """Eliminate a range of pivots in place, the ones before it having been eliminated.

    Diagonal blocks become their inverses, lower blocks the factors L_ik = A_ik / A_kk.

    Args:
        matrix: Blocks, shape (block, 6, 8).
        first, last: Pivots first to last - 1 are eliminated; blocks of later ones receive their updates.
        scratch: Shape (any, 6, 8).

    Returns:
        False if a pivot block is singular.
    """
    for k in range(first, last):
        pivot = matrix[pattern.diagonal[k]]
        if not _invert(pivot, scratch[0]):
            return False
        start, end = pattern.start[k], pattern.start[k + 1]
        inverse = _rows(pivot)
        for m in range(start, end):
            lower = matrix[pattern.lower[m]]
            if _is_empty(lower):
                continue
            for i in range(6):
                store(lower, i, _times(lower, i, inverse))
            target = pattern.target_start[k] + (m - start) * (end - start)
            for n in range(start, end):
                if _is_empty(matrix[pattern.upper[n]]):
                    continue
                upper, updated = _rows(matrix[pattern.upper[n]]), matrix[pattern.target[target + n - start]]
                for i in range(6):
                    store(updated, i, load(updated, i) - _times(lower, i, upper))
    return True


@kernel
def reduce_right_side(pattern, matrix, x, first, last):
    """Carry right-hand sides of pivots first to last - 1 over to later ones; x of shape (row, 8)."""
    for k in range(first, last):
        pivot = load(x, pattern.order[k])
        for m in range(pattern.start[k], pattern.start[k + 1]):
            neighbour = pattern.neighbour[m]
            store(x, neighbour, load(x, neighbour) - _product(matrix[pattern.lower[m]], pivot))


@kernel
def substitute_back(pattern, matrix, x, first, last):
    """Turn reduced right-hand sides of pivots first to last - 1 into solutions, those of later pivots being known."""
    for k in range(last - 1, first - 1, -1):
        pivot = pattern.order[k]
        right = load(x, pivot)
        for m in range(pattern.start[k], pattern.start[k + 1]):
            right = right - _product(matrix[pattern.upper[m]], load(x, pattern.neighbour[m]))
        store(x, pivot, _product(matrix[pattern.diagonal[k]], right))


@kernel
def multiply(pattern, matrix, x, factor, y):
    """Add `factor` times the product of a block matrix (not factorised) with x to y; both of shape (row, 8)."""
    for block in range(pattern.row.size):
        at = pattern.row[block]
        store(y, at, load(y, at) + factor * _product(matrix[block], load(x, pattern.column[block])))
