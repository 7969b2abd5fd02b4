"""Whether solid parts are in each other's place: against points sampled in the bodies, and joints nobody can build."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.geometry.feasibility import misfits

TURNED = 2 * np.pi / 3

IMPOSSIBLE = [
    ({"roller_radius_mm": 40, "pitch_radius_mm": 20.5}, "rollers overlap"),
    ({"roller_radius_mm": 30}, "rollers overlap"),
    ({"roller_radius_mm": 80}, "rollers overlap"),
    ({"pitch_radius_mm": 13}, "rollers overlap"),
    ({"pitch_radius_mm": 5}, "rollers overlap"),
    ({"pitch_radius_mm": 14.1, "joint_angle_deg": 35}, "rollers overlap"),
    ({"roller_radius_mm": 20, "roller_width_mm": 14, "pitch_radius_mm": 16}, "rollers overlap"),
    ({"roller_radius_mm": 34, "roller_width_mm": 3}, "rollers overlap"),
    ({"roller_width_mm": 30}, "rollers reach the spider"),
    ({"roller_width_mm": 34, "roller_radius_mm": 20}, "rollers reach the spider"),
    ({"roller_width_mm": 20, "pitch_radius_mm": 16, "roller_radius_mm": 14}, "rollers reach the spider"),
    ({"roller_width_mm": 40}, "wider than its sphere"),
    ({"roller_width_mm": 32}, "wider than its sphere"),
    ({"roller_width_mm": 80, "roller_radius_mm": 20, "pitch_radius_mm": 80}, "wider than its sphere"),
    ({"roller_width_mm": 25, "roller_radius_mm": 12, "pitch_radius_mm": 30}, "wider than its sphere"),
    ({"roller_radius_mm": 9}, "bore is larger"),
    ({"needle_pitch_diameter_mm": 40}, "bore is larger"),
    ({"needle_pitch_diameter_mm": 30}, "bore is larger"),
    ({"needle_diameter_mm": 10, "needle_count": 1, "needle_pitch_diameter_mm": 24}, "bore is larger"),
    ({"groove_radius_ratio": 1.9, "pitch_radius_mm": 17}, "no flank"),
    ({"groove_radius_ratio": 1.7, "pitch_radius_mm": 15}, "no flank"),
    ({"groove_radius_ratio": 2, "roller_radius_mm": 30, "pitch_radius_mm": 32}, "no flank"),
    ({"needle_length_mm": 30}, "groove's wall"),
    ({"needle_length_mm": 27}, "groove's wall"),
    ({"needle_length_mm": 80, "pitch_radius_mm": 80}, "groove's wall"),
    ({"needle_pitch_diameter_mm": 24, "needle_length_mm": 22, "roller_width_mm": 16}, "groove's wall"),
    ({"needle_length_mm": 12, "pitch_radius_mm": 26, "joint_angle_deg": 40}, "groove's wall"),
    ({"needle_length_mm": 20, "needle_axial_clearance_mm": 5, "joint_angle_deg": 20}, "groove's wall"),
    ({"needle_length_mm": 24, "pitch_radius_mm": 15}, "neighbouring trunnions meet"),
    ({"needle_length_mm": 23}, "outside of its roller"),
    ({"needle_length_mm": 10, "roller_width_mm": 4}, "outside of its roller"),
    ({"bearing_radial_clearance_mm": 0.5, "needle_diameter_mm": 0.4}, "climb over"),
    ({"needle_crown_um": 100, "needle_diameter_mm": 0.2}, "crown of the needles"),
    ({"shaft_length_mm": 50, "roller_radius_mm": 25, "pitch_radius_mm": 60, "joint_angle_deg": 25}, "outboard joint"),
    ({"shaft_length_mm": 60, "pitch_radius_mm": 60, "joint_angle_deg": 39}, "outboard joint"),
    ({"needle_count": 28}, "needle_pitch_diameter_mm to 17.87 or more"),
    ({"needle_diameter_mm": 2.1}, "do not fit on the pitch circle"),
    ({"needle_diameter_mm": 9, "needle_pitch_diameter_mm": 8}, "trunnion has no diameter"),
    ({"initial_skew_2_deg": -4.6}, "skewed by initial_skew_2_deg"),
    ({"bearing_radial_clearance_mm": -0.05}, "contact pressure"),
]


@pytest.mark.parametrize(("given", "reason"), IMPOSSIBLE)
def test_joints_that_cannot_exist_are_refused_with_what_to_change(internal_points, given, reason):
    """Geometry: one of the reasons names what is in whose place, by how much, and a parameter of those given."""
    texts = [text for _, text in misfits(internal_points(**given)) if reason in text]
    assert len(texts) == 1, [text for _, text in misfits(internal_points(**given))]
    assert any(name in texts[0] for name in given)
    assert any(digit.isdigit() for digit in texts[0].replace("initial_skew_2_deg", ""))


def clouds(radius, width):
    """Points of a roller in its own axes (along its trunnion, across it, along the input axis), shape (point, 3)."""
    along = np.linspace(-width / 2, width / 2, 25)
    around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    x, angle = np.meshgrid(along, around)
    rim = np.sqrt(np.maximum(radius**2 - x**2, 0.0))
    rings = [np.stack([x, share * rim * np.cos(angle), share * rim * np.sin(angle)], -1) for share in (1.0, 0.8)]
    return np.concatenate([points.reshape(-1, 3) for points in rings])


def overlap(pitch, radius, width, theta):
    """Deepest place of a point of roller 1 in roller 2 over a revolution, from bodies around crossing axes."""
    eccentricity = pitch * (1 / np.cos(theta) - 1) / 2
    points, deepest = clouds(radius, width), -np.inf
    for phi in np.linspace(0, 2 * np.pi, 60, endpoint=False):
        first, second = (pitch + eccentricity * (1 + 2 * np.cos(2 * (phi + shift))) for shift in (0.0, TURNED))
        x, y, z = (points + np.array([first, 0, 0])).T
        along = x * np.cos(TURNED) + y * np.sin(TURNED) - second
        across = np.hypot(-x * np.sin(TURNED) + y * np.cos(TURNED), z)
        inside = np.minimum(width / 2 - np.abs(along), radius - np.hypot(along, across))
        deepest = max(deepest, inside.max())
    return deepest


@pytest.mark.slow
def test_four_hundred_joints_of_the_field_are_refused_where_their_rollers_overlap(internal_points):
    """Exact geometry: within 0.3 mm, which is what the distance of the sampled points leaves open."""
    rng = np.random.default_rng(3)
    pitch, radius = rng.uniform(15, 26, 420), rng.uniform(12, 20, 420)
    width, angle = rng.uniform(8, 14, 420), rng.uniform(0.5, 20, 420)
    found = misfits(
        internal_points(
            pitch_radius_mm=pitch,
            roller_radius_mm=radius,
            roller_width_mm=width,
            joint_angle_deg=angle,
            needle_length_mm=rng.uniform(7.5, 12.5, 420),
            groove_radius_ratio=rng.uniform(1.004, 1.02, 420),
            bearing_radial_clearance_mm=rng.uniform(0, 0.05, 420),
            initial_skew_1_deg=rng.uniform(-2, 2, 420),
            torque_n_m=rng.uniform(-500, 500, 420),
        )
    )
    refused = {row for row, _ in found}
    depths = [overlap(*each) for each in zip(pitch, radius, width, np.radians(angle), strict=True)]
    assert all(depth > -0.3 for row, depth in enumerate(depths) if row in refused)
    assert all(depth < 0.3 for row, depth in enumerate(depths) if row not in refused)
    assert 400 <= 420 - len(refused) < 420


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_rollers_overlap_from_where_their_bodies_do(internal_points, angle):
    """Exact geometry, beside points sampled in the bodies: the pitch radius at which neighbours touch."""
    borders = []
    for touches in (
        lambda pitch: bool(misfits(internal_points(pitch_radius_mm=pitch, joint_angle_deg=angle))),
        lambda pitch: overlap(pitch, 16.0, 11.0, np.radians(angle)) > 0,
    ):
        inside, outside = 12.0, 20.0
        for _ in range(14):
            middle = (inside + outside) / 2
            inside, outside = (middle, outside) if touches(middle) else (inside, middle)
        borders.append(inside)
    assert borders[0] == pytest.approx(borders[1], abs=0.1)
