"""Ideal kinematics: exact physics, held against the geometry it claims to solve."""

from __future__ import annotations

import numpy as np
import pytest
from reference import spider

from tripod_doe.joint.geometry.kinematics import ideal_motion


@pytest.mark.parametrize("theta_deg", [0.5, 10, 35])
@pytest.mark.parametrize("phi", [0.0, 0.4, 2.0, 5.1])
def test_closed_form_solves_three_axes_through_three_axes(theta_deg, phi):
    theta, pitch, omega, step = np.radians(theta_deg), 21.0, 60.0, 1e-4

    def solved(angle):
        return spider(angle, theta, pitch)

    centre, d, t, distance, _ = solved(phi)
    eccentricity = pitch * (1 / np.cos(theta) - 1) / 2
    assert np.linalg.norm(centre) == pytest.approx(eccentricity, abs=1e-10)
    for k in range(3):
        angle = phi + 2 * np.pi / 3 * k
        m = ideal_motion(np.cos(angle), np.sin(angle), np.cos(theta), np.sin(theta), pitch, omega)
        frame = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        assert [m.t_r, m.t_t, m.t_z] == pytest.approx(frame @ t[k], abs=1e-12)
        assert [m.w_r, m.w_t, m.w_z] == pytest.approx(frame @ (omega * (d - [0, 0, 1])), abs=1e-10)
        assert m.distance == pytest.approx(distance[k], abs=1e-10)
        up, down = solved(phi + step), solved(phi - step)
        assert m.along_trunnion == pytest.approx((up[3][k] - down[3][k]) / (2 * step) * omega, abs=1e-4)
        assert m.along_groove == pytest.approx((up[4][k] - down[4][k]) / (2 * step) * omega, abs=1e-4)


def test_reference_point_moves_as_facts_says():
    """Published number: FACTS, 233 mm/s along the groove, 41 mm/s along the trunnion."""
    theta, omega = np.radians(10), 600 * 2 * np.pi / 60
    quarter = ideal_motion(0.0, 1.0, np.cos(theta), np.sin(theta), 21.0, omega)
    eighth = ideal_motion(np.sqrt(0.5), np.sqrt(0.5), np.cos(theta), np.sin(theta), 21.0, omega)
    assert quarter.along_groove == pytest.approx(233, abs=0.5)
    assert abs(eighth.along_trunnion) == pytest.approx(41, abs=0.5)
