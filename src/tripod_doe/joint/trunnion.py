"""One trunnion with its needles, its roller and its groove as a simulator: a third of the joint.

Parts and motion are as in the joint: see `joint_scene.build_trunnion`. Only the friction in the other two grooves is
missing, which turns and loads the spider a little.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.geometry.feasibility import infeasible
from tripod_doe.joint.models.multibody_run import compile_joint, follow
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.multibody.joint_scene import build_trunnion
from tripod_doe.joint.multibody.numerical_error import amplitude_error, finer_thrust, judge, miss_of_given
from tripod_doe.joint.multibody.thrust_and_power import groove_readings, needle_drift, needle_skews
from tripod_doe.joint.orders import amplitude_and_phase, complex_amplitudes
from tripod_doe.joint.output_dimensions import ORDER, ROTATION, rotation_angles
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.unit_conversion import internal_values, point_values
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Run, method_named
from tripod_doe.mechanics.scenes.scene_simulator import RUN_OUTPUTS, SceneSimulator
from tripod_doe.model_interface import Outcome, Output, Parameter, by_name

_SAMPLES = 360
"""Samples of the rotation angle per revolution."""

_OF_OTHERS = (
    "initial_skew_2_deg",
    "initial_skew_3_deg",
    "model",
    "samples_per_revolution",
    "accuracy",
    "settled_needles",
    "pressure_limit_gpa",
    "penetration_limit_um",
)
"""Parameters of the joint without effect on one trunnion."""

_NEEDLES = MODELS["needles"]

_ROTATION = replace(ROTATION, labels=rotation_angles(_SAMPLES), length_parameter=None)

_OUTPUTS = [
    Output(
        "groove_thrust", "N", "F_1", "axial force on the groove, positive towards the intermediate shaft", (_ROTATION,)
    ),
    Output(
        "groove_thrust_amplitude",
        "N",
        "A_k",
        "amplitude of the rotating orders of the axial force on the groove",
        (ORDER,),
    ),
    Output(
        "groove_thrust_phase_deg",
        "degree",
        "p_k",
        "phase of the rotating orders of the axial force on the groove",
        (ORDER,),
    ),
    Output("needle_skew_deg", "degree", "psi", "skew of the most loaded needle at this rotation angle", (_ROTATION,)),
    Output("needle_drift_mm", "mm", "", "mean shift of the needles along the trunnion since the start", (_ROTATION,)),
    *RUN_OUTPUTS,
]


def _numerics(name: str) -> Parameter:
    """The joint's parameter, with the default that the model ``needles`` has."""
    parameter = JOINT_PARAMETERS[name]
    if name == "method":
        choices = tuple(choice for choice in parameter.choices if choice in _NEEDLES.methods)
        return replace(parameter, default=_NEEDLES.default_method, choices=choices)
    return parameter


class TrunnionSimulator(SceneSimulator):
    """One trunnion of the joint, its needles and its roller in the groove, as a simulator."""

    name = "trunnion"
    parameters = by_name(_numerics(name) for name in JOINT_PARAMETERS if name not in _OF_OTHERS)
    outputs = by_name(_OUTPUTS)
    numerics = _NEEDLES.methods

    def foreseen(self, points: Mapping[str, NDArray[Any]]) -> list[tuple[int, Outcome, str]]:
        """Points whose numerics are not used, whose parts do not fit or slide, or without torque."""
        refused = {i: (outcome, reason) for i, outcome, reason in super().foreseen(points)}
        count = len(points["method"])
        defaults = {name: parameter.column([parameter.default] * count) for name, parameter in JOINT_PARAMETERS.items()}
        values = internal_values({**defaults, **points})
        without_torque = {
            int(i): (Outcome.OUT_OF_RANGE, "without torque a trunnion has no thrust orders; set torque_n_m")
            for i in np.flatnonzero(values.torque == 0)
        }
        return [(i, *why) for i, why in sorted((without_torque | infeasible(values) | refused).items())]

    def compile(self, model: str, method: str) -> None:
        """Compile the kernels of a run by a step of a joint without needle bodies."""
        compile_joint(point_values({}).point(0), method)

    def run(self, values: Mapping[str, float], method: str, step: float | None, settings: Settings) -> Run:
        """Simulate one point; run its last revolution again, and check its third order by the difference."""
        inside = point_values(values).point(0)
        assembly = assemble(build_trunnion(inside))
        result, again = follow(assembly, inside, method, _SAMPLES, step, settings)
        if again is None:
            return result
        thrust = groove_readings(assembly, result.positions, result.velocities)[0][0]
        finer = finer_thrust(assembly, again, _SAMPLES)[0]
        error = amplitude_error(thrust[:-1], finer, _SAMPLES, method_named(method))
        missed = miss_of_given(result, again, _last_two(thrust), error, inside)
        outcome, detail = judge(result, _last_two(thrust), missed, inside)
        return replace(result, outcome=outcome, detail=detail, check_evaluations=again.force_evaluations)

    def answer(self, values: Mapping[str, float], result: Run) -> dict[str, Any]:
        """Axial force on the groove with its orders, skew and drift of the needles, over the last two revolutions."""
        inside, assembly = point_values(values).point(0), result.assembly
        thrust = _last_two(groove_readings(assembly, result.positions, result.velocities)[0][0])
        amplitude, phase = amplitude_and_phase(complex_amplitudes(thrust).mean(0))
        skew, _ = needle_skews(assembly, result.positions[:-1], inside, int(inside.cycles))
        return {
            "groove_thrust": thrust.ravel(),
            "groove_thrust_amplitude": amplitude,
            "groove_thrust_phase_deg": phase,
            "needle_skew_deg": np.degrees(skew[0, -2 * _SAMPLES :]),
            "needle_drift_mm": _last_two(needle_drift(assembly, result.positions, inside)).ravel(),
        }


def _last_two(samples: FloatArray) -> FloatArray:
    """The last two revolutions, shape (2, sample); the end of the last one is the start of the next."""
    return samples[-2 * _SAMPLES - 1 : -1].reshape(2, _SAMPLES)


simulator = TrunnionSimulator()
"""The scene that study files reach as ``trunnion``."""
