"""A still drawing of the joint to scale, from its parameters: along the input axis, and a roller on its trunnion."""

from collections.abc import Mapping

import numpy as np

from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.model_interface import Value

_WIDTH, _HEIGHT = 720.0, 340.0


def joint_drawing(parameters: Mapping[str, Value]) -> str:
    """The drawing as SVG, 720 by 340 units; colours follow the page (currentColor), sizes are stated below it."""
    values = point_values(parameters).point(0)
    reach = values.pitch_radius + values.groove_radius
    scale = min(0.44 * _HEIGHT / reach, 0.2 * _WIDTH / values.roller_radius)
    scaled = f'scale({scale:.5g})" stroke-width="{1 / scale:.4g}">'
    parts = [
        f'<g transform="translate({0.26 * _WIDTH:g} {0.46 * _HEIGHT:g}) {scaled}',
        f'<circle r="{1.04 * reach:.5g}"/>',
        *(f'<g transform="rotate({-120 * k})">{_in_plane(values)}</g>' for k in range(3)),
        "</g>",
        f'<g transform="translate({0.74 * _WIDTH:g} {0.46 * _HEIGHT:g}) {scaled}',
        _section(values),
        "</g>",
    ]
    sizes = (
        f"pitch radius {values.pitch_radius:g}, roller radius {values.roller_radius:g}, width {values.roller_width:g}; "
        f"{values.needle_count:g} needles of {values.needle_diameter:g} x {values.needle_length:g} mm"
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="The joint to scale: {sizes}" fill="none" stroke="currentColor" font-size="13">'
        + "".join(parts)
        + f'<text x="{_WIDTH / 2:g}" y="{_HEIGHT - 8:g}" text-anchor="middle" fill="currentColor" stroke="none">'
        f"to scale, without joint angle: {sizes}</text></svg>"
    )


def _outline(values: JointValues[float]) -> str:
    """Section of a roller along its axis, x, with the origin in its middle."""
    half = min(values.roller_width / 2, values.roller_radius)
    face = np.sqrt(max(values.roller_radius**2 - half**2, 0.0))
    radius = values.roller_radius
    return (
        f'<path d="M{-half:.5g} {-face:.5g}A{radius:.5g} {radius:.5g} 0 0 1 {half:.5g} {-face:.5g}V{face:.5g}'
        f'A{radius:.5g} {radius:.5g} 0 0 1 {-half:.5g} {face:.5g}Z" fill="currentColor" fill-opacity=".12"/>'
    )


def _in_plane(values: JointValues[float]) -> str:
    """Section of one arm in the plane of the trunnions: groove, roller, trunnion and needles, along x."""
    end = values.pitch_radius + (values.needle_length + values.needle_axial_clearance) / 2
    thick, trunnion, inner = (
        values.needle_diameter,
        values.trunnion_radius,
        values.pitch_radius - values.needle_length / 2,
    )
    needles = "".join(
        f'<rect x="{inner:.5g}" y="{y:.5g}" width="{values.needle_length:.5g}" height="{thick:.5g}"/>'
        for y in (trunnion, -trunnion - thick)
    )
    return (
        f'<circle cx="{values.pitch_radius:.5g}" r="{values.groove_radius:.5g}" stroke-dasharray="1 .6"/>'
        f'<g transform="translate({values.pitch_radius:.5g} 0)">{_outline(values)}</g>'
        f'<rect x="0" y="{-trunnion:.5g}" width="{end:.5g}" height="{2 * trunnion:.5g}" fill="currentColor" '
        f'fill-opacity=".25"/>{needles}'
    )


def _section(values: JointValues[float]) -> str:
    """Section across a roller's axis: groove, roller, bore, needles and trunnion."""
    angles = 2 * np.pi * np.arange(int(values.needle_count)) / values.needle_count
    needles = "".join(
        f'<circle cx="{values.bearing_radius * np.cos(a):.5g}" cy="{values.bearing_radius * np.sin(a):.5g}" '
        f'r="{values.needle_radius:.5g}"/>'
        for a in angles
    )
    return (
        f'<circle r="{values.groove_radius:.5g}" stroke-dasharray="1 .6"/>'
        f'<circle r="{values.roller_radius:.5g}" fill="currentColor" fill-opacity=".12"/>'
        f'<circle r="{values.bore_radius:.5g}"/>'
        f'<circle r="{values.trunnion_radius:.5g}" fill="currentColor" fill-opacity=".25"/>{needles}'
    )
