"""What tests of the joint's scenes count and weigh: degrees of freedom, and the load that each groove carries."""

from __future__ import annotations

import numpy as np

from tripod_doe.joint.multibody.initial_state import GROOVE_ANGLES
from tripod_doe.mechanics.forces.constraints import evaluate_constraints


def degrees_of_freedom(assembly):
    """Free velocities less the rank of the constraints' Jacobian at the start."""
    tables, work, state = assembly.tables, assembly.work(), assembly.initial_state()
    evaluate_constraints(
        tables.rows, state.positions, state.velocities, 0.0, work.phi, work.phi_t, work.gamma, work.jacobian
    )
    whole = np.zeros((tables.rows.size, len(assembly.names), 6))
    for k, row in enumerate(tables.rows):
        whole[k, row["body_a"]] += work.jacobian[k, :6]
        whole[k, row["body_b"]] += work.jacobian[k, 6:]
    free = tables.bodies["free"] == 1.0
    free[tables.bodies["block"] < 0] = False
    return int(free.sum()) - np.linalg.matrix_rank(whole[:, free])


def groove_forces(assembly, positions, values):
    """Normal force at every groove, from the distance of the rollers' centres to the grooves' axes (Eq. 2)."""
    play = (values.groove_radius_ratio - 1) * values.roller_radius
    forces = []
    for k, angle in enumerate(GROOVE_ANGLES):
        if f"roller {k + 1}" in assembly.names:
            centre = positions[..., assembly.names.index(f"roller {k + 1}"), :2]
            away = centre - values.pitch_radius * np.array([np.cos(angle), np.sin(angle)])
            depth = np.linalg.norm(away, axis=-1) - play
            forces.append(assembly.tables.contacts["stiffness"][-1] * np.maximum(depth, 0.0) ** 1.5)
    return np.array(forces)
