"""Runs of the multibody models: from one operating point to thrust, friction powers, skews and a numerical error.

A run follows `cycles` revolutions from the balanced start; the last two are sampled. The required accuracy sets its
steps (`refinement`). With a given tolerance or step, the last revolution is run again in finer steps for the numerical
error (`numerical_error`).

Halving steps cannot reveal motions that all affordable steps damp: many joints vibrate by themselves. So each joint is
tested for that first (`vibration.growing_vibration`). If one vibrates, runs by the models' own method follow the
vibration, and others are compared with it (`vibration.vibrating_run`). So do `rollers` without a result otherwise: some
vibrate only after a kick, such as their start.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import OrderAccuracy
from tripod_doe.joint.multibody.contact_results import contact_readings
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.numerical_error import (
    ERROR_LIMIT,
    LEAD,
    amplitude_error,
    finer_thrust,
    judge,
    miss_of_given,
)
from tripod_doe.joint.multibody.passes import FollowedJoint, Motion
from tripod_doe.joint.multibody.refinement import first_tolerance, refine
from tripod_doe.joint.multibody.revolutions import unrest
from tripod_doe.joint.multibody.run_result import JointRun, Readings, VibrationReadings, Wanted
from tripod_doe.joint.multibody.sampled_signals import sampled_signals
from tripod_doe.joint.multibody.thrust_and_power import groove_readings, groove_thrust, has_needle_bodies, needle_skews
from tripod_doe.joint.multibody.thrust_parts import thrust_parts
from tripod_doe.joint.orders import ORDERS, ahead, complex_amplitudes
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration.growing_vibration import Vibration, growing_vibration
from tripod_doe.joint.vibration.vibration_effect import VibratingJoint
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, deepest_penetration, method_named, run
from tripod_doe.mechanics.stability.floquet import Growth, departure_matrices
from tripod_doe.mechanics.stability.linearisation import fastest_rates
from tripod_doe.mechanics.stability.rates import Rates
from tripod_doe.model_interface import Outcome

_LIMITS = Limits(energy=math.inf, reversals=1.0, drift=1e-2, windows=0)
"""Light needles reverse their slip without effect on the thrust; a wrong run shows a different thrust at half the
tolerance. Constraints act only at the far end of the shaft, where a micrometre turns it by 3e-6 rad."""

_EXPLICIT_ENERGY = 0.5
"""Allowed energy error of an explicit method over the work of friction: it has no numerical damping, so that the error
is chattering friction. An implicit method damps unresolved motion, rattling and the transient of the start, without
effect on the thrust (benchmarks/guards.py)."""

_TURNED_OVER = 1e-3
"""Least reference of an energy balance, over the transmitted energy: a straight joint dissipates nothing, so friction
work cannot be the reference of its rounding errors."""

_DAMPS = "adaptive-euler"
"""The models' own method, which damps vibrations."""

_DIES_OUT = Growth(1.0, 0.0, 0.0)
"""Growth of departures from a stable motion, in which a kick may still excite a vibration."""

_RATE_STATES = 12
"""Number of states in a third of a revolution at which a run is linearised."""


def run_joint(
    values: JointValues[float],
    needles: bool,
    method: str,
    wanted: Wanted,
    accuracy: OrderAccuracy | None = None,
    usual: float = math.nan,
) -> JointRun:
    """Simulate one operating point.

    Args:
        needles: Model ``needles`` (True) or ``rollers``.
        method: Integration method; the values contain its step or tolerance if given.
        accuracy: Required accuracy of a run without a given tolerance or step; default: the third order's `accuracy` in
            the values.
        usual: Tolerance or step that such a run begins with, by a method other than `adaptive-euler`.
    """
    accuracy, samples = accuracy or OrderAccuracy({3: values.accuracy}), wanted.samples
    settles = math.isnan(values.step) and math.isnan(values.relative_tolerance)
    lumped, vibrating = assemble(build_joint(values, needles=False)), None
    if vibration := growing_vibration(values, lumped):
        vibrating = _vibrating(values, vibration, wanted, accuracy)
        if settles and method == _DAMPS and (answer := vibrating.answer(needles)):
            return _with_last(answer, vibrating.last_revolution, values, wanted)
    assembly = assemble(build_joint(values, needles)) if needles else lumped
    if settles:
        motion = _follow_to(accuracy, assembly, values, method, samples, usual)
    else:
        motion = _follow_given(assembly, values, method, samples)
    result = motion.result
    if not motion.sampled:
        done = JointRun(result.outcome, result.detail, followed=result.followed)
        return _counted(done, motion, settles)
    done = _judged(assembly, motion, values, wanted, vibration)
    if done.outcome == Outcome.FINISHED and vibrating:
        outcome, detail = vibrating.verdict(None if needles else _third(done), ERROR_LIMIT)
        done = replace(done, outcome=outcome, detail=detail)
    elif done.outcome == Outcome.INACCURATE and settles and method == _DAMPS and not needles:
        kicked = _kicked(done, motion, vibrating, values, wanted, accuracy)
        return kicked or _counted(done, motion, settles)
    return _counted(done, motion, settles)


