"""Results read off the states of a multibody run: thrust at the grooves, friction powers, skew and drift of needles."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.bearing import bearing_forces
from tripod_doe.mechanics.forces.sphere_contact import add_contacts
from tripod_doe.mechanics.scene import GROUND
from tripod_doe.mechanics.tables import FIRST, Slopes

_ALONG = np.array([0.0, 0.0, 1.0])


@kernel
def _read_grooves(tables, work, positions, velocities, thrust, powers):
    """Forces on the ground at the grooves, whose contacts are the last, and the powers lost there.

    Args:
        positions, velocities: Shapes (sample, body, 7) and (sample, body, 6).
        thrust, powers: Receive axial forces on the grooves, shape (groove, sample), and powers lost by mechanism, shape
            (5, sample).
    """
    force, ledger, first = work.force, work.ledger, tables.contacts.size - thrust.shape[0]
    slopes = Slopes(1.0, 0.0, 0.0)
    for s in range(positions.shape[0]):
        clear(ledger)
        for k in range(thrust.shape[0]):
            clear(force)
            at = first + k
            add_contacts(tables, work, at, at + 1, positions[s], velocities[s], slopes, work.matrix)
            thrust[k, s] = force[0, 2]
        powers[0, s], powers[1, s], powers[2, s] = ledger[2], ledger[3], ledger[4]


@kernel
def _read_needles(tables, grooves, work, positions, velocities, powers):
    """The powers lost between trunnions and rollers, the last two of shape (5, sample)."""
    force, ledger, first = work.force, work.ledger, tables.contacts.size - grooves
    slopes = Slopes(1.0, 0.0, 0.0)
    for s in range(positions.shape[0]):
        clear(ledger)
        add_contacts(tables, work, FIRST, first, positions[s], velocities[s], slopes, work.matrix)
        bearing_forces(tables.bearings, positions[s], velocities[s], force, ledger)
        powers[3, s], powers[4, s] = ledger[2], ledger[4]


def groove_readings(assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thrust at the grooves and powers lost to friction, in the order of `parameters.MECHANISMS`.

    Args:
        positions, velocities: States of a run, shapes (sample, body, 7) and (sample, body, 6).

    Returns:
        Axial force on the housing, shape (groove, sample), N; power, shape (mechanism, sample), N mm/s.
    """
    thrust, powers = _at_grooves(assembly, positions, velocities)
    _read_needles(assembly.tables, len(thrust), assembly.memory, positions, velocities, powers)
    return thrust, powers


def groove_thrust(assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> FloatArray:
    """Thrust at the grooves only, at a thirtieth of the cost of all readings with needles; see `groove_readings`."""
    return _at_grooves(assembly, positions, velocities)[0]


def _at_grooves(assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thrust and powers, still without the powers of the needles."""
    grooves = sum(contact.surface.body == GROUND for contact in assembly.scene.contacts)
    thrust, powers = np.zeros((grooves, len(positions))), np.zeros((5, len(positions)))
    contiguous = np.ascontiguousarray(positions), np.ascontiguousarray(velocities)
    _read_grooves(assembly.tables, assembly.memory, *contiguous, thrust, powers)
    return thrust, powers


def turned(quaternions: FloatArray, vector: FloatArray) -> FloatArray:
    """A body-fixed vector in world axes; quaternions of shape (..., 4)."""
    scalar, axis = quaternions[..., :1], quaternions[..., 1:]
    across = 2 * np.cross(axis, vector)
    turned: FloatArray = vector + scalar * across + np.cross(axis, across)
    return turned


def needle_skews(
    assembly: Assembly, positions: FloatArray, values: JointValues[float], cycles: int
) -> tuple[FloatArray, FloatArray]:
    """Skew of the most loaded needle of each trunnion: the one with the largest penetration into the trunnion.

    Args:
        cycles: Revolutions among the samples.

    Returns:
        Skew in rad, shape (trunnion, sample), and mean, least and greatest in every revolution, (trunnion, cycle, 3).
    """
    rings = [k for k in range(3) if f"needle {k + 1}.1" in assembly.names]
    skews = np.empty((len(rings), len(positions)))
    for row, k in enumerate(rings):
        needles, axis, arms = ring(assembly, positions, values, k)
        normals = arms - (arms * axis).sum(-1, keepdims=True) * axis
        distances = np.linalg.norm(normals, axis=-1)
        chosen = np.arange(len(positions)), distances.argmin(axis=1)
        normal, own = normals[chosen] / distances[chosen][:, None], turned(needles[chosen][:, 3:], _ALONG)
        across = np.cross(normal, axis[:, 0])
        skews[row] = np.arctan2((own * across).sum(-1), (own * axis[:, 0]).sum(-1))
    by_cycle = skews.reshape(len(rings), cycles, -1)
    return skews, np.stack([by_cycle.mean(-1), by_cycle.min(-1), by_cycle.max(-1)], axis=-1)


def needle_drift(assembly: Assembly, positions: FloatArray, values: JointValues[float]) -> FloatArray:
    """Mean shift of the needles of trunnion 1 along it since the first sample.

    Args:
        positions: States of a run, shape (sample, body, 7).

    Returns:
        ndarray, shape (sample,), mm
    """
    _, axis, arms = ring(assembly, positions, values, 0)
    places = (arms * axis).sum(-1).mean(-1)
    drift: FloatArray = places - places[0]
    return drift


def ring(
    assembly: Assembly, positions: FloatArray, values: JointValues[float], k: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States of the needles of trunnion k (sample, needle, 7), its axis (sample, 1, 3), their arms from the spider."""
    shaft, angle = positions[:, assembly.names.index("shaft")], GROOVE_ANGLES[k]
    spider = shaft[:, :3] - turned(shaft[:, 3:], 0.5 * values.shaft_length * _ALONG)
    first = assembly.names.index(f"needle {k + 1}.1")
    needles = positions[:, first : first + int(values.needle_count)]
    axis = turned(shaft[:, 3:], np.array([np.cos(angle), np.sin(angle), 0.0]))[:, None]
    arms: FloatArray = needles[..., :3] - spider[:, None]
    return needles, axis, arms


def has_needle_bodies(assembly: Assembly) -> bool:
    """Whether the needles of a joint are bodies."""
    return "needle 1.1" in assembly.names
