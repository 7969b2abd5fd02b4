"""Exact physics: with Hertz' contacts of linear elasticity, twice the torque, stiffness and mass give twice the forces."""

from __future__ import annotations

import numpy as np
import pytest

import tripod_doe as td

JOINT = {
    "joint_angle_deg": 9.0, "torque_n_m": 70.0, "speed_rpm": 450.0, "initial_skew_1_deg": 0.3,
    "youngs_modulus_gpa": 190.0, "density_kg_m3": 7700.0, "shaft_mass_kg": 1.6, "output_inertia_kg_m2": 0.012,
}  # fmt: skip
SCALED = ("torque_n_m", "youngs_modulus_gpa", "density_kg_m3", "shaft_mass_kg", "output_inertia_kg_m2")


@pytest.mark.parametrize(
    ("model", "apart"),
    [("equilibrium", 1e-9), ("kinetostatic", 1e-6), pytest.param("rollers", 1e-4, marks=pytest.mark.slow)],
)
def test_twice_the_torque_stiffness_and_mass_leaves_angles_and_ratios(model, apart):
    """A contact force in proportion to E^(10/9), as it was once, would change penetrations and so phases and ratios."""
    one, two = (
        td.simulate(model=model, **JOINT | {name: factor * JOINT[name] for name in SCALED}) for factor in (1.0, 2.0)
    )
    size = one["thrust_amplitude"].values
    assert two["thrust_amplitude"].values == pytest.approx(2 * size, rel=apart, abs=apart * size.max())
    seen = size > 1e-2 * size.max()
    turned = (two["thrust_phase_deg"].values - one["thrust_phase_deg"].values + 180) % 360 - 180
    assert np.abs(turned[seen]).max() < 1e3 * apart
    skew = "needle_skew_summary_deg"
    if skew in one:
        assert two[skew].values == pytest.approx(one[skew].values, abs=10 * apart, nan_ok=True)


LENGTHS = {
    "pitch_radius_mm": 21.0, "roller_radius_mm": 16.0, "roller_width_mm": 11.0, "needle_diameter_mm": 2.0,
    "needle_length_mm": 10.0, "needle_pitch_diameter_mm": 17.28, "bearing_radial_clearance_mm": 0.015,
    "needle_axial_clearance_mm": 0.2, "shaft_length_mm": 350.0,
}  # fmt: skip


@pytest.mark.parametrize(("model", "apart"), [("equilibrium", 1e-9), ("kinetostatic", 1e-9)])
def test_a_joint_of_another_size_has_forces_by_its_square(model, apart):
    """Exact: with all lengths and times multiplied by L, velocities and stresses stay, and forces go with L squared."""
    size = 1.37
    one = td.simulate(model=model, **JOINT, **LENGTHS)
    scaled = JOINT | {name: size * value for name, value in LENGTHS.items()}
    for name, power in (("torque_n_m", 3), ("speed_rpm", -1), ("shaft_mass_kg", 3), ("output_inertia_kg_m2", 5)):
        scaled[name] = JOINT[name] * size**power
    other, amplitude = td.simulate(model=model, **scaled), one["thrust_amplitude"].values
    assert other["thrust_amplitude"].values == pytest.approx(
        size**2 * amplitude, rel=apart, abs=apart * amplitude.max()
    )
