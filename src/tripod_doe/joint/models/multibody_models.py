"""The models `rollers` and `needles`: points run one by one as scenes of rigid bodies."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import astuple
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.contact_notes import Extremes, add_contact_notes
from tripod_doe.joint.contact_outputs import NEEDLE_NAMES, wanted_contacts
from tripod_doe.joint.models.model import RATES, SKEWS, Model
from tripod_doe.joint.models.valid_ranges import CROWN_FOLLOWED, NOT_PRELOADED
from tripod_doe.joint.outputs import (
    CYCLE_OUTPUTS,
    JOINT_OUTPUTS,
    PART_OUTPUTS,
    VIBRATES,
    VIBRATION_OUTPUTS,
    VIBRATION_THIRD,
    part_outputs,
    thrust_outputs,
)
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import BlockResult, Methods, not_counted

if TYPE_CHECKING:  # a model imports its kernels when it is first used
    from tripod_doe.joint.multibody.run_result import Readings


def _simulate_multibody(
    needles: bool,
    points: JointValues[FloatArray],
    method: str,
    samples: int,
    keep: Collection[str],
    accuracy: OrderAccuracy | None = None,
) -> BlockResult:
    """Simulate points one by one: a run costs far more than any work that points could share."""
    from tripod_doe.joint.models.multibody_run import run_joint
    from tripod_doe.joint.multibody.run_result import Wanted

    block = BlockResult.blank(points.torque.size)
    setting, usual = next(iter(_MULTIBODY_METHODS[needles][method].items()))
    rates, split = (not set(names).isdisjoint(keep) for names in (RATES, PART_OUTPUTS))
    names = wanted_contacts(keep) | {"groove_normal_force"}
    if not np.isnan(points.pressure_limit).all():
        names |= {"largest_needle_pressure_mpa"}
    extremes = Extremes(*np.zeros((3, block.count)))
    for i in range(block.count):
        result = run_joint(points.point(i), needles, method, Wanted(samples, rates, split, names), accuracy, usual)
        if result.settled:
            block.settle(setting, i, result.setting)
        block.end(i, result.outcome, result.detail)
        block.steps[i], block.force_evaluations[i], block.solves[i], block.simulated_seconds[i] = (
            result.steps,
            result.force_evaluations,
            result.solves,
            result.followed,
        )
        if result.readings is not None:
            for name, data in _answer(result.readings, keep).items():
                block.put(name, JOINT_OUTPUTS[name].dims, i, data)
            contacts = result.readings.contacts
            extremes.normal_force[i] = contacts["groove_normal_force"].max() if contacts else 0.0
            extremes.penetration[i] = 1e3 * result.readings.penetration
            extremes.needle_pressure[i] = contacts.get("largest_needle_pressure_mpa", 0.0)
    add_contact_notes(block, points, extremes)
    return block


def prepare_multibody(point: JointValues[FloatArray], method: str) -> None:
    """Compile the kernels of a run of a point by a method, or load their machine code."""
    with not_counted():  # the modules and the kernels that a first look for vibrations loads within an answer
        from tripod_doe.joint.models.multibody_run import compile_joint

        compile_joint(point.point(0), method)


def _answer(result: Readings, keep: Collection[str]) -> dict[str, FloatArray]:
    """Outputs of one run."""
    outputs = thrust_outputs(result.groove_thrust[None], keep)
    if result.thrust_parts is not None:
        outputs |= part_outputs(result.thrust_parts[None], keep)
    others: dict[str, Any] = {
        "thrust_amplitude_error": result.amplitude_error,
        "friction_power_w": result.friction_power / 1e3,
        "needle_skew_deg": None if result.skew is None else np.degrees(result.skew),
        "needle_skew_summary_deg": None if result.skew_summary is None else np.degrees(result.skew_summary),
        "largest_penetration_um": 1e3 * result.penetration,
        "energy_residual": result.energy_residual,
        **result.contacts,
    }
    if result.rates is not None:
        others |= dict(zip(RATES, astuple(result.rates), strict=True))
    if result.vibration is not None:
        others |= dict(zip(VIBRATION_OUTPUTS, astuple(result.vibration), strict=True))
        others[VIBRATES] = float(result.vibration.growth > 1)
    kept = {name: np.asarray(data) for name, data in others.items() if name in keep and data is not None}
    return {name: data[0] for name, data in outputs.items()} | kept


def _methods(relative_tolerance: float, step: float) -> Methods:
    """Numerics of every method for a multibody model: the chosen one first, with its own tolerance."""
    explicit, tight = 1e-7, 1e-4
    defaults = {"adaptive-euler": relative_tolerance}
    return {
        name: {"relative_tolerance": defaults.get(name, tight)}
        if METHODS[name].controlled
        else {"step_s": explicit if METHODS[name].explicit else step}
        for name in sorted(METHODS, key=lambda name: name not in defaults)
    }


_MULTIBODY_METHODS = {
    False: _methods(relative_tolerance=4e-3, step=5e-5),
    True: _methods(relative_tolerance=2e-3, step=1e-5),
}
"""Methods by model: False for `rollers`, True for `needles` (needles are bodies)."""

ROLLERS = Model(
    name="rollers",
    methods=_MULTIBODY_METHODS[False],
    ignores=frozenset({"needle_axial_clearance_mm", "needle_mass_factor", "settled_needles"}),
    outputs=frozenset(JOINT_OUTPUTS) - {*SKEWS, *NEEDLE_NAMES, *CYCLE_OUTPUTS, VIBRATION_THIRD},
    simulate=partial(_simulate_multibody, False),
    prepare=prepare_multibody,
    valid=(NOT_PRELOADED, CROWN_FOLLOWED),
    settles=True,
)

NEEDLES = Model(
    name="needles",
    methods=_MULTIBODY_METHODS[True],
    outputs=frozenset(JOINT_OUTPUTS) - {*CYCLE_OUTPUTS, VIBRATION_THIRD},
    simulate=partial(_simulate_multibody, True),
    prepare=prepare_multibody,
    valid=(CROWN_FOLLOWED,),
    settles=True,
)
