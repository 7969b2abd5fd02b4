"""Forces, motion and pressures at the contacts of a multibody run, read from its states if a study requests them."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.contact_outputs import NEEDLE_NAMES
from tripod_doe.joint.derived_constants.contact_pressure import groove_pressure, needle_pressure
from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES
from tripod_doe.joint.multibody.thrust_and_power import has_needle_bodies, ring, turned
from tripod_doe.joint.multibody.thrust_parts import element_forces
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.scene import GROUND, Cylinder, Plane

_Z = np.array([0.0, 0.0, 1.0])
_OUTWARD = np.column_stack([np.cos(GROOVE_ANGLES), np.sin(GROOVE_ANGLES), np.zeros(3)])
_AROUND = np.cross(_Z, _OUTWARD)
_EXPONENT = 10 / 9


def contact_readings(
    assembly: Assembly, positions: FloatArray, velocities: FloatArray, values: JointValues[float], names: frozenset[str]
) -> dict[str, FloatArray]:
    """Outputs of contacts by name.

    Args:
        positions, velocities: States of two revolutions, shapes (sample, body, 7) and (sample, body, 6).
        names: Requested outputs, from `contact_outputs`; the result may contain others.
    """
    if not names:
        return {}
    states = np.ascontiguousarray(positions), np.ascontiguousarray(velocities)
    readings = _grooves(assembly, *states, values)
    readings["groove_pressure_mpa"] = groove_pressure(values, readings["groove_normal_force"])
    readings["largest_groove_pressure_mpa"] = readings["groove_pressure_mpa"].max()
    if {"needle_pressure_mpa", "largest_needle_pressure_mpa"} & names:
        lines = _needle_lines if has_needle_bodies(assembly) else _bearing_lines
        readings["needle_pressure_mpa"] = needle_pressure(values, lines(assembly, positions, values))
        readings["largest_needle_pressure_mpa"] = readings["needle_pressure_mpa"].max()
    if NEEDLE_NAMES & names and has_needle_bodies(assembly):
        readings |= _needles(assembly, *states, values)
    return readings


def _grooves(
    assembly: Assembly, positions: FloatArray, velocities: FloatArray, values: JointValues[float]
) -> dict[str, FloatArray]:
    """Readings of rollers and grooves, each of shape (groove, sample)."""
    rollers = [assembly.names.index(f"roller {k}") for k in (1, 2, 3)]
    place, axis = positions[:, rollers, :3], turned(positions[:, rollers, 3:], _Z)
    off = place - values.pitch_radius * _OUTWARD
    off[..., 2] = 0.0
    towards = off / np.maximum(np.linalg.norm(off, axis=-1, keepdims=True), 1e-12)  # the contact, from the roller
    force = element_forces(assembly, assembly.tables.contacts[-3:], positions, velocities)[:, rollers, :3]
    normal = -(force * towards).sum(-1)
    friction = np.linalg.norm(force + normal[..., None] * towards, axis=-1)
    turning = velocities[:, rollers, 3:]
    slip = velocities[:, rollers, :3] + np.cross(turning, values.roller_radius * towards)
    slip -= (slip * towards).sum(-1, keepdims=True) * towards
    outward = _OUTWARD - (towards * _OUTWARD).sum(-1, keepdims=True) * towards
    outward /= np.maximum(np.linalg.norm(outward, axis=-1, keepdims=True), 1e-12)
    trunnion, along = _on_trunnions(assembly, positions, values, place)
    of_each = {
        "groove_normal_force": normal,
        "groove_friction_force": friction,
        "groove_slip": np.linalg.norm(slip, axis=-1),
        "groove_slip_direction_deg": np.degrees(np.arctan2((slip * outward).sum(-1), slip[..., 2])),
        "groove_spin": -(turning * towards).sum(-1),
        "groove_contact_place_mm": place[..., 2],
        "groove_contact_angle_deg": np.degrees(np.arcsin(np.clip((towards * _OUTWARD).sum(-1), -1, 1))),
        "roller_contact_place_mm": values.roller_radius * (towards * axis).sum(-1),
        "roller_place_mm": along,
        "roller_tilt_deg": np.degrees(np.arcsin(np.cross(trunnion, axis)[..., 2])),
    }
    return {name: np.ascontiguousarray(data.T) for name, data in of_each.items()}


def _on_trunnions(
    assembly: Assembly, positions: FloatArray, values: JointValues[float], place: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Axes of the trunnions, shape (sample, trunnion, 3), and places along them from the middle of the needles."""
    shaft = positions[:, assembly.names.index("shaft")]
    spider = shaft[:, :3] - turned(shaft[:, 3:], 0.5 * values.shaft_length * _Z)
    trunnion = turned(shaft[:, None, 3:], _OUTWARD)
    along = ((place - spider[:, None]) * trunnion).sum(-1) - values.ring_distance
    return trunnion, along


