"""Overlaps of the joint's parts at some rotation angle: rollers, needles, trunnions and grooves as solid bodies.

A roller is a sphere of radius R_s, cut w wide across its trunnion's axis and bored: its faces have the radius
sqrt(R_s^2 - w^2/4). A groove is a cylinder of radius R_g at the pitch radius. The trunnion ends at the stops of the
needles, (l + axial clearance) / 2 to both sides of their middle at R_p + e. While the joint turns, a roller is at
R_p + e + 2 e cos(2 phi) on its trunnion (`kinematics`) and stays on its groove's axis, so the ends of the needles move
by 2 e in the groove. Trunnions are 120 deg apart; two bodies around axes that cross are closest in the plane of both.

The shaft has no radius among the parameters: its mass includes the spider. Only the spider between the roots of the
trunnions counts, which the rollers approach most.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.values import JointValues
from tripod_doe.number_text import rounded_down, rounded_up

MARGIN = 1 + 1e-9
"""Factor that keeps a limit in a message on the safe side of rounding errors."""

_PHASES = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
"""Rotation angles at which rollers are checked; between two of them rollers move at most 2 % of their travel."""
_HALF_ANGLE = np.pi / 3
"""Between a trunnion and the plane in the middle to the next one."""


class Overlap(NamedTuple):
    """One way in which parts can overlap."""

    bad: NDArray[np.bool_]  # whether they are, shape (point,)
    reason: Callable[[int], str]  # what overlaps at a point, by how much, and which parameters to change


class _Sizes(NamedTuple):
    """Sizes that several checks share, in mm, shape (point,)."""

    face: FloatArray  # radius of the roller's faces
    eccentricity: FloatArray  # e
    inner_face: FloatArray  # smallest distance of a roller's inner face from the spider's centre, R_p - e - w/2
    ring: FloatArray  # outer radius of the needles, without clearance
    reach: FloatArray  # of trunnion and stops to both sides of the needles' middle


def overlaps(points: JointValues[FloatArray]) -> list[Overlap]:
    """All overlaps of solid parts at some points."""
    eccentricity = points.eccentricity
    half_width = points.roller_width / 2
    sizes = _Sizes(
        np.sqrt(np.maximum(points.roller_radius**2 - half_width**2, 0.0)),
        eccentricity,
        points.pitch_radius - eccentricity - half_width,
        points.trunnion_radius + points.needle_diameter,
        (points.needle_length + points.needle_axial_clearance) / 2,
    )
    return [
        _too_wide(points),
        _rollers(points, sizes),
        _roots(points, sizes),
        _flanks(points),
        _ends_in_groove(points, sizes),
        _needle_rings(points, sizes),
        _bare_needles(points),
        _loose_needles(points),
        _crowns(points),
        _outboard(points),
    ]


def _too_wide(points: JointValues[FloatArray]) -> Overlap:
    """Rollers that end beyond their sphere."""

    def reason(i: int) -> str:
        return (
            f"the roller is wider than its sphere: roller_width_mm = {points.roller_width[i]:.4g} of a sphere of "
            f"{2 * points.roller_radius[i]:.4g} mm: reduce roller_width_mm, or raise roller_radius_mm"
        )

    return Overlap(points.roller_width >= 2 * points.roller_radius, reason)


def _rollers(points: JointValues[FloatArray], sizes: _Sizes) -> Overlap:
    """Rollers that overlap each other."""
    # as if both were at their innermost position: they first cross the plane between them there
    deepest = _beyond_plane(points, sizes)
    depth = np.zeros_like(deepest)
    for i in np.flatnonzero(deepest > 0):
        depth[i] = _depth_of_rollers(points, float(sizes.face[i]), float(sizes.eccentricity[i]), int(i))

    def reason(i: int) -> str:
        return (
            f"neighbouring rollers overlap by {depth[i]:.3g} mm: roller_radius_mm = {points.roller_radius[i]:.4g}, "
            f"{points.roller_width[i]:.4g} mm wide, at pitch_radius_mm = {points.pitch_radius[i]:.4g}: raise "
            "pitch_radius_mm, or reduce roller_radius_mm or roller_width_mm"
        )

    return Overlap(depth > 0, reason)


def _beyond_plane(points: JointValues[FloatArray], sizes: _Sizes) -> FloatArray:
    """Reach of an innermost roller beyond the middle plane to the next one; negative before the plane."""
    towards = _support(-np.sin(_HALF_ANGLE), np.cos(_HALF_ANGLE), points.roller_radius, points.roller_width, sizes.face)
    beyond: FloatArray = towards - (points.pitch_radius - sizes.eccentricity) * np.sin(_HALF_ANGLE)
    return beyond


def _support(along: Any, across: Any, radius: FloatArray, width: FloatArray, face: FloatArray | float) -> FloatArray:
    """Extent of a roller from its centre in a direction with these parts along and across its axis."""
    on_sphere = np.abs(along) * radius <= width / 2
    at_face = width / 2 * np.abs(along) + face * np.abs(across)
    return np.where(on_sphere, radius, np.minimum(at_face, radius))


def _depth_of_rollers(points: JointValues[FloatArray], face: float, eccentricity: float, i: int) -> float:
    """Deepest overlap of rollers 1 and 2 of a point in a revolution, from trial separating planes; 0 if separate."""
    turned = 2 * np.pi / 3
    # normals of planes, from roller 1 to roller 2: within 50 deg of the plane in the middle, 0.02 mm apart at a face
    angle = np.radians(np.linspace(100.0, 200.0, 1001))[:, None]
    radius, width = points.roller_radius[i], points.roller_width[i]
    along = [np.cos(angle - axis) for axis in (0.0, turned)]  # parts of the normals along both trunnions
    across = [np.sin(angle - axis) for axis in (0.0, turned)]
    reach = sum(_support(*parts, radius, width, face) for parts in zip(along, across, strict=True))
    first, second = (
        points.pitch_radius[i] + eccentricity * (1 + 2 * np.cos(2 * (_PHASES + shift))) for shift in (0.0, turned)
    )
    between = second * along[1] - first * along[0]  # of the centres, along the normal
    return max(float((reach - between).min(axis=0).max()), 0.0)


def _roots(points: JointValues[FloatArray], sizes: _Sizes) -> Overlap:
    """Rollers that overlap the spider, where the trunnions meet."""
    nearest = points.trunnion_radius * np.sin(_HALF_ANGLE)

    def reason(i: int) -> str:
        return (
            f"the rollers reach the spider: their inner faces come to {sizes.inner_face[i]:.3g} mm from its centre, "
            f"where trunnions of radius {points.trunnion_radius[i]:.4g} mm meet within {nearest[i]:.4g} mm: raise "
            "pitch_radius_mm, or reduce roller_width_mm or needle_pitch_diameter_mm"
        )

    return Overlap(sizes.inner_face < nearest, reason)


def _flanks(points: JointValues[FloatArray]) -> Overlap:
    """Flank of a groove in the hollow of the next one."""
    aside = points.pitch_radius * np.sin(_HALF_ANGLE) - points.groove_radius
    left = np.hypot(1.5 * points.pitch_radius, aside) - points.groove_radius

    def reason(i: int) -> str:
        return (
            f"the housing has no flank to roll on: grooves of radius {points.groove_radius[i]:.4g} mm at "
            f"pitch_radius_mm = {points.pitch_radius[i]:.4g} cut {-left[i]:.3g} mm into each other's flanks: raise "
            "pitch_radius_mm, or reduce roller_radius_mm or groove_radius_ratio"
        )

    return Overlap(left < 0, reason)


def _ends_in_groove(points: JointValues[FloatArray], sizes: _Sizes) -> Overlap:
    """Outer ends of needles, or their stops, in the groove's wall; ends are rounded, so that their middles count."""
    outer = sizes.reach + 2 * sizes.eccentricity
    deep = np.hypot(outer, points.bearing_radius) - points.groove_radius

    def reason(i: int) -> str:
        return (
            f"the outer ends of the needles reach {deep[i]:.3g} mm into the groove's wall: they come to {outer[i]:.4g} "
            f"mm from the groove's axis, on a circle of radius {points.bearing_radius[i]:.4g} mm, in a groove of "
            f"radius {points.groove_radius[i]:.4g} mm: reduce needle_length_mm (now {points.needle_length[i]:.4g}), "
            "needle_axial_clearance_mm, needle_pitch_diameter_mm or joint_angle_deg, or raise roller_radius_mm"
        )

    return Overlap(deep > 0, reason)


