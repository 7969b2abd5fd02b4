"""The models `equilibrium` and `kinetostatic`: blocks of points by a balance of forces at every rotation angle."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.contact_notes import Extremes, add_contact_notes
from tripod_doe.joint.contact_outputs import NEEDLE_NAMES, wanted_contacts
from tripod_doe.joint.models.model import RATES, SKEWS, Model
from tripod_doe.joint.models.multibody_models import prepare_multibody
from tripod_doe.joint.models.valid_ranges import CROWN_FOLLOWED, NO_CROWN, SLOW, within
from tripod_doe.joint.outputs import (
    CYCLE_OUTPUTS,
    JOINT_OUTPUTS,
    PART_OUTPUTS,
    VIBRATION_OUTPUTS,
    VIBRATION_THIRD,
    VIBRATION_VERDICT,
    cycle_outputs,
    part_outputs,
    skew_outputs,
    thrust_outputs,
    vibration_tests,
)
from tripod_doe.joint.unit_conversion import internal_values
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.model_interface import BlockResult, Outcome

if TYPE_CHECKING:  # a model imports its kernels when it is first used
    from tripod_doe.joint.force_balance.equilibrium import Equilibrium

_COMPILE_RUNS = "from tripod_doe.joint.simulator import simulator; simulator.compile('rollers', 'adaptive-euler')"

_Solve = Callable[[JointValues[FloatArray], int, frozenset[str], dict[str, FloatArray]], "Equilibrium"]
"""Solve points at a number of samples per revolution; add the named contact outputs to the table."""

_CHUNK = 64  # points whose waveforms are held at once
_ROUNDING, _SPIDER_MOTION = 1e-8, 2e-3
"""Largest unexplained power over the transmitted power. Equilibrium: rounding only. Kinetostatic: the model omits the
spider's motion caused by swinging and tilting rollers."""
_PRELOADED = (
    "the balance does not apply to a preloaded bearing: its error in the third order is 10 % at -0.001 mm and 50 % at "
    "-0.003 mm; use model rollers or needles"
)
_UNSETTLED = "the balance of the rollers did not converge; raise transition_ratio, or use model rollers"
_SPIN_OPEN = (
    "groove sliding is off, so no thrust is transmitted; the spin of the rollers did not converge, and the friction "
    "power is not known"
)
_NEEDLES_KEPT = "the balance did not converge with moving needles: solved with needles that keep their skew"
_TURN_ON = (
    "the motion of the needles did not become periodic within hundreds of revolutions, so the orders have no settled "
    "value; leave out settled_needles, and give cycles"
)
_UNEXPLAINED = "the energy balance does not close; lower relative_tolerance, or use model rollers"
_UPRIGHT = "the balance did not converge with rollers that yaw on their needles: solved without roller yaw"

_DAMPS = "adaptive-euler"
"""Integration method of the motion that is tested for vibrations."""


def _simulate_balance(
    solve: _Solve,
    energy_limit: float,
    points: JointValues[FloatArray],
    method: str,
    samples: int,
    keep: Collection[str],
    accuracy: OrderAccuracy | None = None,
) -> BlockResult:
    """Simulate points with a force balance; the points already contain its relative tolerance."""
    block = BlockResult.blank(points.torque.size)
    for start in range(0, block.count, _CHUNK):
        rows = np.arange(start, min(start + _CHUNK, block.count))
        block.fill(rows, _balance_chunk(solve, energy_limit, points.take(rows), samples, keep))
    return block


def _left_by_tolerance(points: JointValues[FloatArray], solution: Equilibrium) -> FloatArray:
    """Allowed unexplained power over transmitted power, from the tolerance of each point."""
    transmitted = np.maximum(np.abs(points.torque * points.speed), np.finfo(float).tiny)
    left: FloatArray = points.relative_tolerance * solution.friction_power.sum(axis=1) / transmitted
    return left


