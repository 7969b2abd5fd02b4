"""The ladder of models by name: what each can represent, which numerics it uses, and how it simulates a block."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.contact import contact_constants
from tripod_doe.joint.equilibrium import solve_equilibrium
from tripod_doe.joint.outputs import JOINT_OUTPUTS, thrust_outputs
from tripod_doe.quantities import Value
from tripod_doe.results import BlockResult, Outcome, Values

__all__ = ["MODELS", "Model"]

FloatArray = NDArray[np.float64]

_CHUNK = 64  # points whose waveforms are held at once
_ENERGY_LIMIT = 1e-5


@dataclass(frozen=True)
class Model:
    """One rung of the ladder.

    Attributes
    ----------
    name
        The value of the parameter ``model``.
    numerics
        The numerics parameters it uses, with the values it takes where they are left open.
    ignores
        Parameters that it cannot represent.
    outputs
        Names of the outputs that it gives.
    simulate
        (numeric parameters in internal units, samples a revolution, outputs to keep) -> results.
    """

    name: str
    numerics: Mapping[str, Value]
    ignores: frozenset[str]
    outputs: frozenset[str]
    simulate: Callable[[Mapping[str, FloatArray], int, Collection[str]], BlockResult]


def _simulate_equilibrium(points: Mapping[str, FloatArray], samples: int, keep: Collection[str]) -> BlockResult:
    points = {**points, **contact_constants(points)}
    count = points["torque_n_m"].size
    chunks = [
        _equilibrium_chunk({name: column[start : start + _CHUNK] for name, column in points.items()}, samples, keep)
        for start in range(0, count, _CHUNK)
    ]
    outputs = {
        name: Values(values.dims, np.concatenate([chunk.outputs[name].data for chunk in chunks]))
        for name, values in chunks[0].outputs.items()
    }
    return BlockResult(
        outputs,
        {},
        np.concatenate([chunk.outcome for chunk in chunks]),
        [text for chunk in chunks for text in chunk.detail],
        np.concatenate([chunk.steps for chunk in chunks]),
        np.concatenate([chunk.force_evaluations for chunk in chunks]),
    )


def _equilibrium_chunk(points: Mapping[str, FloatArray], samples: int, keep: Collection[str]) -> BlockResult:
    solution = solve_equilibrium(points, samples)
    outputs = thrust_outputs(solution.groove_thrust[:, None], keep)
    in_groove = np.cbrt(np.maximum(solution.largest_normal_force, 0) / points["groove_stiffness"]) ** 2  # Eq. 2
    scalars = {
        "friction_power_w": solution.friction_power / 1e3,
        "largest_penetration_um": 1e3 * np.maximum(in_groove, solution.needle_penetration),
        "energy_residual": solution.energy_residual,
    }
    outputs |= {name: Values(JOINT_OUTPUTS[name].dims, data) for name, data in scalars.items() if name in keep}
    outcome = np.full(solution.settled.size, Outcome.FINISHED, np.int8)
    detail = [""] * outcome.size
    reasons = [
        (~(np.abs(solution.energy_residual) <= _ENERGY_LIMIT), Outcome.INACCURATE, "the energy balance does not close"),
        (~(solution.smallest_normal_force >= 0), Outcome.OUT_OF_RANGE, "a roller lifts off its groove"),
        (~solution.settled, Outcome.DIVERGED, "the balance of the rollers did not settle; raise transition_ratio"),
    ]
    for failed, kind, text in reasons:
        for position in np.flatnonzero(failed):
            outcome[position], detail[position] = kind, text
    return BlockResult(outputs, {}, outcome, detail, solution.sweeps, solution.sweeps)


_EQUILIBRIUM = Model(
    name="equilibrium",
    numerics={"method": "newton", "relative_tolerance": 1e-9},
    ignores=frozenset(
        {
            "roller_width_mm", "spheres_per_needle", "needle_axial_clearance_mm", "needle_crown_um", "shaft_length_mm",
            "outboard_joint_angle_deg", "shaft_mass_kg", "output_inertia_kg_m2", "density_kg_m3",
            "contact_damping_s_per_mm", "needle_mass_factor", "cycles",
        }
    ),
    outputs=frozenset(JOINT_OUTPUTS),
    simulate=_simulate_equilibrium,
)  # fmt: skip

MODELS: dict[str, Model] = {model.name: model for model in (_EQUILIBRIUM,)}
"""All models of the joint by name."""