def _needle_rings(points: JointValues[FloatArray], sizes: _Sizes) -> Overlap:
    """Inner needle ends of two trunnions that overlap."""
    inner = points.pitch_radius + sizes.eccentricity - sizes.reach
    gap = inner - np.maximum(sizes.ring / np.tan(_HALF_ANGLE), points.trunnion_radius * np.sin(_HALF_ANGLE))

    def reason(i: int) -> str:
        return (
            f"the needles of neighbouring trunnions meet: their inner ends are {inner[i]:.3g} mm from the spider's "
            f"centre, {-gap[i]:.3g} mm too near for a radius of {sizes.ring[i]:.4g} mm: reduce needle_length_mm (now "
            f"{points.needle_length[i]:.4g}), needle_axial_clearance_mm or needle_pitch_diameter_mm, or raise "
            "pitch_radius_mm"
        )

    return Overlap(gap < 0, reason)


def _bare_needles(points: JointValues[FloatArray]) -> Overlap:
    """Needles that are mostly outside of the roller; the models load them over their whole length."""

    def reason(i: int) -> str:
        return (
            f"more than half of each needle is outside of its roller: needle_length_mm = {points.needle_length[i]:.4g} "
            f"in a bore roller_width_mm = {points.roller_width[i]:.4g} wide: reduce needle_length_mm to "
            f"{rounded_down(2 * points.roller_width[i], 4)} or less, or raise roller_width_mm"
        )

    return Overlap(points.needle_length > 2 * points.roller_width, reason)