def _balance_chunk(
    solve: _Solve, energy_limit: float, points: JointValues[FloatArray], samples: int, keep: Collection[str]
) -> BlockResult:
    names = wanted_contacts(keep) | set(CYCLE_OUTPUTS).intersection(keep)
    if not np.isnan(points.pressure_limit).all():
        names |= {"largest_needle_pressure_mpa"}
    contacts: dict[str, FloatArray] = {}
    solution = solve(points, samples, names, contacts)
    straight = points.joint_angle == 0  # nothing slides or rolls: any thrust is an iteration error
    solution.groove_thrust[straight] = solution.thrust_parts[straight] = 0.0
    outputs: dict[str, FloatArray] = {}
    each, turns_on = solution.groove_thrust[:, None], np.zeros(straight.size, bool)
    if solution.revolutions is not None:
        revolutions = solution.revolutions
        each, repeating, repeat, finer = revolutions.each, revolutions.repeating, revolutions.repeat, revolutions.finer
        each[straight], repeating[straight], finer[straight], repeating[~repeat] = 0.0, 0.0, 0.0, np.nan
        turns_on = (points.settled_needles > 0) & ~repeat
        outputs = cycle_outputs(each, repeating, finer, keep)
    outputs |= thrust_outputs(each[:, -2:], keep)
    if not set(PART_OUTPUTS).isdisjoint(keep):
        outputs |= part_outputs(solution.thrust_parts[:, None], keep)
    if solution.needle_skew is not None:
        outputs |= skew_outputs(np.degrees(solution.needle_skew), samples)
    # without sliding friction in the groove there is no thrust, however the rollers turn
    spin_open = ~solution.settled & (points.groove_sliding_friction == 0)
    solution.friction_power[spin_open] = solution.energy_residual[spin_open] = np.nan
    in_groove = np.cbrt(np.maximum(solution.largest_normal_force, 0) / points.groove_stiffness) ** 2  # Eq. 2
    outputs |= {
        "friction_power_w": solution.friction_power / 1e3,
        "largest_penetration_um": 1e3 * np.maximum(in_groove, solution.needle_penetration),
        "energy_residual": solution.energy_residual,
    }
    outputs |= contacts
    block = BlockResult.blank(solution.settled.size, Outcome.FINISHED)
    for failed, kind, text in _endings(points, solution, energy_limit, spin_open, turns_on):
        block.end(np.flatnonzero(failed), kind, text)
    tests_all, tests_some = vibration_tests(keep)
    # a test costs hundreds of times as much as the equilibrium
    if tests_all or (tests_some and solution.needle_skew is not None):
        outputs |= _verdicts(points, block, tests_all, VIBRATION_THIRD in keep)
    needle_pressure = contacts.get("largest_needle_pressure_mpa", np.zeros(block.count))
    extremes = Extremes(solution.largest_normal_force, outputs["largest_penetration_um"], needle_pressure)
    add_contact_notes(block, points, extremes)
    block.steps[:] = block.force_evaluations[:] = solution.sweeps
    with np.errstate(divide="ignore"):  # a balance has no duration: the time of the requested revolutions
        turned = points.cycles * 2 * np.pi / points.speed
    block.simulated_seconds[:] = np.where(points.speed > 0, turned, np.nan)
    for name, data in outputs.items():
        if name in keep:
            block.put(name, JOINT_OUTPUTS[name].dims, slice(None), data)
    return block


def _endings(
    points: JointValues[FloatArray],
    solution: Equilibrium,
    energy_limit: float,
    spin_open: NDArray[np.bool_],
    turns_on: NDArray[np.bool_],
) -> list[tuple[NDArray[np.bool_], Outcome, str]]:
    """Points that end in some way, how and why; later ones replace earlier ones."""
    kept = np.zeros(solution.settled.size, bool) if solution.needles_settled is None else ~solution.needles_settled
    explained = np.abs(solution.unexplained_power) <= energy_limit + _left_by_tolerance(points, solution)
    return [
        (kept, Outcome.FINISHED, _NEEDLES_KEPT),
        (solution.upright, Outcome.FINISHED, _UPRIGHT),
        (spin_open, Outcome.FINISHED, _SPIN_OPEN),
        (~spin_open & ~explained, Outcome.INACCURATE, _UNEXPLAINED),
        (~spin_open & ~solution.settled, Outcome.DIVERGED, _UNSETTLED),
        (turns_on, Outcome.INACCURATE, _TURN_ON),
        (~(solution.smallest_normal_force >= 0), Outcome.OUT_OF_RANGE, "a roller lifts off its groove"),
        (points.bearing_radial_clearance < 0, Outcome.OUT_OF_RANGE, _PRELOADED),
    ]


