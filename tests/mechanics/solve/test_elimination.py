"""The block solver against a dense solve (exact mathematics), whole and in parts, and its growth with the ring."""

import numpy as np
import pytest

from tripod_doe.mechanics.solve.elimination import (
    eliminate,
    elimination_pattern,
    multiply,
    reduce_right_side,
    substitute_back,
)
from tripod_doe.mechanics.tables import CONTACT


def _ring(needles: int, last=()):
    """A ring of needles that all touch two other bodies: the graph of a needle bearing."""
    pairs = [(i, (i + 1) % needles) for i in range(needles)] if needles > 1 else []
    pairs += [(i, needles + k) for i in range(needles) for k in range(2)] + [(needles, needles + 2)]
    table = np.zeros(len(pairs), CONTACT)
    table["body_a"], table["body_b"] = np.array(pairs).T
    return table, elimination_pattern(np.arange(needles + 3), (table,), last)


def _system(pattern, dominance=40):
    """Random blocks, the same as a dense matrix, and a right-hand side."""
    rng = np.random.default_rng(3)
    count = pattern.order.size
    blocks, right = np.zeros((pattern.row.size, 6, 8)), np.zeros((count, 8))
    blocks[:, :, :6] = rng.normal(size=(pattern.row.size, 6, 6))
    blocks[pattern.own, :, :6] += dominance * np.eye(6)
    right[:, :6] = rng.normal(size=(count, 6))
    dense = np.zeros((count, 6, count, 6))
    for block, i, j in zip(blocks, pattern.row, pattern.column, strict=True):
        dense[i, :, j, :] = block[:, :6]
    return blocks, dense.reshape(6 * count, 6 * count), right


def _scratch():
    return np.empty((2, 6, 8))


