"""The needle between two plates in Exudyn: rigid body with Euler parameters, generalised-alpha, compiled contact law.

Plate B keeps the height at which it carries its load; the drift does not depend on it to the digits compared here.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import exudyn as exu
import exudyn.itemInterface as items  # noqa: N813
import numpy as np
from numba import njit

from tripod_doe.mechanics.scenes.needle_between_plates import build, transition_velocity

__all__ = ["simulate_in_exudyn", "solve"]


@njit
def _force(x, v, w, axis, plate, row, friction, out):
    """Force and moment on the needle; plate = (height, V), row = (C, l, N_s, r, d), friction = (mu_A, mu_B, v_st)."""
    out[:] = 0.0
    for k in range(int(row[2])):
        place = row[1] * ((k + 0.5) / row[2] - 0.5)
        for side in range(2):
            up = 1.0 if side == 0 else -1.0
            height = x[2] + place * axis[2]
            depth = row[3] - (height if side == 0 else plate[0] - height)
            if depth <= 0.0:
                continue
            lx, ly, lz = place * axis[0], place * axis[1], place * axis[2] - up * row[3]
            vx = v[0] + w[1] * lz - w[2] * ly - (plate[1] if side == 1 else 0.0)
            vy = v[1] + w[2] * lx - w[0] * lz
            vz = v[2] + w[0] * ly - w[1] * lx
            greased = -10 / 9 * row[4] * vz * up
            load = row[0] * depth ** (10 / 9) * (1.0 + greased / math.hypot(depth, greased))
            speed = math.hypot(vx, vy)
            drag = friction[side] * load
            drag *= math.tanh(speed / friction[2]) / speed if speed > 1e-12 else 1.0 / friction[2]
            fx, fy, fz = -drag * vx, -drag * vy, up * load
            out[0] += fx
            out[1] += fy
            out[2] += fz
            out[3] += ly * fz - lz * fy
            out[4] += lz * fx - lx * fz
            out[5] += lx * fy - ly * fx


def solve(system: exu.MainSystem, duration: float, step: float) -> float:
    """Integrate an assembled system by generalised-alpha with equal steps; returns the solver's CPU seconds."""
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(duration / step)
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
    settings.timeIntegration.newton.relativeTolerance = 1e-8
    settings.timeIntegration.newton.maxIterations = 50
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    begun = time.process_time()
    system.SolveDynamic(settings)
    return time.process_time() - begun


def simulate_in_exudyn(values: Mapping[str, float], step: float) -> tuple[float, float]:
    """Axial drift and CPU seconds of the solver."""
    scene = build(values)
    needle, plate = scene.bodies
    row = scene.contacts[0]
    container = exu.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    w, x, y, z = needle.attitude
    rates = 0.5 * np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]]) @ np.array(needle.angular_velocity)
    node = system.AddNode(
        items.NodeRigidBodyEP(
            referenceCoordinates=[*needle.position, *needle.attitude], initialVelocities=[*needle.velocity, *rates]
        )
    )
    body = system.AddObject(
        items.ObjectRigidBody(mass=needle.mass, inertia=[*needle.inertia, 0, 0, 0], nodeNumber=node)
    )
    markers = [system.AddMarker(items.MarkerBodyRigid(bodyNumber=number)) for number in (ground, body)]
    out = np.zeros(6)
    plate_table = np.array([plate.position[2], plate.velocity[0]])
    row_table = np.array([row.stiffness, row.length, row.count, row.radius, row.damping_time])
    friction = np.array([values["friction_a"], values["friction_b"], transition_velocity(values)])

    def contact(mbs, t, item, displacement, rotation, velocity, *rest):
        current = exu.ConfigurationType.Current
        turn = mbs.GetObjectOutputBody(body, exu.OutputVariableType.RotationMatrix, [0, 0, 0], current)
        spin = mbs.GetObjectOutputBody(body, exu.OutputVariableType.AngularVelocity, [0, 0, 0], current)
        axis = np.array([turn[1], turn[4], turn[7]])
        _force(np.array(displacement), np.array(velocity), np.array(spin), axis, plate_table, row_table, friction, out)
        return list(-out)

    system.AddObject(
        items.ObjectConnectorRigidBodySpringDamper(markerNumbers=markers, springForceTorqueUserFunction=contact)
    )
    system.Assemble()
    seconds = solve(system, values["duration_s"], step)
    return float(system.GetNodeOutput(node, exu.OutputVariableType.Position)[1]), seconds
