"""Mass and moments of inertia of a roller: those of the solid, sliced by quadrature."""

from __future__ import annotations

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.joint.derived_constants.roller_inertia import roller_inertia


@pytest.mark.parametrize("bore", [0.0, 9.0, 11.0, 11.9])
def test_a_roller_has_the_inertia_of_a_zone_of_a_sphere_with_a_bore(bore):
    """Exact: a sphere of 12 mm, 13 mm wide, whose faces have a radius of 10.1 mm: wider bores end it before."""
    radius, width, density = 12.0, 13.0, 8e-9
    x, step = np.linspace(-width / 2, width / 2, 400_001, retstep=True)
    outer, inner = np.maximum(radius**2 - x**2, bore**2), bore**2
    disk, polar = np.pi * (outer - inner), np.pi / 2 * (outer**2 - inner**2)
    expected = [disk, polar, polar / 2 + disk * x**2]
    found = roller_inertia(*np.array([radius, width, bore, density]))
    np.testing.assert_allclose(found, [density * step * each.sum() for each in expected], rtol=2e-5)


@pytest.mark.parametrize("model", ["kinetostatic", "rollers"])
def test_a_roller_whose_bore_is_wider_than_its_faces_is_run(model):
    """Regression: its mass was negative, which ended a study of `rollers` with an error."""
    result = td.simulate(model=model, roller_radius_mm=12, roller_width_mm=14, needle_pitch_diameter_mm=20.5, cycles=2)
    assert result.attrs["finished"], result.attrs["outcome_detail"]