@pytest.mark.parametrize("needles", [1, 2, 3, 9, 27])
def test_solution_is_that_of_a_dense_solve(needles):
    _, pattern = _ring(needles)
    blocks, dense, right = _system(pattern)
    count = pattern.order.size
    product = np.zeros_like(right)
    multiply(pattern, blocks, right, 2.0, product)
    np.testing.assert_allclose(product[:, :6].ravel(), 2 * dense @ right[:, :6].ravel(), rtol=1e-12, atol=1e-11)
    x = right.copy()
    assert eliminate(pattern, blocks, 0, count, _scratch())
    reduce_right_side(pattern, blocks, x, 0, count)
    substitute_back(pattern, blocks, x, 0, count)
    # one block row is random of size 6 against a dominance of 40: condition below 1e3
    solution = np.linalg.solve(dense, right[:, :6].ravel())
    np.testing.assert_allclose(x[:, :6].ravel(), solution, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("apart", [0.3, 0.7, 1.0])
def test_bodies_that_do_not_touch_are_passed_over(apart):
    """Blocks of pairs that might touch and do not are zero: both of a pair, or, as NaN must not be lost, neither."""
    _, pattern = _ring(27)
    blocks, dense, right = _system(pattern)
    beside = pattern.row != pattern.column
    lower, upper = np.minimum(pattern.row, pattern.column), np.maximum(pattern.row, pattern.column)
    empty = beside & (np.random.default_rng(4).random((40, 40)) < apart)[lower, upper]
    blocks[empty] = 0.0
    dense.reshape(30, 6, 30, 6)[pattern.row[empty], :, pattern.column[empty]] = 0.0
    x, count = right.copy(), pattern.order.size
    assert eliminate(pattern, blocks, 0, count, _scratch())
    assert apart < 1.0 or not blocks[beside].any()
    reduce_right_side(pattern, blocks, x, 0, count)
    substitute_back(pattern, blocks, x, 0, count)
    solution = np.linalg.solve(dense, right[:, :6].ravel())
    np.testing.assert_allclose(x[:, :6].ravel(), solution, rtol=1e-9, atol=1e-12)
    blocks[np.flatnonzero(beside)[0], 2, 3] = np.nan
    assert eliminate(pattern, blocks, 0, count, _scratch()) is False or not np.isfinite(blocks).all()


def test_the_tail_holds_what_is_left_of_the_scene():
    """Eliminating in parts: the blocks of the tail become the dense Schur complement, and can be changed and reused."""
    needles = 9
    _, pattern = _ring(needles, last=(needles, needles + 2))
    count, tail = pattern.order.size, pattern.tail
    assert set(pattern.order[tail:]) == {needles, needles + 2}
    assert {(int(i), int(j)) for i, j in zip(pattern.row, pattern.column, strict=True)} >= {(needles, needles + 2)}
    blocks, dense, right = _system(pattern)
    within = np.isin(pattern.row, pattern.order[tail:]) & np.isin(pattern.column, pattern.order[tail:])
    assert np.array_equal(np.flatnonzero(within), np.arange(pattern.tail_block, pattern.row.size))
    assert eliminate(pattern, blocks, 0, tail, _scratch())
    x = right.copy()
    reduce_right_side(pattern, blocks, x, 0, tail)
    late = np.concatenate([np.arange(6 * row, 6 * row + 6) for row in pattern.order[tail:]])
    early = np.setdiff1d(np.arange(6 * count), late)
    weights = dense[np.ix_(late, early)] @ np.linalg.inv(dense[np.ix_(early, early)])
    schur = dense[np.ix_(late, late)] - weights @ dense[np.ix_(early, late)]
    for block in range(pattern.tail_block, pattern.row.size):
        i, j = (list(pattern.order[tail:]).index(at[block]) for at in (pattern.row, pattern.column))
        np.testing.assert_allclose(
            blocks[block, :, :6], schur[6 * i : 6 * i + 6, 6 * j : 6 * j + 6], rtol=1e-9, atol=1e-11
        )
    kept, reduced = blocks[pattern.tail_block :].copy(), x.copy()
    for stiffer in (0.0, 7.0):  # the tail is changed and solved again without the rest
        blocks[pattern.tail_block :], x = kept, reduced.copy()
        changed = dense.copy()
        for row in pattern.order[tail:]:
            blocks[pattern.own[row], :, :6] += stiffer * np.eye(6)
            changed[6 * row : 6 * row + 6, 6 * row : 6 * row + 6] += stiffer * np.eye(6)
        assert eliminate(pattern, blocks, tail, count, _scratch())
        reduce_right_side(pattern, blocks, x, tail, count)
        substitute_back(pattern, blocks, x, tail, count)
        substitute_back(pattern, blocks, x, 0, tail)
        solution = np.linalg.solve(changed, right[:, :6].ravel())
        np.testing.assert_allclose(x[:, :6].ravel(), solution, rtol=1e-9, atol=1e-12)


def test_pivots_that_cancel_are_exchanged():
    """Blocks that are regular although their leading entries are zero."""
    _, pattern = _ring(3)
    blocks, dense, right = _system(pattern)
    turn = np.eye(6)[[1, 0, 3, 2, 5, 4]]
    blocks[:, :, :6], dense = turn @ blocks[:, :, :6], np.kron(np.eye(pattern.order.size), turn) @ dense
    for d in range(6):
        blocks[pattern.own, d, d] = 0.0
    np.fill_diagonal(dense, 0.0)
    x, count = right.copy(), pattern.order.size
    assert eliminate(pattern, blocks, 0, count, _scratch())
    reduce_right_side(pattern, blocks, x, 0, count)
    substitute_back(pattern, blocks, x, 0, count)
    solution = np.linalg.solve(dense, right[:, :6].ravel())
    np.testing.assert_allclose(x[:, :6].ravel(), solution, rtol=1e-9, atol=1e-12)


def test_work_and_memory_grow_linearly_with_the_ring():
    sizes = [_ring(needles)[1] for needles in (27, 54, 108)]
    blocks = np.diff([pattern.row.size for pattern in sizes])
    products = np.diff([pattern.target.size for pattern in sizes])
    assert blocks[1] == 2 * blocks[0]
    assert products[1] == 2 * products[0]


def test_each_element_knows_its_blocks():
    table, pattern = _ring(5)
    for row in table:
        a, b = int(row["body_a"]), int(row["body_b"])
        places = [(int(pattern.row[k]), int(pattern.column[k])) for k in row["pair"]]
        assert places == [(a, a), (a, b), (b, a), (b, b)]


def test_a_singular_matrix_is_reported():
    _, pattern = _ring(3)
    assert not eliminate(pattern, np.zeros((pattern.row.size, 6, 8)), 0, pattern.order.size, _scratch())
