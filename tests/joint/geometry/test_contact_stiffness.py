"""Contact constants against printed numbers (FACTS, paper Table 1) and against independent integrals."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from tripod_doe.joint.geometry import contact_stiffness
from tripod_doe.joint.needle_dynamics.bearing_tilt import NeedleRow, turned_bearing


def test_groove_of_ratio_1_008573_gives_the_ellipse_of_20_to_1():
    """Published number: FACTS, last digit printed."""
    curvature_sum, cos_tau = contact_stiffness.groove_curvature(np.array([16.0]), np.array([1.008573]))
    mu, nu, two_k = contact_stiffness.hertz_coefficients(cos_tau)
    assert curvature_sum[0] == pytest.approx(0.063031, abs=5e-7)
    assert cos_tau[0] == pytest.approx(0.98314, abs=5e-6)
    assert mu[0] == pytest.approx(6.3486, abs=1e-4)
    assert nu[0] == pytest.approx(0.31743, abs=1e-5)
    assert mu[0] / nu[0] == pytest.approx(20.0, rel=1e-4)
    assert two_k[0] == pytest.approx(0.43963, abs=5e-6)
    stiffness = contact_stiffness.groove_contact_stiffness(two_k, curvature_sum, np.array([1.0]))
    assert stiffness[0] == pytest.approx(2.938e6, rel=1e-4)


@pytest.mark.parametrize("cos_tau", [1e-3, 0.3, 0.9, 0.99, 0.9999])
def test_hertz_coefficients_meet_the_integral_that_defines_them(cos_tau):
    """Exact physics: Hertz's integrals evaluated by quadrature, independent of the elliptic functions."""
    mu, nu, two_k = (float(value) for value in contact_stiffness.hertz_coefficients(np.array(cos_tau)))
    kappa = nu / mu
    first = quad(lambda t: 1 / np.sqrt(np.cos(t) ** 2 + kappa**2 * np.sin(t) ** 2), 0, np.pi / 2)[0]
    second = quad(lambda t: np.sqrt(np.cos(t) ** 2 + kappa**2 * np.sin(t) ** 2), 0, np.pi / 2)[0]
    # with K and E of parameter 1 - kappa^2
    assert two_k == pytest.approx(2 * first / (np.pi * mu), rel=1e-9)
    assert mu**3 == pytest.approx(2 * second / (np.pi * kappa**2), rel=1e-9)
    m = 1 - kappa**2
    assert ((2 - m) * second - 2 * (1 - m) * first) / (m * second) == pytest.approx(cos_tau, abs=1e-8)


def test_printed_constants_of_table_1_and_equations_5_to_8():
    """Published number: Eq. 5, 7 and 8 solved for C agree with Table 1 to their printed digits."""
    assert pytest.approx(2.15e5, rel=3e-3) == 2.79e-4 ** (-1.5)
    assert pytest.approx(8.15e4, rel=1e-3) == (3.8e-5) ** (-10 / 9)
    assert pytest.approx(8.85e-3, rel=1e-3) == 3 / 8 * 0.0472 / 2
    assert contact_stiffness.needle_contact_stiffness(np.array(10.0), np.array(1.0)) == pytest.approx(
        8.15e4 * 10 ** (8 / 9)
    )


def test_stiffer_steel_scales_the_constants():
    """Contract: proportional to E / (1 - nu^2)."""
    elastic = contact_stiffness.elastic_factor(np.array(414e3), np.array(0.3))
    assert elastic == pytest.approx(2)
    assert contact_stiffness.groove_contact_stiffness(np.array(0.44), np.array(0.063), elastic) == pytest.approx(
        2 * contact_stiffness.groove_contact_stiffness(np.array(0.44), np.array(0.063), np.array(1.0))
    )
    assert contact_stiffness.needle_contact_stiffness(np.array(10.0), elastic) == pytest.approx(
        2 * contact_stiffness.needle_contact_stiffness(np.array(10.0), np.array(1.0))
    )


def loads(shift, clearance, stiffness, count, rotation):
    """Plain sum over real needles, the load zone's oracle; of several shifts, clearances or rotations each."""
    shift, clearance, rotation = (np.asarray(each)[..., None] for each in (shift, clearance, rotation))
    angle = rotation + 2 * np.pi * np.arange(count) / count
    pressed = np.maximum(shift * np.cos(angle) - clearance, 0)
    load = stiffness * (pressed / 2) ** (10 / 9)
    return (load * np.cos(angle)).sum(axis=-1), load.sum(axis=-1), load.max(axis=-1)


