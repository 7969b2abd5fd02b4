"""Runs of the multibody models: from one operating point to thrust, friction powers, skews and a numerical error.

A run follows `cycles` revolutions from the balanced start; the last two are sampled. Its numerical error is measured,
not assumed: the last revolution is run again in steps of half the size, from a sixth of a revolution before it, and
every order of the two is compared (`amplitude_error`). Light needles rattle, so that two runs never agree needle by
needle, nor do two revolutions; what has to agree is the thrust.

Halving steps cannot show what all affordable steps damp: at low torque and speed the joint vibrates by itself, at some
hundred hertz. Runs that pass all else are therefore asked what a vibration would take (`joint.vibration`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.multibody import build_joint
from tripod_doe.joint.orders import ORDERS, complex_amplitudes
from tripod_doe.joint.readings import groove_readings, groove_thrust, needle_skews
from tripod_doe.joint.thrust_parts import thrust_parts
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration import vibration
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.floquet import fastest_growth
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.linearisation import Rates, fastest_rates
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, method_named, run
from tripod_doe.simulator import Outcome

__all__ = ["JointRun", "Readings", "amplitude_error", "finer_thrust", "follow", "judge", "prepare_joint", "run_joint"]

FloatArray = NDArray[np.float64]

_LIMITS = Limits(energy=math.inf, reversals=1.0, drift=1e-2, windows=0)
"""Light needles reverse their slip, which does not reach the thrust; what a wrong run shows is its thrust at half the
tolerance. Constraints act only at the far end of the shaft, where a micrometre turns it by 3e-6 rad."""

_EXPLICIT_ENERGY = 0.5
"""Share of the friction's work that an explicit method may miss: it damps nothing by itself, so that what it misses is
friction that chatters. An implicit method is there to damp what its steps do not resolve, rattling and the jolt of the
start, and that says nothing of the thrust: of 252 runs (benchmarks/guards.py) 60 missed more than half; the 43 wrong
ones were all refused for something else, too; of ten refused for this alone, all implicit, nine were good to 1 %."""

_TURNED_OVER = 1e-3
"""Share of the transmitted energy that an energy balance counts against where friction takes less: a straight joint
loses nothing, and nothing is not what its rounding should be measured by."""

_ERROR_LIMIT, _ERROR_FLOOR = 0.05, 1e-4
"""Share of the third order, and of |T| / R_p, above which a numerical error makes a run inaccurate."""

_UNREST_LIMIT = 1 / 3
"""Effective difference of the thrust's waveforms in the last two revolutions over the third order above which a run is
inaccurate. A joint that rattles or swings slides to and fro at its grooves, which takes part of the friction away.
Measured on 110 runs (benchmarks/guards.py): up to 0.2 where the third order is good to 1 %, 0.39 where 5 % are lost."""

_LEAD = 6
"""Part of a revolution by which the one that is run again begins earlier: other steps start with a jolt, multistep
methods with another method's step, and that is no error of the run. Seen to ring for up to 60 deg."""

_RATE_STATES = 12
"""States of a third of a revolution at which a run is linearised."""


@dataclass(frozen=True)
class Readings:
    """What is read off a run that came to its end, in internal units.

    Attributes
    ----------
    groove_thrust
        Axial force on the housing at each groove in the last two revolutions, shape (2, groove, sample).
    thrust_parts
        What each mechanism adds to their sum, shape (2, part, sample); None where it was not asked for.
    friction_power
        Mean power lost to each mechanism over the last two revolutions, shape (mechanism,).
    amplitude_error
        Numerical error of every order of the thrust, shape (order,); NaN if the last revolution could not be run again.
    skew, skew_summary
        Skew of the needle that carries the most, shape (trunnion, 2 x sample), and its mean, least and greatest value
        in every revolution, shape (trunnion, cycle, 3); rad, None without needles.
    penetration
        See `mechanics.run.Run`.
    energy_residual
        Energy that the balance misses over what friction takes, or over a thousandth of the transmitted energy.
    rates
        What limits the step on the way through the last third of a revolution; None unless asked for.
    """

    groove_thrust: FloatArray
    thrust_parts: FloatArray | None
    friction_power: FloatArray
    amplitude_error: FloatArray
    skew: FloatArray | None
    skew_summary: FloatArray | None
    penetration: float
    energy_residual: float
    rates: Rates | None = None


@dataclass(frozen=True)
class JointRun:
    """What became of a run.

    Attributes
    ----------
    outcome, detail
        How it ended, and why it failed or what is to be known of it besides.
    readings
        What it gives, whatever its outcome; None if it did not come to its end.
    steps, force_evaluations, solves
        Counted work, with that of the error estimate.
    followed
        Time that was simulated, up to the end or the failure; without that of the error estimate.
    """

    outcome: Outcome
    detail: str
    readings: Readings | None = None
    steps: int = 0
    force_evaluations: int = 0
    solves: int = 0
    followed: float = 0.0


