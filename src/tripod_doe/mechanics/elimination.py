"""Block elimination: the matrix of an implicit step as 6 x 6 blocks over the graph of bodies that touch each other.

The order of elimination is worked out once an assembly by minimum degree: the needles of a ring go first, each leaving
one block of fill between its neighbours, the bodies that all of them touch go last. Work and memory grow linearly with
the needles. Pivot blocks are inverted without looking at other blocks: M - a D - b K with a D and b K mostly
semidefinite leaves them regular.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.tables import Pattern

__all__ = ["elimination_pattern", "factorise", "multiply", "solve"]

IntArray = NDArray[np.int64]


def elimination_pattern(block_of_body: IntArray, elements: Iterable[NDArray[Any]]) -> Pattern:
    """Work out blocks and order of elimination, and write each element's four blocks into its ``pair``.

    Parameters
    ----------
    block_of_body
        Row of each body in the block matrix, -1 for none.
    elements
        Tables with ``body_a``, ``body_b`` and ``pair``.
    """
    elements = list(elements)
    count = int(block_of_body.max(initial=-1)) + 1
    graph: list[set[int]] = [set() for _ in range(count)]
    for table in elements:
        for a, b in zip(block_of_body[table["body_a"]], block_of_body[table["body_b"]], strict=True):
            if a >= 0 and b >= 0:
                graph[a].add(int(b))
                graph[b].add(int(a))
    order, neighbours = _minimum_degree(graph)
    number: dict[tuple[int, int], int] = {}
    for pivot, others in zip(order, neighbours, strict=True):
        for place in ((pivot, pivot), *((i, pivot) for i in others), *((pivot, i) for i in others)):
            number.setdefault(place, len(number))
    for table in elements:
        blocks_a, blocks_b = block_of_body[table["body_a"]], block_of_body[table["body_b"]]
        for row, a, b in zip(table, blocks_a, blocks_b, strict=True):
            row["pair"] = [number.get((int(i), int(j)), -1) for i, j in ((a, a), (a, b), (b, a), (b, b))]
    places = np.array(list(number), np.int64).reshape(-1, 2)
    lengths = np.array([len(others) for others in neighbours], np.int64)

    def flat(values: Iterable[int]) -> IntArray:
        return np.fromiter(values, np.int64)

    return Pattern(
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
    )


def _minimum_degree(graph: list[set[int]]) -> tuple[list[int], list[list[int]]]:
    """Order of elimination, and the neighbours that each pivot still has when its turn comes."""
    left = {i: set(others) for i, others in enumerate(graph)}
    order, neighbours = [], []
    while left:
        pivot = min(left, key=lambda i: (len(left[i]), i))
        others = sorted(left.pop(pivot))
        for i in others:
            left[i].update(others)
            left[i] -= {i, pivot}
        order.append(pivot)
        neighbours.append(others)
    return order, neighbours


@kernel
def _invert(block, inverse):
    """Inverse of a 6 x 6 block by Gauss-Jordan elimination with row pivots; destroys `block`, False if singular."""
    for i in range(6):
        for j in range(6):
            inverse[i, j] = 1.0 if i == j else 0.0
    for k in range(6):
        best = k
        for i in range(k + 1, 6):
            if abs(block[i, k]) > abs(block[best, k]):
                best = i
        if not abs(block[best, k]) > 0.0:
            return False
        if best != k:
            for j in range(6):
                block[k, j], block[best, j] = block[best, j], block[k, j]
                inverse[k, j], inverse[best, j] = inverse[best, j], inverse[k, j]
        factor = 1.0 / block[k, k]
        for j in range(6):
            block[k, j] *= factor
            inverse[k, j] *= factor
        for i in range(6):
            if i != k:
                factor = block[i, k]
                for j in range(6):
                    block[i, j] -= factor * block[k, j]
                    inverse[i, j] -= factor * inverse[k, j]
    return True


@inlined_kernel
def _copy_block(source, target):
    for i in range(6):
        for j in range(6):
            target[i, j] = source[i, j]


@inlined_kernel
def _add_product(block, x, factor, y):
    """Add `factor` times the product of a 6 x 6 block with x to y."""
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += block[i, j] * x[j]
        y[i] += factor * total


@kernel
def factorise(pattern, matrix, scratch):
    """Eliminate in place: diagonal blocks become their inverses, lower blocks the factors L_ik = A_ik / A_kk.

    Parameters
    ----------
    pattern
        The elimination.
    matrix
        Blocks, shape (block, 6, 6).
    scratch
        Shape (2 or more, 6, 6).

    Returns
    -------
    bool
        False if a pivot block is singular.
    """
    for k in range(pattern.order.size):
        pivot = matrix[pattern.diagonal[k]]
        if not _invert(pivot, scratch[0]):
            return False
        _copy_block(scratch[0], pivot)
        start, end = pattern.start[k], pattern.start[k + 1]
        target = pattern.target_start[k]
        for m in range(start, end):
            lower = matrix[pattern.lower[m]]
            product = scratch[1]
            for i in range(6):
                for j in range(6):
                    product[i, j] = lower[i, 0] * pivot[0, j]
                for n in range(1, 6):
                    for j in range(6):
                        product[i, j] += lower[i, n] * pivot[n, j]
            _copy_block(product, lower)
            for n in range(start, end):
                upper = matrix[pattern.upper[n]]
                updated = matrix[pattern.target[target]]
                target += 1
                for i in range(6):
                    for p in range(6):
                        factor = lower[i, p]
                        for j in range(6):
                            updated[i, j] -= factor * upper[p, j]
    return True


@kernel
def solve(pattern, matrix, x):
    """Solve with a factorised matrix, in place; x of shape (row, 6)."""
    for k in range(pattern.order.size):
        pivot = pattern.order[k]
        for m in range(pattern.start[k], pattern.start[k + 1]):
            _add_product(matrix[pattern.lower[m]], x[pivot], -1.0, x[pattern.neighbour[m]])
    for k in range(pattern.order.size - 1, -1, -1):
        pivot = pattern.order[k]
        for m in range(pattern.start[k], pattern.start[k + 1]):
            _add_product(matrix[pattern.upper[m]], x[pattern.neighbour[m]], -1.0, x[pivot])
        inverse = matrix[pattern.diagonal[k]]
        y0, y1, y2, y3, y4, y5 = x[pivot, 0], x[pivot, 1], x[pivot, 2], x[pivot, 3], x[pivot, 4], x[pivot, 5]
        for i in range(6):
            x[pivot, i] = (
                inverse[i, 0] * y0 + inverse[i, 1] * y1 + inverse[i, 2] * y2
                + inverse[i, 3] * y3 + inverse[i, 4] * y4 + inverse[i, 5] * y5
            )  # fmt: skip


@kernel
def multiply(pattern, matrix, x, factor, y):
    """Add `factor` times the product of a block matrix (not factorised) with x to y; both of shape (row, 6)."""
    for block in range(pattern.row.size):
        _add_product(matrix[block], x[pattern.column[block]], factor, y[pattern.row[block]])
