"""Eight numbers at a time against numpy (exact mathematics)."""

import math

import numpy as np
import pytest
from numba.core.errors import TypingError

from tripod_doe.mechanics.arithmetic.elementary_functions import exponential, exponentials, logarithm, root, sine_cosine
from tripod_doe.mechanics.arithmetic.rotations import cross
from tripod_doe.mechanics.arithmetic.simd_lanes import (
    across,
    clear,
    everywhere,
    fused,
    load,
    load_three,
    pick,
    ramp,
    replace,
    row,
    row_of_sums,
    select,
    spread,
    store,
)
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.laws.contact import contact_force
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent


@kernel
def _evaluate(numbers, out):
    x, y = load(numbers, 0), load(numbers, 1)
    results = (
        2.0 * x + y / 3.0 - 1.0,
        select(x > y, x, 0.0),
        max(x, 0.5),
        min(y, 0.5),
        -abs(x),
        math.sqrt(abs(x)),
        abs(x) ** 1.3,
        ramp(3.0),
        row_of_sums(x, y, x * y, x - y, -y, 1.0),
        cross((x, y, 1.0), (y, 1.0, x))[2],
        row(1.0, 2.0, 3.0, 4.0, 5.0, pick(x, 3)),
        replace(x, 2, 7.0),
        hyperbolic_tangent(x),
        root(abs(x), 9),
        exponential(10.0 * x),
        logarithm(abs(x)),
        sine_cosine(0.2 * x)[0],
        sine_cosine(0.2 * x)[1],
        fused(x, 2.0, y),
    )
    for i in range(len(results)):
        store(out, i, results[i])


def test_lanes_are_numpy():
    numbers = np.random.default_rng(1).normal(size=(2, 8))
    out = np.empty((19, 8))
    _evaluate(numbers, out)
    x, y = numbers
    replaced = x.copy()
    replaced[2] = 7.0
    expected = [
        2 * x + y / 3 - 1,
        np.where(x > y, x, 0),
        np.maximum(x, 0.5),
        np.minimum(y, 0.5),
        -abs(x),
        np.sqrt(abs(x)),
        abs(x) ** 1.3,
        3 + np.arange(8),
        [*(v.sum() for v in (x, y, x * y, x - y, -y)), 8, 0, 0],
        x - y * y,
        [1, 2, 3, 4, 5, x[3], 0, 0],
        replaced,
        np.tanh(x),
        abs(x) ** (1 / 9),
        np.exp(10 * x),
        np.log(abs(x)),
        np.sin(0.2 * x),
        np.cos(0.2 * x),
        2 * x + y,
    ]
    np.testing.assert_allclose(out, np.array(expected), rtol=1e-14, atol=1e-15)


@kernel
def _evaluate_three(numbers, out):
    x = load_three(numbers, 0)
    grown, fallen = exponentials(10.0 * x)
    results = (
        select(x > 0.0, x, -1.0) + across(numbers, 0),
        row_of_sums(x, x * x, 0.0, 1.0, 0.0, 0.0),
        math.sqrt(abs(x)) / max(min(-x, 2.0), 0.5),
        root(abs(x), 9),
        fused(x, 2.0, logarithm(grown)),
        grown,
        fallen,
        sine_cosine(0.2 * x)[0],
    )
    for i in range(len(results)):
        store(out, i, results[i])
    return everywhere(x < 10.0), everywhere(x < numbers[0, 20])


def test_three_registers_are_numpy():
    numbers, out = np.random.default_rng(1).normal(size=(1, 24)), np.empty((8, 24))
    assert _evaluate_three(numbers, out) == (True, False)
    x = numbers[0]
    sums = np.zeros((3, 8))
    sums[:, 0], sums[:, 1], sums[:, 3] = x.reshape(3, 8).sum(1), (x * x).reshape(3, 8).sum(1), 8.0
    expected = [
        np.where(x > 0, x, -1) + np.repeat(x[:3], 8),
        sums.ravel(),
        np.sqrt(abs(x)) / np.clip(-x, 0.5, 2),
        abs(x) ** (1 / 9),
        12 * x,
        np.exp(10 * x),
        np.exp(-10 * x),
        np.sin(0.2 * x),
    ]
    np.testing.assert_allclose(out, np.array(expected), rtol=1e-14, atol=1e-15)


def test_roots_are_those_of_numpy_over_all_sizes():
    x = np.geomspace(1e-240, 1e200, 40_000)
    for order, exact in ((3, np.cbrt(x)), (9, np.cbrt(np.cbrt(x)))):
        ours = np.array([root(value, order) for value in x])
        np.testing.assert_allclose(ours, exact, rtol=1e-15)
    assert contact_force(1e5, 10 / 9, 0.0) == 0.0


@kernel
def _below(numbers, limit):
    return everywhere(load(numbers, 0) <= limit)


def test_a_condition_holds_everywhere_or_not_and_never_of_what_is_no_number():
    numbers = np.arange(8.0)[None]
    assert _below(numbers, 7.0)
    assert not _below(numbers, 6.5)
    numbers[0, 4] = np.nan
    assert not _below(numbers, 7.0)


@kernel
def _clear_and_fill(numbers, number):
    clear(numbers)
    store(numbers, 1, spread(number))


def test_an_array_is_cleared_as_a_whole_and_a_number_spread_over_a_row():
    numbers = np.full((3, 9), 5.0)
    _clear_and_fill(numbers, 2.5)
    assert numbers.tolist() == [[0.0] * 9, [2.5] * 8 + [0.0], [0.0] * 9]


def test_an_array_with_gaps_is_refused_as_what_lies_between_would_be_cleared():
    with pytest.raises(TypingError):
        _clear_and_fill(np.full((3, 18), 5.0)[:, ::2], 2.5)