def _judged(
    assembly: Assembly, motion: Motion, values: JointValues[float], wanted: Wanted, vibration: Vibration | None
) -> JointRun:
    """What a motion that was sampled says of its joint, and how it ended."""
    result, readings = motion.result, _read(assembly, motion, values, wanted)
    if wanted.rates:
        readings = replace(readings, rates=_rates(result, values, wanted.samples))
    thrust = readings.groove_thrust.sum(1)
    growth = vibration.growth if vibration else _DIES_OUT
    small = growth.factor, growth.rate, vibration.hertz if vibration else 0.0
    readings = replace(readings, vibration=VibrationReadings(*small, unrest(thrust[-1])))
    outcome, detail = judge(result, thrust, motion.missed, values)
    return JointRun(outcome, detail, readings, followed=float(result.times[-1]))


def _third(done: JointRun) -> float:
    """Amplitude of the third order of the thrust force in N, of a run with readings."""
    assert done.readings is not None
    return float(abs(complex_amplitudes(done.readings.groove_thrust.sum(1)).mean(0)[3]))


def _counted(done: JointRun, motion: Motion, settles: bool) -> JointRun:
    """A run with the setting and the work of its motion."""
    return replace(
        done,
        setting=motion.setting,
        settled=settles,
        steps=sum(part.steps for part in motion.runs),
        solves=sum(part.solves for part in motion.runs),
        force_evaluations=sum(part.force_evaluations for part in motion.runs),
    )


def _kicked(
    done: JointRun,
    motion: Motion,
    vibrating: VibratingJoint | None,
    values: JointValues[float],
    wanted: Wanted,
    accuracy: OrderAccuracy,
) -> JointRun | None:
    """A finished run in place of an inaccurate one of `rollers` whose start may have excited a vibration.

    None if there is none: the motion swings, or it misses its accuracy although it repeats and its departures die out.
    """
    if motion.swings or not (vibrating or not motion.missed or not motion.repeats):
        return None
    kicked = vibrating or _vibrating(values, Vibration(_DIES_OUT, _third(done), unrest=0.0), wanted, accuracy)
    answer = kicked.answer(needles=False, anyhow=True)
    if answer is None or answer.outcome != Outcome.FINISHED:
        return None
    return _with_last(answer, kicked.last_revolution, values, wanted)


def _vibrating(
    values: JointValues[float], vibration: Vibration, wanted: Wanted, accuracy: OrderAccuracy
) -> VibratingJoint:
    """Prepare a vibrating joint to be followed to an accuracy."""
    limits, allowed = run_limits(values, 1, _DAMPS), partial(accuracy.allowed, values=values)
    return VibratingJoint(values, vibration, wanted, limits, allowed)


def _follow_to(
    accuracy: OrderAccuracy, assembly: Assembly, values: JointValues[float], method: str, samples: int, usual: float
) -> Motion:
    """The motion with the tolerance or step that an accuracy needs."""
    joint = FollowedJoint(assembly, values, method_named(method), samples, run_limits(values, 1, method))
    return refine(joint, accuracy, first_tolerance(accuracy, joint.remembers) if method == _DAMPS else usual)


def _follow_given(assembly: Assembly, values: JointValues[float], method: str, samples: int) -> Motion:
    """The motion with a given tolerance or step."""
    controlled = method_named(method).controlled
    setting = values.relative_tolerance if controlled else values.step
    settings = Settings(budget=int(values.evaluation_budget))
    settings = settings._replace(tolerance=setting) if controlled else settings
    result, again = follow(assembly, values, method, samples, None if controlled else setting, settings)
    if again is None:
        return Motion(result, 0, setting, 0.0, np.full(ORDERS.size, math.nan), "", (result,))
    joint = FollowedJoint(assembly, values, method_named(method), samples, run_limits(values, 1, method))
    states, lag = slice(-2 * samples - 1, -1), joint.lag(setting)
    thrust = groove_thrust(assembly, result.positions[states], result.velocities[states]).sum(0)
    thrust = ahead(thrust.reshape(2, samples), lag)
    finer = finer_thrust(assembly, again, samples).sum(0)
    finer = ahead(finer, joint.lag(setting / 2)) if finer.size == samples else finer
    error = amplitude_error(thrust.ravel(), finer, samples, method_named(method))
    missed = miss_of_given(result, again, thrust, error, values)
    return Motion(result, 2, setting, lag, error, missed, (result, again))


