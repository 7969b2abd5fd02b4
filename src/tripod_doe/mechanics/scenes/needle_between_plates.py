"""A skewed needle roller between two plates: the validation of the paper's 2.3.3 and Fig. 8.

Plate A is fixed, plate B moves with constant velocity V along x and carries the load; the needle lies between them, its
axis turned by the skew from y. Across its axis the needle rolls freely at V cos(skew) / 2; along its axis it slips at u
against A and at V sin(skew) - u against B, and in steady motion both frictions are equal,

    mu_A tanh(u / v_st) = mu_B tanh((V sin(skew) - u) / v_st),     drift = T cos(skew) (V/2 sin(skew) - u).

Where the plate reverses, a pin on a crank that turns at the given frequency guides it: V cos(2 pi f t), and the slips
pass through zero twice per turn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from tripod_doe.mechanics import scene as parts
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Run, run
from tripod_doe.mechanics.scenes.scene_simulator import PLACES, PROGRESS, RUN_OUTPUTS, SceneSimulator, scene_parameters
from tripod_doe.mechanics.stability.rates import RATE_OUTPUTS
from tripod_doe.model_interface import Methods, Output, by_name

_PLATE_MASS = 1e-4
"""Mass of the loaded plate (0.1 kg, assumed): it moves only across its plane, and only while the load settles."""

_NUMERICS: Methods = {
    "bdf2": {"step_s": 1e-4},
    "symplectic-euler": {"step_s": 5e-9},
    "rk4": {"step_s": 5e-9},
    "linearly-implicit-euler": {"step_s": 1e-5},
    "implicit-euler": {"step_s": 1e-4},
    "generalized-alpha": {"step_s": 1e-5},
    "adaptive-euler": {"relative_tolerance": 1e-3},
    "rosenbrock": {"relative_tolerance": 1e-5},
    "scipy-radau": {"relative_tolerance": 1e-6},
    "scipy-bdf": {"relative_tolerance": 1e-6},
    "scipy-lsoda": {"relative_tolerance": 1e-6},
    "scipy-dop853": {"relative_tolerance": 1e-6},
}
"""Methods, the default first, each with its default step or tolerance."""

_OUTPUTS = [
    Output("axial_drift_mm", "mm", "y", "drift of the needle across the plate's velocity, in its plane"),
    Output("travel_mm", "mm", "x", "travel of the needle along the plate's velocity"),
    Output("axial_path_mm", "mm", "y", "locus of the needle: drift across the plate's velocity", (PROGRESS,)),
    Output("travel_path_mm", "mm", "x", "locus of the needle: travel along the plate's velocity", (PROGRESS,)),
    *RUN_OUTPUTS,
    *RATE_OUTPUTS,
]


def transition_velocity(values: Mapping[str, float]) -> float:
    """v_st: transition_ratio times (V/2) sin(skew), not below 1e-3 mm/s."""
    slip = abs(values["plate_speed_mm_s"] / 2 * math.sin(math.radians(values["skew_deg"])))
    return max(values["transition_ratio"] * slip, 1e-3)


def closed_form(values: Mapping[str, float]) -> tuple[float, float]:
    """Axial slip u against plate A and drift in steady motion; mm/s and mm."""
    skew, speed = math.radians(values["skew_deg"]), values["plate_speed_mm_s"]
    along, v_st = speed * math.sin(skew), transition_velocity(values)

    def balance(u: float) -> float:
        hold = values["friction_a"] * math.tanh(u / v_st)
        return float(hold - values["friction_b"] * math.tanh((along - u) / v_st))

    slip = 0.0 if along == 0.0 else float(brentq(balance, min(0.0, along), max(0.0, along), xtol=1e-15, rtol=1e-14))
    return slip, values["duration_s"] * math.cos(skew) * (along / 2 - slip)


def build(values: Mapping[str, float]) -> parts.Scene:
    """The scene, at rest in its load, rolling without slip across the needle and without motion along it."""
    count, length, radius = (
        int(values["spheres_per_needle"]),
        values["needle_length_mm"],
        values["needle_diameter_mm"] / 2,
    )
    stiffness = values["contact_stiffness_factor"] * 8.15e4 * length ** (8 / 9) / count  # Table 1
    depth = (values["load_n"] / count / stiffness) ** 0.9
    if values["needle_crown_um"] > 0:
        depth = _crowned_depth(values, stiffness, count)
    skew, speed = math.radians(values["skew_deg"]), values["plate_speed_mm_s"]
    reversing = 2 * math.pi * values["reversing_frequency_hz"]
    plate = parts.Body(
        "plate B",
        _PLATE_MASS,
        (1.0, 1.0, 1.0),
        position=(0.0, 0.0, 2 * (radius - depth)),
        velocity=(speed, 0.0, 0.0),
        force=(0.0, 0.0, -values["load_n"]),
        locked=(not reversing, True, False, True, True, True),
    )
    guides = _crank(speed, reversing) if reversing else ((), ())
    v_st = transition_velocity(values)

    def row(surface: parts.Plane, friction: float) -> parts.SphereRow:
        return parts.SphereRow(
            "needle",
            surface,
            radius,
            stiffness,
            exponent=10 / 9,
            axis=(0.0, 1.0, 0.0),
            count=count,
            length=length,
            crown=values["needle_crown_um"] / 1e3,
            damping=values["contact_damping_s_per_mm"],
            damping_time=values["contact_damping_time_s"],
            friction=parts.Friction(sliding=friction, sliding_transition=v_st),
        )

    slip = max(abs(speed * math.sin(skew)) / 2, 1e-3 * abs(speed), 1e-3)
    return parts.Scene(
        (_rolling_needle(values, depth), plate, *guides[0]),
        contacts=(
            row(parts.Plane(parts.GROUND), values["friction_a"]),
            row(parts.Plane("plate B", normal=(0.0, 0.0, -1.0)), values["friction_b"]),
        ),
        length_scale=max(abs(speed) / reversing if reversing else slip * values["duration_s"], 0.01),
        speed_scale=slip,
        rotation_scale=slip / radius,
        time_scale=1 / reversing if reversing else values["duration_s"],
        constraints=guides[1],
    )


def _rolling_needle(values: Mapping[str, float], depth: float) -> parts.Body:
    """The needle, which rolls on plate A at half the speed of plate B across itself; pressed in by `depth` in mm."""
    skew, speed = math.radians(values["skew_deg"]), values["plate_speed_mm_s"]
    length, radius = values["needle_length_mm"], values["needle_diameter_mm"] / 2
    mass = values["needle_mass_factor"] * values["density_kg_m3"] * 1e-12 * math.pi * radius**2 * length
    across = mass * (radius**2 / 4 + length**2 / 12)
    rolling = speed * math.cos(skew) / 2
    turning = rolling / radius
    return parts.Body(
        "needle",
        mass,
        (across, mass * radius**2 / 2, across),
        position=(0.0, 0.0, radius - depth),
        attitude=(math.cos(skew / 2), 0.0, 0.0, math.sin(skew / 2)),
        velocity=(math.cos(skew) * rolling, math.sin(skew) * rolling, 0.0),
        angular_velocity=(-math.sin(skew) * turning, math.cos(skew) * turning, 0.0),
    )


def _crank(speed: float, rate: float) -> tuple[tuple[parts.Body], tuple[parts.PointInPlane]]:
    """A crank about y whose pin guides plate B in a slot across its velocity, so that it moves at speed cos(rate t)."""
    crank = parts.Body("crank", 1.0, (1.0, 1.0, 1.0), angular_velocity=(0.0, rate, 0.0), locked=(True,) * 6)
    slot = parts.PointInPlane("plate B", "crank", point_b=(0.0, 0.0, speed / rate), normal_a=(1.0, 0.0, 0.0))
    return (crank,), (slot,)


def _crowned_depth(values: Mapping[str, float], stiffness: float, count: int) -> float:
    """Penetration of the middle of a crowned needle that carries the load."""
    place = (np.arange(count) + 0.5) / count - 0.5
    drop = 4 * values["needle_crown_um"] / 1e3 * place**2

    def missing(depth: float) -> float:
        return float((stiffness * np.maximum(depth - drop, 0) ** (10 / 9)).sum() - values["load_n"])

    highest = (values["load_n"] / stiffness) ** 0.9 + drop.max()
    return float(brentq(missing, 0.0, highest, xtol=1e-15))


class NeedleBetweenPlates(SceneSimulator):
    """The needle between two plates as a simulator."""

    name = "needle-between-plates"
    parameters = scene_parameters("needle_between_plates.toml", _NUMERICS, 200_000_000)
    outputs = by_name(_OUTPUTS)
    numerics = _NUMERICS

    def run(self, values: Mapping[str, float], method: str, step: float | None, settings: Settings) -> Run:
        """Simulate one point."""
        assembly = assemble(build(values))
        return run(assembly, method, values["duration_s"], step=step, samples=PLACES.size - 1, settings=settings)

    def answer(self, values: Mapping[str, float], result: Run) -> dict[str, Any]:
        """Drift, travel and locus."""
        path = result.positions[:, 1, :]
        progress = result.times / values["duration_s"]
        return {
            "axial_drift_mm": path[-1, 1],
            "travel_mm": path[-1, 0],
            "axial_path_mm": np.interp(PLACES, progress, path[:, 1]),
            "travel_path_mm": np.interp(PLACES, progress, path[:, 0]),
        }


simulator = NeedleBetweenPlates()
"""The scene that study files reach as ``needle-between-plates``."""
