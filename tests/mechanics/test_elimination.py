"""The block solver against a dense solve (exact mathematics), and its growth with the ring."""

import numpy as np
import pytest

from tripod_doe.mechanics.elimination import elimination_pattern, factorise, multiply, solve
from tripod_doe.mechanics.tables import CONTACT


def _ring(needles: int):
    """A ring of needles that all touch two other bodies: the graph of a needle bearing."""
    pairs = [(i, (i + 1) % needles) for i in range(needles)] if needles > 1 else []
    pairs += [(i, needles + k) for i in range(needles) for k in range(2)] + [(needles, needles + 2)]
    table = np.zeros(len(pairs), CONTACT)
    table["body_a"], table["body_b"] = np.array(pairs).T
    return table, elimination_pattern(np.arange(needles + 3), (table,))


@pytest.mark.parametrize("needles", [1, 2, 3, 9, 27])
def test_solution_is_that_of_a_dense_solve(needles):
    _, pattern = _ring(needles)
    rng = np.random.default_rng(3)
    count = pattern.order.size
    blocks = rng.normal(size=(pattern.row.size, 6, 6))
    blocks[pattern.own] += 40 * np.eye(6)
    dense = np.zeros((count, 6, count, 6))
    for block, i, j in zip(blocks, pattern.row, pattern.column, strict=True):
        dense[i, :, j, :] = block
    dense = dense.reshape(6 * count, 6 * count)
    right = rng.normal(size=(count, 6))
    product = np.zeros_like(right)
    multiply(pattern, blocks, right, 2.0, product)
    np.testing.assert_allclose(product.ravel(), 2 * dense @ right.ravel(), rtol=1e-12, atol=1e-11)
    x = right.copy()
    assert factorise(pattern, blocks, np.empty((2, 6, 6)))
    solve(pattern, blocks, x)
    # one block row is random of size 6 against a dominance of 40: condition below 1e3
    np.testing.assert_allclose(x.ravel(), np.linalg.solve(dense, right.ravel()), rtol=1e-9, atol=1e-12)


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
    assert not factorise(pattern, np.zeros((pattern.row.size, 6, 6)), np.empty((2, 6, 6)))
