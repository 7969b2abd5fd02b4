"""The bearing that is turned by a load off its middle, against its needles one by one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from needle_sums import loads
from scipy.optimize import brentq

from tripod_doe.joint.derived_constants import load_zone
from tripod_doe.joint.massless_needles.bearing_tilt import NeedleRow, turned_bearing


@pytest.mark.parametrize("clearance", [0.005, 0.03])
def test_a_straight_bearing_tilts_as_its_spheres_stand_along_its_needles(clearance):
    """Exact: the load zone is that without offset, and the tilt that of seven rings of equal stiffness."""
    stiffness, load, offset = 6.3e5, 800.0, 1e-3
    kappa, penetration = load_zone.bearing_load_zone(load, clearance, stiffness, 27)
    along = (load_zone.bearing_load_zone(1.001 * load, clearance, stiffness, 27)[1] - penetration) * 2 / (1e-3 * load)
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