def _loose_needles(points: JointValues[FloatArray]) -> Overlap:
    """Needles that can pass over each other."""

    def reason(i: int) -> str:
        return (
            f"needles can climb over each other: bearing_radial_clearance_mm = "
            f"{points.bearing_radial_clearance[i]:.4g} is not below needle_diameter_mm = "
            f"{points.needle_diameter[i]:.4g}: reduce bearing_radial_clearance_mm, or raise needle_diameter_mm"
        )

    return Overlap(points.bearing_radial_clearance >= points.needle_diameter, reason)


def _crowns(points: JointValues[FloatArray]) -> Overlap:
    """Crowns that leave nothing of a needle's end."""

    def reason(i: int) -> str:
        return (
            f"the crown of the needles, {1e3 * points.needle_crown[i]:.4g} um, is not below their radius of "
            f"{1e3 * points.needle_radius[i]:.4g} um: reduce needle_crown_um, or raise needle_diameter_mm"
        )

    return Overlap(points.needle_crown >= points.needle_radius, reason)


def _outboard(points: JointValues[FloatArray]) -> Overlap:
    """Rollers that overlap the outboard joint."""
    reach = points.pitch_radius * np.tan(points.joint_angle) + points.roller_radius
    end = points.shaft_length * np.cos(points.joint_angle)

    def reason(i: int) -> str:
        enough = rounded_up(MARGIN * float(reach[i] / np.cos(points.joint_angle[i])))
        return (
            f"the rollers reach {reach[i]:.4g} mm along the input axis, and the outboard joint is at {end[i]:.4g} mm: "
            f"raise shaft_length_mm (now {points.shaft_length[i]:.4g}) to {enough} or more"
        )

    return Overlap(reach >= end, reason)
