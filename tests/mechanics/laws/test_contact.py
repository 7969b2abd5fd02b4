"""Laws of contact and friction against their formulas (published numbers and exact mathematics)."""

import numpy as np
import pytest

from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.laws.contact import (
    contact_energy,
    contact_force,
    damped_force,
    damped_stiffness,
    damping_slope,
)
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent, secant_slope, tangent_slope
from tripod_doe.mechanics.laws.rolling import rolling_moment, spinning_lever


@kernel
def _evaluate(x, out):
    for i in range(x.size):
        out[0, i] = hyperbolic_tangent(x[i])
        out[1, i] = secant_slope(x[i], 2.0)
        out[2, i] = tangent_slope(x[i], 2.0)
        out[3, i] = contact_force(3.0, 1.5, x[i])
        out[4, i] = contact_force(3.0, 10 / 9, x[i])
        out[5, i] = contact_energy(contact_force(3.0, 10 / 9, x[i]), 10 / 9, x[i])
        out[6, i] = x[i] * spinning_lever(0.01, x[i])
        out[7, i] = rolling_moment(0.002, x[i], 16.0)
        elastic = contact_force(3.0, 1.5, x[i])
        greased = -0.2 * 0.5 * 1.5 * elastic / x[i]
        out[8, i] = damping_slope(elastic, greased)
        out[9, i] = damped_force(elastic, -0.3 * 0.5 * elastic, greased)
        out[10, i] = damped_stiffness(elastic / x[i], 1.5, 0.3, greased, elastic, -0.5)


@pytest.fixture(scope="module")
def table():
    x = np.array([1e-9, 1e-6, 1e-4, 1e-2, 0.3, 1.0, 4.0, 25.0])
    out = np.empty((11, x.size))
    _evaluate(x, out)
    return x, out


def test_regularised_sign_is_tanh(table):
    x, out = table
    np.testing.assert_allclose(out[0], np.tanh(x), rtol=2e-14)


def test_secant_times_slip_is_the_law_and_tangent_is_its_derivative(table):
    x, out = table
    np.testing.assert_allclose(out[1] * x, np.tanh(x / 2), rtol=1e-13)
    np.testing.assert_allclose(out[2], (1 - np.tanh(x / 2) ** 2) / 2, rtol=1e-12, atol=1e-14)


def test_power_law_and_its_energy(table):
    x, out = table
    np.testing.assert_allclose(out[3], 3 * x**1.5, rtol=1e-14)
    np.testing.assert_allclose(out[4], 3 * x ** (10 / 9), rtol=1e-14)
    np.testing.assert_allclose(out[5], 3 * x ** (19 / 9) * 9 / 19, rtol=1e-13)  # the integral of Eq. 2


def test_moments_of_rolling_and_spinning(table):
    x, out = table
    np.testing.assert_allclose(out[6], 0.01 * x ** (4 / 3), rtol=1e-13)
    np.testing.assert_allclose(out[7], 0.002 * x * 16.0, rtol=1e-15)


def test_damping_of_dry_and_greased_contacts(table):
    """Exact mathematics: the force for F = 3 x^1.5 and x' = -0.5, D = 0.3 and tau = 0.2, and its slope by x."""
    x, out = table

    def force(depth):
        share = -0.2 * 0.5 * 1.5 / depth
        return np.maximum(3 * depth**1.5 * (1 - 0.3 * 0.5 + share / np.sqrt(1 + share**2)), 0)

    np.testing.assert_allclose(out[8], (1 + (0.15 / x) ** 2) ** -1.5, rtol=1e-12)
    np.testing.assert_allclose(out[9], force(x), rtol=1e-12, atol=1e-20)
    held = out[9] > 0
    assert 0 < held.sum() < x.size  # a contact does not pull
    slope = (force(1.00001 * x) - force(0.99999 * x)) / (2e-5 * x)
    np.testing.assert_allclose(out[10][held], slope[held], rtol=1e-8)
