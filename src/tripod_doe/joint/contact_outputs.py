"""Outputs of the contacts: forces, slip and pressure in the grooves, and every needle; computed on request only."""

from __future__ import annotations

from collections.abc import Collection

from tripod_doe.joint.output_dimensions import GROOVE, NEEDLE, ROTATION, TRUNNION
from tripod_doe.model_interface import Dimension, Output

_IN_GROOVE, _ON_TRUNNION, _OF_NEEDLE = (GROOVE, ROTATION), (TRUNNION, ROTATION), (TRUNNION, NEEDLE, ROTATION)
_OUTWARD = "positive outward from the joint's axis"


def _output(name: str, unit: str, meaning: str, dimensions: tuple[Dimension, ...], convention: str = "") -> Output:
    """An output of a contact."""
    return Output(name, unit, "", meaning, dimensions, optional=True, on_request=True, convention=convention)


CONTACT_OUTPUTS = [
    _output("groove_normal_force", "N", "normal force between roller and groove", _IN_GROOVE),
    _output("groove_friction_force", "N", "sliding friction between roller and groove, its size", _IN_GROOVE),
    _output("groove_slip", "mm s-1", "sliding velocity between roller and groove, its size", _IN_GROOVE),
    _output(
        "groove_slip_direction_deg",
        "degree",
        "direction in which a roller slides over its groove, against its friction force",
        _IN_GROOVE,
        "0 along the input axis towards the intermediate shaft, 90 outward from the joint's axis",
    ),
    _output(
        "groove_spin",
        "rad s-1",
        "angular velocity of the roller about the normal of its contact with the groove",
        _IN_GROOVE,
        "positive about the normal from the groove into the roller",
    ),
    _output("groove_pressure_mpa", "MPa", "largest pressure in the groove, in the middle of its ellipse", _IN_GROOVE),
    _output(
        "groove_contact_place_mm",
        "mm",
        "place of the contact along the groove, from the joint's centre",
        _IN_GROOVE,
        "positive along the input axis towards the intermediate shaft",
    ),
    _output(
        "groove_contact_angle_deg",
        "degree",
        "place of the contact around the groove, from the middle of its flank",
        _IN_GROOVE,
        _OUTWARD,
    ),
    _output(
        "roller_contact_place_mm",
        "mm",
        "place of the contact with the groove along the roller's axis, from its middle",
        _IN_GROOVE,
        _OUTWARD,
    ),
    _output(
        "roller_place_mm",
        "mm",
        "place of the roller along its trunnion, from the middle of the needles",
        _ON_TRUNNION,
        _OUTWARD,
    ),
    _output(
        "roller_tilt_deg",
        "degree",
        "angle of the roller's axis to its trunnion, across the groove",
        _ON_TRUNNION,
        "positive counterclockwise about the input axis towards the intermediate shaft",
    ),
    _output("needle_pressure_mpa", "MPa", "largest pressure of the needles on their trunnion", _ON_TRUNNION),
    _output("needle_load", "N", "force that presses a needle on its trunnion", _OF_NEEDLE),
    _output(
        "needle_angle_deg",
        "degree",
        "place of a needle around its trunnion, from the side of the loaded flank",
        _OF_NEEDLE,
        "positive counterclockwise about the outward normal of the trunnion, -180 to 180",
    ),
    _output(
        "needle_place_mm",
        "mm",
        "place of a needle along its trunnion, from the middle of the ring",
        _OF_NEEDLE,
        _OUTWARD,
    ),
    _output(
        "needle_yaw_deg",
        "degree",
        "skew of each needle",
        _OF_NEEDLE,
        "positive counterclockwise about the outward normal of the trunnion surface",
    ),
    _output(
        "needle_stop_force",
        "N",
        "force between a needle and a stop",
        _OF_NEEDLE,
        "positive at the outer, negative at the inner stop",
    ),
    _output("largest_groove_pressure_mpa", "MPa", "largest pressure in a groove over the revolution", ()),
    _output("largest_needle_pressure_mpa", "MPa", "largest pressure of a needle over the revolution", ()),
]
"""All contact outputs."""

CONTACT_NAMES = frozenset(output.name for output in CONTACT_OUTPUTS)
NEEDLE_NAMES = frozenset(output.name for output in CONTACT_OUTPUTS if NEEDLE in output.dimensions)
"""Outputs of single needles."""


def wanted_contacts(keep: Collection[str]) -> frozenset[str]:
    """Contact outputs among the requested outputs."""
    return CONTACT_NAMES.intersection(keep)
