"""The roller in its groove in Exudyn (the same equations, generalised-alpha) and in MuJoCo (another friction law).

Exudyn gets the two free coordinates of the scene, height and spin. MuJoCo has no tanh and no power law: a sphere on a
heavy carriage slides on a plane under the same load, with its elliptic cone and stiff soft contact (2 steps).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np

from tripod_doe.mechanics.scenes.roller_in_groove import build

__all__ = ["roller_in_exudyn", "roller_in_mujoco"]


def roller_in_exudyn(values: Mapping[str, float], step: float) -> tuple[float, float]:
    """Axial force and CPU seconds of the solver."""
    import exudyn as exu
    import exudyn.itemInterface as items  # noqa: N813
    from exudyn_needle import solve

    scene = build(values)
    roller, contact = scene.bodies[0], scene.contacts[0]
    radius, groove_radius = values["roller_radius_mm"], values["roller_radius_mm"] * values["groove_radius_ratio"]
    tilt, stiffness, damping = math.radians(values["tilt_deg"]), contact.stiffness, contact.damping_time
    slip = abs(values["axial_speed_mm_s"] * math.sin(tilt))
    transition = max(values["transition_ratio"] * slip, 1e-3)

    def contact_force(z, rate, spin):
        depth = max(radius - z - groove_radius, 0.0)
        greased = -1.5 * damping * rate
        load = stiffness * depth**1.5 * (1.0 + greased / math.hypot(depth, greased, 1e-100))
        sx, sy = roller.velocity[0] - spin * radius, roller.velocity[1]
        speed = math.hypot(sx, sy)
        drag = values["friction"] * load * (math.tanh(speed / transition) / speed if speed > 1e-12 else 1 / transition)
        return -drag * sx, -drag * sy, load

    def force(mbs, t, item, q, v):
        fx, _, fz = contact_force(q[0], v[0], v[1])
        return [fz - values["load_n"], -radius * fx]

    container = exu.SystemContainer()
    system = container.AddSystem()
    node = system.AddNode(
        items.NodeGenericODE2(
            referenceCoordinates=[0.0, 0.0],
            initialCoordinates=[roller.position[2], 0.0],
            initialCoordinates_t=[0.0, roller.angular_velocity[1]],
            numberOfODE2Coordinates=2,
        )
    )
    mass = np.diag([roller.mass, roller.inertia[1]])
    system.AddObject(items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=mass, forceUserFunction=force))
    system.Assemble()
    seconds = solve(system, values["duration_s"], step)
    q = system.GetNodeOutput(node, exu.OutputVariableType.Coordinates)
    v = system.GetNodeOutput(node, exu.OutputVariableType.Coordinates_t)
    fx, fy, _ = contact_force(q[0], v[0], v[1])
    return abs(fx * math.cos(tilt) + fy * math.sin(tilt)), seconds


def roller_in_mujoco(values: Mapping[str, float], step: float) -> tuple[float, float]:
    """Axial force and CPU seconds of the steps."""
    import mujoco

    tilt, radius = math.radians(values["tilt_deg"]), values["roller_radius_mm"] * 1e-3
    groove = f"{math.cos(tilt)} {math.sin(tilt)} 0"
    contact = f'friction="{values["friction"]} 0 0" condim="3" solref="{2 * step} 1"'
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{step}" gravity="0 0 0" cone="elliptic" tolerance="1e-12" iterations="200"/>
      <worldbody><geom type="plane" size="1 1 1" {contact}/>
        <body pos="0 0 {radius}"><inertial pos="0 0 0" mass="1e4" diaginertia="1 1 1"/>
          <joint type="slide" axis="{groove}"/>
          <body name="roller"><inertial pos="0 0 0" mass="0.07" diaginertia="1e-5 1e-5 1e-5"/>
            <joint type="slide" axis="0 0 1"/><joint type="hinge" axis="0 1 0"/>
            <geom type="sphere" size="{radius}" {contact}/></body></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    speed = values["axial_speed_mm_s"] * 1e-3
    data.qvel[:] = speed, 0.0, speed / radius
    data.xfrc_applied[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "roller"), 2] = -values["load_n"]
    begun = time.process_time()
    for _ in range(round(values["duration_s"] / step)):
        mujoco.mj_step(model, data)
    seconds = time.process_time() - begun
    if not data.ncon:
        return math.nan, seconds
    wrench = np.zeros(6)
    mujoco.mj_contactForce(model, data, 0, wrench)
    force = data.contact[0].frame.reshape(3, 3).T @ wrench[:3]
    return abs(force[0] * math.cos(tilt) + force[1] * math.sin(tilt)), seconds