def _bearing_lines(assembly: Assembly, positions: FloatArray, values: JointValues[float]) -> FloatArray:
    """Largest load per length of a needle that lies in the direction of the load: (trunnion, sample), N/mm."""
    rollers = [assembly.names.index(f"roller {k}") for k in (1, 2, 3)]
    place, axis = positions[:, rollers, :3], turned(positions[:, rollers, 3:], _Z)
    shaft = positions[:, assembly.names.index("shaft")]
    spider = shaft[:, :3] - turned(shaft[:, 3:], 0.5 * values.shaft_length * _Z)
    trunnion = turned(shaft[:, None, 3:], _OUTWARD)
    bore = axis / (axis * trunnion).sum(-1, keepdims=True)
    between = place - spider[:, None] - values.ring_distance * trunnion
    offset = between - (between * trunnion).sum(-1, keepdims=True) * bore
    share = _shares(values)
    reach = np.linalg.norm(
        offset[..., None, :] + values.needle_length * share[:, None] * (bore - trunnion)[..., None, :], axis=-1
    )
    clearance = values.bearing_radial_clearance + 8 * values.needle_crown * share**2
    return np.ascontiguousarray(_line_load(values, (reach - clearance) / 2).T)


def _needle_lines(assembly: Assembly, positions: FloatArray, values: JointValues[float]) -> FloatArray:
    """Largest load per length of all needles on their trunnion: (trunnion, sample), N/mm."""
    share, lines = _shares(values), []
    radius = values.needle_radius - 4 * values.needle_crown * share**2
    for k in range(3):
        needles, axis, arms = ring(assembly, positions, values, k)
        spheres = (
            arms[..., None, :] + values.needle_length * share[:, None] * turned(needles[..., 3:], _Z)[..., None, :]
        )
        along = (spheres * axis[:, None]).sum(-1, keepdims=True)
        distance = np.linalg.norm(spheres - along * axis[:, None], axis=-1)
        lines.append(_line_load(values, radius + values.trunnion_radius - distance).max(axis=-1))
    return np.array(lines)


def _shares(values: JointValues[float]) -> FloatArray:
    """Stations of the spheres of a needle over its length."""
    count = int(values.spheres_per_needle)
    shares: FloatArray = (np.arange(count) + 0.5) / count - 0.5
    return shares


def _line_load(values: JointValues[float], depth: FloatArray) -> FloatArray:
    """Largest load per length over the spheres, the last axis of `depth`."""
    line: FloatArray = values.needle_stiffness * np.maximum(depth.max(axis=-1), 0.0) ** _EXPONENT / values.needle_length
    return line


def _needles(
    assembly: Assembly, positions: FloatArray, velocities: FloatArray, values: JointValues[float]
) -> dict[str, FloatArray]:
    """Readings of single needles, each of shape (trunnion, needle, sample)."""
    rows = _rows_of_needles(assembly)
    forces = {
        name: element_forces(assembly, assembly.tables.contacts[at], positions, velocities)[..., :3]
        for name, at in rows.items()
    }
    readings: dict[str, list[FloatArray]] = {name: [] for name in NEEDLE_NAMES}
    side = -1.0 if values.torque < 0 else 1.0
    for k in range(3):
        needles, axis, arms = ring(assembly, positions, values, k)
        first = assembly.names.index(f"needle {k + 1}.1")
        of_ring = slice(first, first + needles.shape[1])
        along = (arms * axis).sum(-1)
        normal = arms - along[..., None] * axis
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        flank = -side * _AROUND[k]
        load = flank - (axis @ flank)[..., None] * axis
        own, across = turned(needles[..., 3:], _Z), np.cross(normal, axis)
        readings["needle_load"].append((forces["trunnion"][:, of_ring] * normal).sum(-1))
        turned_by = np.arctan2((np.cross(axis, load) * normal).sum(-1), (load * normal).sum(-1))
        readings["needle_angle_deg"].append(np.degrees(turned_by))
        readings["needle_place_mm"].append(along - values.ring_distance)
        readings["needle_yaw_deg"].append(np.degrees(np.arctan2((own * across).sum(-1), (own * axis).sum(-1))))
        stops = forces["outer stop"][:, of_ring] + forces["inner stop"][:, of_ring]
        readings["needle_stop_force"].append(-(stops * axis).sum(-1))
    return {name: np.array([each.T for each in data]) for name, data in readings.items()}


def _rows_of_needles(assembly: Assembly) -> dict[str, list[int]]:
    """Places of the contacts with trunnions and stops in the table of contacts."""
    rows: dict[str, list[int]] = {"trunnion": [], "inner stop": [], "outer stop": []}
    for at, contact in enumerate(assembly.scene.contacts):
        surface = contact.surface
        if surface.body in ("shaft",) and isinstance(surface, Cylinder):
            rows["trunnion"].append(at)
        elif isinstance(surface, Plane) and surface.body != GROUND:
            rows["outer stop" if contact.centre[2] > 0 else "inner stop"].append(at)
    return rows
