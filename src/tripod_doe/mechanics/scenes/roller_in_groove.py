"""A tilted roller that is pushed along a cylindrical groove under load: the joint's thrust in its simplest form.

The roller's axis is tilted by beta from the perpendicular to the groove, in the plane of contact. The roller turns
freely about its axis, so it slips only along it, at v sin(beta), and the groove feels the axial force mu_s N tanh(v
sin(beta) / v_st) sin(beta).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from tripod_doe.mechanics import scene as parts
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Run, run
from tripod_doe.mechanics.scenes.scene_simulator import RUN_OUTPUTS, SceneSimulator, scene_parameters
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces
from tripod_doe.mechanics.stability.rates import RATE_OUTPUTS
from tripod_doe.model_interface import Methods, Output, by_name

_MASS, _INERTIA = 7e-5, 1e-2
"""Mass (0.07 kg) and moment of inertia of the roller, assumed: they matter only while the load settles."""

_NUMERICS: Methods = {
    "bdf2": {"step_s": 1e-4},
    "symplectic-euler": {"step_s": 1e-7},
    "rk4": {"step_s": 2e-7},
    "linearly-implicit-euler": {"step_s": 1e-6},
    "implicit-euler": {"step_s": 1e-4},
    "generalized-alpha": {"step_s": 1e-5},
    "adaptive-euler": {"relative_tolerance": 1e-3},
    "rosenbrock": {"relative_tolerance": 1e-6},
    "scipy-radau": {"relative_tolerance": 1e-8},
    "scipy-bdf": {"relative_tolerance": 1e-8},
    "scipy-lsoda": {"relative_tolerance": 1e-8},
    "scipy-dop853": {"relative_tolerance": 1e-8},
}
"""Methods, the default first, each with its default step or tolerance."""

_OUTPUTS = [
    Output("axial_force_n", "N", "F", "magnitude of the axial force on the groove"),
    *RUN_OUTPUTS,
    *RATE_OUTPUTS,
]


def _slip(values: Mapping[str, float]) -> float:
    return abs(values["axial_speed_mm_s"] * math.sin(math.radians(values["tilt_deg"])))


def closed_form(values: Mapping[str, float]) -> float:
    """Steady axial force, N."""
    slip = _slip(values)
    sign = math.tanh(slip / max(values["transition_ratio"] * slip, 1e-3))
    return values["friction"] * values["load_n"] * sign * abs(math.sin(math.radians(values["tilt_deg"])))


def build(values: Mapping[str, float]) -> parts.Scene:
    """The scene: the roller's axis is y, the groove lies in the horizontal plane, turned by the tilt from x.

    The roller starts with the spin it would have without tilt, and settles by friction.
    """
    radius, tilt = values["roller_radius_mm"], math.radians(values["tilt_deg"])
    groove = (math.cos(tilt), math.sin(tilt), 0.0)
    speed, slip = values["axial_speed_mm_s"], _slip(values)
    stiffness = values["contact_stiffness_factor"] * values["contact_stiffness_n_mm15"]
    depth = (values["load_n"] / stiffness) ** (2 / 3)
    groove_radius = radius * values["groove_radius_ratio"]
    roller = parts.Body(
        "roller",
        _MASS,
        (_INERTIA,) * 3,
        position=(0.0, 0.0, radius - groove_radius - depth),
        velocity=(speed * groove[0], speed * groove[1], 0.0),
        angular_velocity=(0.0, speed / radius, 0.0),
        force=(0.0, 0.0, -values["load_n"]),
        locked=(True, True, False, True, False, True),
    )
    contact = parts.SphereRow(
        "roller",
        parts.Cylinder(parts.GROUND, groove_radius, axis=groove, concave=True),
        radius,
        stiffness,
        exponent=1.5,
        damping=values["contact_damping_s_per_mm"],
        damping_time=values["contact_damping_time_s"],
        friction=parts.Friction(values["friction"], max(values["transition_ratio"] * slip, 1e-3)),
    )
    scale = max(slip, 1e-3 * abs(speed), 1e-3)
    return parts.Scene(
        (roller,),
        contacts=(contact,),
        length_scale=max(scale * values["duration_s"], 0.01),
        speed_scale=scale,
        rotation_scale=scale / radius,
        time_scale=values["duration_s"],
    )


class RollerInGroove(SceneSimulator):
    """The roller in its groove as a simulator."""

    name = "roller-in-groove"
    parameters = scene_parameters("roller_in_groove.toml", _NUMERICS, 50_000_000)
    outputs = by_name(_OUTPUTS)
    numerics = _NUMERICS

    def run(self, values: Mapping[str, float], method: str, step: float | None, settings: Settings) -> Run:
        """Simulate one point."""
        assembly = assemble(build(values))
        return run(assembly, method, values["duration_s"], step=step, samples=20, settings=settings)

    def answer(self, values: Mapping[str, float], result: Run) -> dict[str, Any]:
        """Axial force on the groove at the end."""
        work = result.assembly.work()
        generalized_forces(result.assembly.tables, work, result.positions[-1], result.velocities[-1])
        tilt = math.radians(values["tilt_deg"])
        return {"axial_force_n": float(abs(work.force[0, :2] @ np.array([math.cos(tilt), math.sin(tilt)])))}


simulator = RollerInGroove()
"""The scene that study files reach as ``roller-in-groove``."""
