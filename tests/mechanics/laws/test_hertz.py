"""Hertz's coefficients against printed numbers (FACTS) and against independent integrals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from tripod_doe.mechanics.laws import hertz


def test_groove_of_ratio_1_008573_gives_the_ellipse_of_20_to_1():
    """Published number: FACTS, last digit printed."""
    curvature_sum, cos_tau = hertz.groove_curvature(np.array([16.0]), np.array([1.008573]))
    mu, nu, two_k = hertz.hertz_coefficients(cos_tau)
    assert curvature_sum[0] == pytest.approx(0.063031, abs=5e-7)
    assert cos_tau[0] == pytest.approx(0.98314, abs=5e-6)
    assert mu[0] == pytest.approx(6.3486, abs=1e-4)
    assert nu[0] == pytest.approx(0.31743, abs=1e-5)
    assert mu[0] / nu[0] == pytest.approx(20.0, rel=1e-4)
    assert two_k[0] == pytest.approx(0.43963, abs=5e-6)


@pytest.mark.parametrize("cos_tau", [1e-3, 0.3, 0.9, 0.99, 0.9999])
def test_hertz_coefficients_meet_the_integral_that_defines_them(cos_tau):
    """Exact physics: Hertz's integrals evaluated by quadrature, independent of the elliptic functions."""
    mu, nu, two_k = (float(value) for value in hertz.hertz_coefficients(np.array(cos_tau)))
    kappa = nu / mu
    first = quad(lambda t: 1 / np.sqrt(np.cos(t) ** 2 + kappa**2 * np.sin(t) ** 2), 0, np.pi / 2)[0]
    second = quad(lambda t: np.sqrt(np.cos(t) ** 2 + kappa**2 * np.sin(t) ** 2), 0, np.pi / 2)[0]
    # with K and E of parameter 1 - kappa^2
    assert two_k == pytest.approx(2 * first / (np.pi * mu), rel=1e-9)
    assert mu**3 == pytest.approx(2 * second / (np.pi * kappa**2), rel=1e-9)
    m = 1 - kappa**2
    assert ((2 - m) * second - 2 * (1 - m) * first) / (m * second) == pytest.approx(cos_tau, abs=1e-8)