def run_joint(
    values: JointValues[float], needles: bool, method: str, samples: int, step: float | None,
    tolerance: float | None, rates: bool = False, split: bool = False,
) -> JointRun:  # fmt: skip
    """Simulate one operating point.

    Parameters
    ----------
    values
        The operating point.
    needles
        Model ``needles`` (True) or ``rollers``.
    method, step, tolerance
        Numerics; a method uses a step or a tolerance.
    samples
        Samples a revolution.
    rates
        Whether to find what limits the step.
    split
        Whether the thrust is split into what each mechanism adds.
    """
    if reason := _out_of_range(values):
        return JointRun(Outcome.OUT_OF_RANGE, reason)
    assembly = assemble(build_joint(values, needles))
    settings = Settings(budget=int(values.evaluation_budget), tolerance=tolerance or Settings().tolerance)
    result, again = follow(assembly, values, method, samples, step, settings)
    if again is None:
        done = JointRun(result.outcome, result.detail)
    else:
        readings = _read(assembly, result, again, values, samples, method_named(method), split)
        if rates:
            readings = replace(readings, rates=_rates(result, values, samples))
        outcome, detail = judge(result, again, readings.groove_thrust.sum(1), readings.amplitude_error, values)
        if outcome == Outcome.FINISHED and (
            found := vibration(values, _ERROR_LIMIT, result, samples, method, settings.tolerance)
        ):
            outcome, detail = (Outcome.INACCURATE if found.spoils else outcome), found.told
        done = JointRun(outcome, detail, readings)
    parts = [part for part in (result, again) if part]
    return replace(
        done, steps=sum(part.steps for part in parts), followed=result.followed,
        force_evaluations=sum(part.force_evaluations for part in parts), solves=sum(part.solves for part in parts),
    )  # fmt: skip


def follow(
    assembly: Assembly, values: JointValues[float], method: str, samples: int, step: float | None, settings: Settings
) -> tuple[Run, Run | None]:
    """Follow all revolutions, and then the last one, and a little before it, again with half the tolerance or step.

    Returns
    -------
    result, again
        `again` is None where the run did not come to its end.
    """
    cycles, revolution = int(values.cycles), 2 * math.pi / values.speed
    result = run(
        assembly, method, cycles * revolution, step=step, samples=cycles * samples, settings=settings,
        limits=_limits(values, cycles, method),
    )  # fmt: skip
    if result.times.size <= cycles * samples:  # it stopped on its way
        return result, None
    followed = samples + samples // _LEAD
    start = State(float(result.times[-1 - followed]), *(x[-1 - followed] for x in _states(result)))
    # steps divide the time between samples, so that is halved, too
    again = run(
        assembly, method, float(result.times[-1] - start.time), step=step and step / 2, samples=2 * followed,
        settings=settings._replace(tolerance=settings.tolerance / 2), limits=_limits(values, 1, method), start=start,
    )  # fmt: skip
    return result, again