def _verdicts(
    points: JointValues[FloatArray], block: BlockResult, all_of_them: bool, third: bool
) -> dict[str, FloatArray]:
    """Vibration outputs of a block: test all joints, or only those that may vibrate."""
    from tripod_doe.joint.vibration.vibration_verdict import judge_vibrations, rows_to_judge, undecided_rows

    rows = rows_to_judge(points, block)
    if not all_of_them:
        rows = undecided_rows(points, rows)
    if rows.size:
        prepare_multibody(points.take(rows[:1]), _DAMPS)
    return judge_vibrations(points, rows, block, third)


def some_vibrate(columns: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Whether joints vibrate, as `vibration_verdict.some_vibrate`; parameters by name, shape (point,) each."""
    from tripod_doe.joint.vibration.vibration_verdict import some_vibrate as verdict_of_some

    return verdict_of_some(internal_values(columns))


def _balance(name: str, solve: _Solve, tolerance: float, energy_limit: float, moves_needles: bool) -> Model:
    """Make a model that balances forces at every rotation angle instead of following a motion."""
    missing = {"thrust_amplitude_error", *RATES, *(set(VIBRATION_OUTPUTS) - set(VIBRATION_VERDICT))}
    if not moves_needles:
        missing |= {*SKEWS, *NEEDLE_NAMES, *CYCLE_OUTPUTS, "roller_tilt_deg"}
    simulate = partial(_simulate_balance, solve, energy_limit)

    def prepare(point: JointValues[FloatArray], method: str) -> None:
        program = _COMPILE_RUNS if moves_needles else ""  # for the first look for vibrations
        with first_compilation(f"model {name} with {method}", seconds=10, program=program):
            simulate(point, method, 30, ())

    return Model(
        name=name,
        methods={"newton": {"relative_tolerance": tolerance}},
        outputs=frozenset(JOINT_OUTPUTS) - missing,
        simulate=simulate,
        prepare=prepare,
    )


_SETTLED = frozenset(
    {
        "shaft_length_mm",
        "outboard_joint_angle_deg",
        "output_inertia_kg_m2",
        "contact_damping_s_per_mm",
        "contact_damping_time_s",
        "evaluation_budget",
    }
)
_OF_NEEDLES = frozenset(
    {
        "spheres_per_needle",
        "needle_axial_clearance_mm",
        "needle_crown_um",
        "needle_mass_factor",
        "cycles",
        "settled_needles",
    }
)
_MASSES = frozenset({"roller_width_mm", "shaft_mass_kg", "density_kg_m3"})


def _solve_equilibrium(
    points: JointValues[FloatArray], samples: int, names: frozenset[str], contacts: dict[str, FloatArray]
) -> Equilibrium:
    from tripod_doe.joint.force_balance.contact_results import ContactReader
    from tripod_doe.joint.force_balance.equilibrium import solve_equilibrium

    reader = ContactReader(points, names, samples, contacts) if names else None
    return solve_equilibrium(points, samples, reader)


def _solve_kinetostatic(
    points: JointValues[FloatArray], samples: int, names: frozenset[str], contacts: dict[str, FloatArray]
) -> Equilibrium:
    from tripod_doe.joint.force_balance.contact_results import ContactReader
    from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic

    reader = ContactReader(points, names, samples, contacts) if names.difference(CYCLE_OUTPUTS) else None
    return solve_kinetostatic(points, samples, reader=reader, names=names)


EQUILIBRIUM = replace(
    _balance("equilibrium", _solve_equilibrium, 1e-9, _ROUNDING, moves_needles=False),
    ignores=_SETTLED | _OF_NEEDLES | _MASSES,
    lacks=dict.fromkeys(("speed_rpm", *sorted(_MASSES)), "this model has no inertia"),
    valid=(*within(swing=0.05, needle=0.2), SLOW, NO_CROWN),
)
KINETOSTATIC = replace(
    _balance("kinetostatic", _solve_kinetostatic, 1e-6, _SPIDER_MOTION, moves_needles=True),
    ignores=_SETTLED,
    valid=(*within(swing=3, needle=0.5), CROWN_FOLLOWED),
)
