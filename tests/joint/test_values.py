"""Values inside the joint: each parameter converted once, what follows from others, and the sizes derived from them."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from tripod_doe.joint.geometry.feasibility import infeasible
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.values import JointValues


@pytest.mark.parametrize(
    ("name", "given", "field", "expected"),
    [
        ("joint_angle_deg", 9.0, "joint_angle", np.pi / 20),
        ("torque_n_m", -50.0, "torque", -5e4),
        ("speed_rpm", 600.0, "speed", 20 * np.pi),
        ("needle_crown_um", 5.0, "needle_crown", 5e-3),
        ("shaft_mass_kg", 2.0, "shaft_mass", 2e-3),
        ("output_inertia_kg_m2", 0.01, "output_inertia", 10.0),
        ("density_kg_m3", 7850.0, "density", 7.85e-9),
        ("youngs_modulus_gpa", 207.0, "youngs_modulus", 207e3),
        ("roller_radius_mm", 16.5, "roller_radius", 16.5),
        ("groove_transition_velocity_mm_s", 5.0, "groove_transition_velocity", 5.0),
        ("contact_damping_s_per_mm", 0.002, "contact_damping", 0.002),
        ("contact_damping_time_s", 2e-6, "contact_damping_time", 2e-6),
        ("step_s", 1e-5, "step", 1e-5),
    ],
)
def test_a_field_is_its_parameter_in_internal_units(name, given, field, expected):
    """Exact: mm, N, s, t, rad; the factors are powers of ten but for angles."""
    assert getattr(point_values({name: given}).point(0), field) == pytest.approx(expected, rel=1e-15)


def test_every_field_but_the_contact_constants_is_named_as_a_parameter():
    names = {field.name for field in fields(JointValues)} - {
        "groove_stiffness",
        "groove_axis_factor",
        "needle_stiffness",
    }
    units = ("", "_deg", "_n_m", "_rpm", "_um", "_kg", "_kg_m2", "_kg_m3", "_gpa", "_mm", "_mm_s", "_s", "_s_per_mm")
    assert all(any(name + unit in JOINT_PARAMETERS for unit in units) for name in names)


def test_what_is_not_given_follows_from_another_parameter():
    values = point_values({"groove_sliding_friction": 0.07, "roller_radius_mm": 15.0}).point(0)
    assert (values.groove_spin_friction, values.groove_rolling_lever) == (0.07, 15.0)
    own = point_values({"groove_spin_friction": 0.02, "groove_rolling_lever_mm": 3.0}).point(0)
    assert (own.groove_spin_friction, own.groove_rolling_lever) == (0.02, 3.0)


@pytest.mark.parametrize(
    ("given", "damping"),
    [
        ({}, (8e-6, 0.0)),
        ({"contact_damping_s_per_mm": 0.001}, (0.0, 0.001)),
        ({"contact_damping_s_per_mm": 0.0}, (8e-6, 0.0)),
        ({"contact_damping_time_s": 0.0}, (0.0, 0.0)),
        ({"contact_damping_time_s": 1e-5, "contact_damping_s_per_mm": 0.001}, (1e-5, 0.001)),
    ],
)
def test_contacts_are_greased_unless_they_are_dry(given, damping):
    values = point_values(given)
    assert (values.contact_damping_time[0], values.contact_damping[0]) == damping
    assert (0 in infeasible(values)) == (min(damping) > 0)  # not both
    full = simulator.effective({"model": "rollers"} | given)
    assert (full["contact_damping_time_s"], full["contact_damping_s_per_mm"]) == damping


@pytest.mark.parametrize(
    ("switch", "coefficient"),
    [
        ("groove_sliding", "groove_sliding_friction"),
        ("groove_spinning", "groove_spin_friction"),
        ("groove_rolling", "groove_rolling_friction"),
        ("needle_sliding", "needle_sliding_friction"),
        ("needle_rolling", "needle_rolling_friction"),
    ],
)
def test_a_switch_sets_its_own_coefficient_to_zero(switch, coefficient):
    on, off = point_values({}).point(0), point_values({switch: 0}).point(0)
    assert getattr(off, coefficient) == 0
    changed = {field.name for field in fields(on) if not _same(getattr(on, field.name), getattr(off, field.name))}
    assert changed == {coefficient}


def _same(one, other):
    return one == other or (one != one and other != other)


def test_derived_sizes():
    """Exact: by hand at round numbers."""
    values = point_values(
        {
            "torque_n_m": -63.0,
            "pitch_radius_mm": 21.0,
            "needle_pitch_diameter_mm": 18.0,
            "needle_diameter_mm": 2.5,
            "bearing_radial_clearance_mm": 0.5,
            "roller_radius_mm": 16.0,
            "groove_radius_ratio": 1.25,
            "initial_skew_1_deg": 1.0,
            "initial_skew_3_deg": -2.0,
        }
    ).point(0)
    assert values.groove_load == 1000
    assert (values.groove_radius, values.groove_play) == (20, 4)
    assert (values.needle_radius, values.bearing_radius) == (1.25, 9)
    assert (values.trunnion_radius, values.bore_radius) == (7.75, 10.75)
    assert np.degrees(values.initial_skews) == pytest.approx([1, 0, -2])


def test_points_of_a_block_are_those_alone(internal_points):
    """Invariance, bit for bit: contact constants of a point do not depend on its neighbours."""
    given = {"roller_radius_mm": np.array([14.0, 16.0, 17.0]), "torque_n_m": np.array([10.0, 20.0, -30.0])}
    block = internal_points(**given)
    part = block.take(np.array([2, 0]))
    for k, row in enumerate((2, 0)):
        alone = internal_points(**{name: float(column[row]) for name, column in given.items()}).point(0)
        for field in fields(alone):
            assert _same(getattr(part.point(k), field.name), getattr(alone, field.name)), field.name