def _rates(result: Run, values: JointValues[float], samples: int) -> Rates:
    """What limits the step in the last third of a revolution, after which it repeats; the pace is the third order's."""
    chosen = np.unique(np.linspace(-1 - samples // 3, -1, _RATE_STATES, endpoint=False).round().astype(int))
    states = [State(float(result.times[k]), result.positions[k], result.velocities[k]) for k in chosen]
    return fastest_rates(result.assembly, states, pace=3 * values.speed)


def _states(result: Run) -> tuple[FloatArray, FloatArray]:
    return result.positions, result.velocities


def _limits(values: JointValues[float], cycles: float, method: str) -> Limits:
    """What a run of so many revolutions may show."""
    transmitted = abs(values.torque) * 2 * math.pi * cycles
    energy = _EXPLICIT_ENERGY if method_named(method).explicit else _LIMITS.energy
    return replace(_LIMITS, energy=energy, turned_over=_TURNED_OVER * transmitted)


def _read(
    assembly: Assembly, result: Run, again: Run, values: JointValues[float], samples: int, method: Method, split: bool
) -> Readings:
    """Everything that is read off the last two revolutions of a run, and off the last one run again."""
    times, positions, velocities = (x[-2 * samples - 1 :] for x in (result.times, result.positions, result.velocities))
    thrust, powers = groove_readings(assembly, positions, velocities)
    error = amplitude_error(thrust.sum(0), finer_thrust(assembly, again, samples).sum(0), samples, method)
    last = slice(0, -1)  # the end of the last revolution is the start of the next one
    skew, summary = None, None
    if "needle 1.1" in assembly.names:
        skew, summary = needle_skews(assembly, result.positions[:-1], values, int(values.cycles))
        skew = skew[:, -2 * samples :]
    parts = thrust_parts(assembly, times, positions, velocities, values).sum(1) if split else None
    return Readings(
        _by_revolution(thrust[:, last]), None if parts is None else _by_revolution(parts[:, last]),
        powers[:, last].mean(1), error, skew, summary, result.penetration, result.energy_residual,
    )  # fmt: skip


def _by_revolution(signals: FloatArray) -> FloatArray:
    """Signals over two revolutions, (signal, sample) -> (revolution, signal, sample)."""
    two: FloatArray = np.moveaxis(signals.reshape(len(signals), 2, -1), 1, 0)
    return two


def prepare_joint(values: JointValues[float], method: str) -> None:
    """Compile all that a run needs, by a step of a joint without needle bodies: its tables are of the same types."""
    assembly = assemble(build_joint(values, needles=False))
    result = run(assembly, method, 1e-9, step=1e-9, settings=Settings(tolerance=1e-3), limits=_LIMITS)
    groove_readings(assembly, result.positions, result.velocities)
    thrust_parts(assembly, result.times, result.positions, result.velocities, values)
    fastest_growth(assembly, [assembly.initial_state()], 1e-3)


def _out_of_range(values: JointValues[float]) -> str:
    """Why the motion of this operating point has no thrust orders to be read off, or nothing."""
    if not values.speed > 0:
        return "a joint at rest never completes a revolution; use model equilibrium"
    if values.torque == 0:
        return "without torque nothing holds the rollers against their grooves; give one, or use model equilibrium"
    return ""


def finer_thrust(assembly: Assembly, again: Run, samples: int) -> FloatArray:
    """Axial force at each groove in the last revolution run again, at the run's samples, shape (groove, sample)."""
    return groove_thrust(assembly, *(x[2 + 2 * (samples // _LEAD) :: 2] for x in _states(again)))


def amplitude_error(thrust: FloatArray, finer: FloatArray, samples: int, method: Method) -> FloatArray:
    """Numerical error of every order of the thrust, shape (order,): what half the steps change, and chance.

    A method of order p that changes by d is off by d / (1 - 2^-p); p is 1 where a tolerance sets the step: half of it
    is half the error. Where parts rattle, revolutions differ by chance, at all orders alike: complex amplitudes of two
    revolutions by s (root mean square), and so do those of a revolution and of the same run again, which is no error
    of the method. The reported amplitude is that of the mean of two revolutions: s / (2 sqrt 2) is its standard
    deviation, and twice that is taken for chance, which it exceeds once in twenty. Hence

        error^2 = max(d^2 - s^2, 0) / (1 - 2^-p)^2 + s^2 / 2

    Parameters
    ----------
    thrust, finer
        Thrust over the samples of a run, and over those of its last revolution run again in half the steps; NaN is
        the answer where that did not come to its end.
    samples
        Samples a revolution.
    method
        The method of both.
    """
    if finer.size < samples:
        return np.full(ORDERS.size, np.nan)
    last, before = thrust[-samples:], thrust[-2 * samples : -samples]
    change, chance = np.abs(complex_amplitudes(last - finer)), np.abs(complex_amplitudes(last - before)[1:])
    scatter = (chance**2).mean()
    found = 1 - 0.5 ** (1 if method.controlled else method.order)
    error: FloatArray = np.sqrt(np.maximum(change**2 - scatter, 0) / found**2 + scatter / 2)
    return error


def judge(
    result: Run, again: Run, thrust: FloatArray, amplitude_error: FloatArray, values: JointValues[float]
) -> tuple[Outcome, str]:
    """Whether the third order of a run may be used: its outcome, and why not.

    Parameters
    ----------
    result, again
        The run, and its last revolution run again.
    thrust
        Of the last revolutions, shape (revolution, sample).
    amplitude_error
        Numerical error of every order.
    values
        The operating point.
    """
    if result.outcome != Outcome.FINISHED:
        return result.outcome, result.detail
    if again.outcome != Outcome.FINISHED:
        return Outcome.INACCURATE, f"half the tolerance or step fails: {again.detail}"
    third, error = abs(complex_amplitudes(thrust).mean(0)[3]), amplitude_error[3]
    floor = _ERROR_FLOOR * abs(values.torque) / values.pitch_radius
    if not np.isfinite(third):
        return Outcome.DIVERGED, "the thrust is not finite"
    if not error <= max(_ERROR_LIMIT * third, floor):
        advice = "lower relative_tolerance or step_s"
        return Outcome.INACCURATE, f"{error:.3g} N of {third:.3g} N of the third order are numerical error; {advice}"
    unrest = math.sqrt(2 * float(((thrust[1] - thrust[0]) ** 2).mean()))
    if unrest > max(_UNREST_LIMIT * third, floor):
        text = f"the thrust of the last two revolutions differs by {unrest:.3g} N, the third order being {third:.3g} N"
        return Outcome.INACCURATE, f"{text}: the joint rattles or still swings; lower the step or raise cycles"
    return Outcome.FINISHED, ""
