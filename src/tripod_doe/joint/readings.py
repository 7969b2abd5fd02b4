"""What is read off the states of a multibody run: thrust at the grooves, friction powers, skew of the needles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.posture import GROOVE_ANGLES
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.bearing import bearing_forces
from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.contact import add_contacts
from tripod_doe.mechanics.motion import clear

__all__ = ["groove_readings", "needle_skews"]

FloatArray = NDArray[np.float64]


@kernel
def _read(tables, work, positions, velocities, thrust, powers):
    """Forces on the ground at the grooves, whose contacts are the last three, and the powers lost there and elsewhere.

    Parameters
    ----------
    positions, velocities
        Shapes (sample, body, 7) and (sample, body, 6).
    thrust, powers
        Receive axial forces on the grooves, shape (3, sample), and powers lost by mechanism, shape (5, sample).
    """
    force, ledger, first = work.force, work.ledger, tables.contacts.size - 3
    for s in range(positions.shape[0]):
        clear(ledger)
        for k in range(3):
            clear(force.ravel())
            add_contacts(
                tables.contacts, first + k, first + k + 1, positions[s], velocities[s], 1.0, 0.0, 0.0,
                force, work.drift, ledger, work.slip, work.touching, work.matrix, work.pair,
            )  # fmt: skip
            thrust[k, s] = force[0, 2]
        powers[0, s], powers[1, s], powers[2, s] = ledger[2], ledger[3], ledger[4]
        clear(ledger)
        add_contacts(
            tables.contacts, 0, first, positions[s], velocities[s], 1.0, 0.0, 0.0,
            force, work.drift, ledger, work.slip, work.touching, work.matrix, work.pair,
        )  # fmt: skip
        bearing_forces(tables.bearings, positions[s], velocities[s], force, ledger)
        powers[3, s], powers[4, s] = ledger[2], ledger[4]


def groove_readings(assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Thrust at the grooves and powers lost to friction, in the order of `parameters.MECHANISMS`.

    Parameters
    ----------
    positions, velocities
        States of a run, shapes (sample, body, 7) and (sample, body, 6).

    Returns
    -------
    tuple of ndarray
        Axial force on the housing, shape (groove, sample), N; power, shape (mechanism, sample), N mm/s.
    """
    thrust, powers = np.zeros((3, len(positions))), np.zeros((5, len(positions)))
    _read(assembly.tables, assembly.work(), positions, velocities, thrust, powers)
    return thrust, powers


def _turned(quaternions: FloatArray, vector: FloatArray) -> FloatArray:
    """A body-fixed vector in world axes; quaternions of shape (..., 4)."""
    scalar, axis = quaternions[..., :1], quaternions[..., 1:]
    across = 2 * np.cross(axis, vector)
    turned: FloatArray = vector + scalar * across + np.cross(axis, across)
    return turned


def needle_skews(
    assembly: Assembly, positions: FloatArray, values: Mapping[str, float], cycles: int
) -> tuple[FloatArray, FloatArray]:
    """Skew of the needle of each trunnion that carries the most: the one that dips deepest into the trunnion.

    Parameters
    ----------
    positions
        States of whole revolutions, shape (sample, body, 7).
    values
        Joint parameters.
    cycles
        Revolutions among the samples.

    Returns
    -------
    tuple of ndarray
        Skew in rad, shape (trunnion, sample), and mean, least and greatest in every revolution, (trunnion, cycle, 3).
    """
    shaft = positions[:, assembly.names.index("shaft")]
    count, along = int(values["needle_count"]), np.array([0.0, 0.0, 1.0])
    spider = shaft[:, :3] - _turned(shaft[:, 3:], 0.5 * values["shaft_length_mm"] * along)
    skews = np.empty((3, len(positions)))
    for k, angle in enumerate(GROOVE_ANGLES):
        first = assembly.names.index(f"needle {k + 1}.1")
        needles = positions[:, first : first + count]
        axis = _turned(shaft[:, 3:], np.array([np.cos(angle), np.sin(angle), 0.0]))[:, None]
        arms = needles[..., :3] - spider[:, None]
        normals = arms - (arms * axis).sum(-1, keepdims=True) * axis
        distances = np.linalg.norm(normals, axis=-1)
        chosen = np.arange(len(positions)), distances.argmin(axis=1)
        normal, own = normals[chosen] / distances[chosen][:, None], _turned(needles[chosen][:, 3:], along)
        across = np.cross(normal, axis[:, 0])
        skews[k] = np.arctan2((own * across).sum(-1), (own * axis[:, 0]).sum(-1))
    by_cycle = skews.reshape(3, cycles, -1)
    return skews, np.stack([by_cycle.mean(-1), by_cycle.min(-1), by_cycle.max(-1)], axis=-1)