@pytest.mark.parametrize("clearance", [0.0, 0.002, 0.015])
def test_load_zone_agrees_with_the_sum_over_needles(clearance):
    """Exact physics, needles counted one by one and averaged over their position; 2 % is their ripple."""
    stiffness, count, load = 6.3e5, 27, 800.0
    kappa, penetration = contact_stiffness.bearing_load_zone(load, clearance, stiffness, count)
    shift = clearance + 2 * penetration
    sums = np.mean(
        [loads(shift, clearance, stiffness, count, a) for a in np.linspace(0, 2 * np.pi / count, 50)], axis=0
    )
    assert sums[0] == pytest.approx(load, rel=2e-3)
    assert sums[1] / sums[0] == pytest.approx(kappa, rel=2e-3)


def test_load_zone_limits():
    """Published number: 4.08 F/Z is the largest needle load without clearance (handbooks; 4.085 for m = 10/9)."""
    stiffness = 6.3e5
    kappa, penetration = contact_stiffness.bearing_load_zone(800.0, 0.0, stiffness, 27)
    assert stiffness * penetration ** (10 / 9) == pytest.approx(4.085 * 800 / 27, rel=1e-3)
    assert kappa == pytest.approx(1.258, abs=1e-3)
    assert contact_stiffness.bearing_load_zone(800.0, 0.4, stiffness, 27)[0] == pytest.approx(1, abs=5e-3)
    preloaded, _ = contact_stiffness.bearing_load_zone(800.0, -0.005, stiffness, 27)
    assert preloaded > 5


@pytest.mark.parametrize("clearance", [0.005, 0.03])
def test_a_straight_bearing_tilts_as_its_spheres_stand_along_its_needles(clearance):
    """Exact: the load zone is that without offset, and the tilt that of seven rings of equal stiffness."""
    stiffness, load, offset = 6.3e5, 800.0, 1e-3
    kappa, penetration = contact_stiffness.bearing_load_zone(load, clearance, stiffness, 27)
    along = (
        (contact_stiffness.bearing_load_zone(1.001 * load, clearance, stiffness, 27)[1] - penetration)
        * 2
        / (1e-3 * load)
    )
    found = turned_bearing(load, offset, 1e-3 * load, NeedleRow(clearance, stiffness, 27.0, 10.0, 7.0, 0.0))
    assert found[:2] == pytest.approx((kappa, clearance + 2 * penetration), rel=1e-6)
    spread = 10.0**2 / 12 * (1 - 1 / 7**2)
    assert found[2] == pytest.approx(load * offset * along / spread, rel=1e-3)
    assert found[3] == pytest.approx(1e-3 * found[1] / spread, rel=1e-4)


def test_a_crowned_needle_rocks_on_its_crown():
    """Limit: under little load a crown of radius l^2 / 8h on both sides rolls by x as it tilts by 16 h x / l^2.

    Of 41 spheres; those of the usual seven are steps of 1.4 mm.
    """
    for offset in (1.0, 2.0, 3.0):
        tilt = turned_bearing(200.0, offset, 0.0, NeedleRow(0.015, 6.3e5, 27.0, 10.0, 41.0, 0.01))[2]
        assert tilt == pytest.approx(16 * 0.01 * offset / 10.0**2, rel=0.03)


@pytest.mark.parametrize("lever", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("crown", [0.0, 0.002, 0.01])
def test_a_load_far_off_the_middle_and_a_moment_are_found(crown, lever):
    """Exact: what the rings carry has its sum and its moments, whatever is asked for."""
    stations = 10.0 * ((np.arange(7) + 0.5) / 7 - 0.5)
    rooms, turns = 0.03 + 8 * crown * stations**2 / 100, np.linspace(0, 2 * np.pi / 27, 200, endpoint=False)
    for load, offset in itertools.product((50.0, 500.0, 5000.0), (0.0, 2.0, 3.5)):
        shift, tilt, yaw = turned_bearing(load, offset, lever * load, NeedleRow(0.03, 6.3e5, 27.0, 10.0, 7.0, crown))[
            1:
        ]

        def carried(centre, shift=shift, tilt=tilt, yaw=yaw):
            moved = shift + tilt * stations + 1j * yaw * (stations - centre)
            size = loads(abs(moved), rooms, 6.3e5 / 7, 27, turns[:, None])[0].mean(axis=0)
            return size * moved / abs(moved)

        centre = brentq(lambda place: carried(place).imag.sum(), -5, 5) if lever else 0.0
        rings = carried(centre)
        assert rings.real.sum() == pytest.approx(load, rel=2e-3)
        assert np.dot(rings.real, stations) == pytest.approx(offset * load, rel=2e-3, abs=2e-3 * load)
        assert np.dot(rings.imag, stations) == pytest.approx(lever * load, rel=5e-3)
