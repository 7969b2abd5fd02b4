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