def follow(
    assembly: Assembly, values: JointValues[float], method: str, samples: int, step: float | None, settings: Settings
) -> tuple[Run, Run | None]:
    """Follow all revolutions, and then the last one, and a little before it, again with half the tolerance or step.

    Returns:
        result, again: `again` is None where the run stopped before its end.
    """
    cycles, revolution = int(values.cycles), 2 * math.pi / values.speed
    result = run(
        assembly,
        method,
        cycles * revolution,
        step=step,
        samples=cycles * samples,
        settings=settings,
        limits=run_limits(values, cycles, method),
    )
    if result.times.size <= cycles * samples:  # it stopped before its end
        return result, None
    followed = samples + samples // LEAD
    start = State(float(result.times[-1 - followed]), *(x[-1 - followed] for x in _states(result)))
    # steps divide the time between samples, so that is halved, too
    again = run(
        assembly,
        method,
        float(result.times[-1] - start.time),
        step=step and step / 2,
        samples=2 * followed,
        settings=settings._replace(tolerance=settings.tolerance / 2),
        limits=run_limits(values, 1, method),
        start=start,
    )
    return result, again


def _rates(result: Run, values: JointValues[float], samples: int) -> Rates:
    """Rates that limit the step in the last third of a revolution, after which it repeats, at the pace of order 3."""
    chosen = np.unique(np.linspace(-1 - samples // 3, -1, _RATE_STATES, endpoint=False).round().astype(int))
    states = [State(float(result.times[k]), result.positions[k], result.velocities[k]) for k in chosen]
    return fastest_rates(result.assembly, states, pace=3 * values.speed)


def _with_last(answer: JointRun, turn: Run | None, values: JointValues[float], wanted: Wanted) -> JointRun:
    """Add what is read off the last revolution to the answer of a vibrating joint: rates that limit the step, contacts.

    Contacts of the last revolution stand for those of the last two.
    """
    if answer.readings is None or turn is None:
        return answer
    readings = answer.readings
    if wanted.rates:
        readings = replace(readings, rates=_rates(turn, values, turn.times.size - 1))
    if wanted.contacts:
        positions, velocities = (np.concatenate([x[:-1], x[:-1]]) for x in _states(turn))
        contacts = contact_readings(turn.assembly, positions, velocities, values, wanted.contacts)
        readings = replace(readings, contacts=contacts)
    return replace(answer, readings=readings)


def _states(result: Run) -> tuple[FloatArray, FloatArray]:
    return result.positions, result.velocities


def run_limits(values: JointValues[float], cycles: float, method: str) -> Limits:
    """Bounds for a run of some revolutions."""
    transmitted = abs(values.torque) * 2 * math.pi * cycles
    energy = _EXPLICIT_ENERGY if method_named(method).explicit else _LIMITS.energy
    return replace(_LIMITS, energy=energy, turned_over=_TURNED_OVER * transmitted)


def _read(assembly: Assembly, motion: Motion, values: JointValues[float], wanted: Wanted) -> Readings:
    """Read all results from the sampled revolutions of a motion."""
    result, samples = motion.result, wanted.samples
    skew, summary = None, None
    if has_needle_bodies(assembly):
        cycles = int(values.cycles)
        skew, summary = needle_skews(assembly, result.positions[: cycles * samples], values, cycles)
        skew = skew[:, -2 * samples :]
    signals = sampled_signals(motion, values, wanted)
    two = np.arange(-2 * samples - 1, -1)
    if motion.extrapolation:  # the last revolution alone was followed in finer steps
        two = np.tile(two[samples:], 2)
    states = result.positions[two], result.velocities[two]
    return Readings(
        signals.groove_thrust,
        signals.parts,
        signals.powers.mean((0, 2)),
        motion.error,
        skew,
        summary,
        deepest_penetration(assembly, *states),  # not of the initial transient, whose steps may be coarse
        result.energy_residual,
        contacts=contact_readings(assembly, *states, values, wanted.contacts),
    )


_COMPILED: set[str] = set()
"""Methods whose runs this process has compiled."""


def compile_joint(values: JointValues[float], method: str) -> None:
    """Compile all that a run needs, by a step of a joint without needle bodies: its tables are of the same types.

    Once per process: the step and its readings cost as much as the balances of some ten joints.
    """
    if method in _COMPILED:
        return
    assembly = assemble(build_joint(values, needles=False))
    with first_compilation(f"models rollers and needles with {method}", seconds=45):
        result = run(assembly, method, 1e-9, step=1e-9, settings=Settings(tolerance=1e-3), limits=_LIMITS)
        groove_readings(assembly, result.positions, result.velocities)
        thrust_parts(assembly, result.times, result.positions, result.velocities, values)
        departure_matrices(assembly, [assembly.initial_state()])
    _COMPILED.add(method)
