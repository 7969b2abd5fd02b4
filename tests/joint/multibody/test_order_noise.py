"""What chance makes of orders: of revolutions that are alike, of a single one, and of those that still swing in."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.multibody.order_noise import mean_and_chance, swung_in


def test_revolutions_that_are_alike_tell_less():
    """Exact: of a process that keeps r of itself, n values are worth n (1 - r) / (1 + r)."""
    rng, keeps, count = np.random.default_rng(1), 0.6, 3999
    values = np.zeros((count, 13), complex)
    for k in range(1, count):
        values[k] = keeps * values[k - 1] + rng.normal(size=(13, 2)) @ [1, 1j]
    expected = 2 * values.real.std(0) * np.sqrt((1 + keeps) / (1 - keeps) / count)
    assert mean_and_chance(values.reshape(-1, 3, 13))[1][1:] == pytest.approx(expected[1:], rel=0.1)


def test_what_skews_make_of_thirds_is_no_chance():
    """Exact: thirds that differ alike in all revolutions leave the mean certain."""
    thirds = np.tile(np.array([1.0, -3.0, 2.0])[None, :, None], (4, 1, 13)).astype(complex)
    mean, chance = mean_and_chance(thirds)
    assert np.abs(mean).max() == 0
    assert chance.max() == pytest.approx(0, abs=1e-12)


def test_an_amplitude_has_half_of_the_variance():
    """Exact: of complex orders whose parts have a standard deviation of 1, in thirds of that of whole revolutions."""
    rng = np.random.default_rng(2)
    whole = 10 + rng.normal(size=(5000, 1, 13, 2)) @ [1, 1j]
    chance = mean_and_chance(whole)[1]
    assert chance[1:] == pytest.approx(2 / np.sqrt(5000), rel=0.05)
    assert np.abs(whole[:, 0, 3]).std() == pytest.approx(1, rel=0.05)


def test_a_single_revolution_tells_by_idle_orders_where_its_thirds_differ():
    """Exact: thirds apart by 1 N, orders 7, 8, 10 and 11 of 0.01 N each."""
    thirds = np.zeros((1, 3, 13), complex)
    thirds[0, :, 3] = 10 + np.array([1, -1, 0])
    thirds[0, :, [7, 8, 10, 11]] = 0.01
    assert mean_and_chance(thirds)[1][3] == pytest.approx(np.sqrt(2) * 0.01)
    thirds[0, :, 3] = 10
    assert mean_and_chance(thirds)[1][3] == 0


@pytest.mark.parametrize(("slow", "dropped"), [(0.0, 0), (0.3, 5)])
def test_first_revolutions_that_swing_in_do_not_count(slow, dropped):
    """Twenty revolutions with a scatter of 0.1; what is left of a swing falls by the factor that is given."""
    orders = (0.1 * np.random.default_rng(4).normal(size=(20, 2)) + 3 * slow ** np.arange(1, 21)[:, None]).astype(
        complex
    )
    found = swung_in(orders)
    assert (found > 0) == (dropped > 0)
    assert found <= dropped


def test_few_revolutions_do_not_tell_whether_the_first_differs():
    assert swung_in(np.array([[9.0], [0.0], [0.0]], complex)) == 0
