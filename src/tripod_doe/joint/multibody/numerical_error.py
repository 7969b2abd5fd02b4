"""Numerical error of a run, and whether its third order may be used.

The error is measured, not assumed: the last revolution is run again in steps of half the size, from a sixth of a
revolution before it, and every order of the two is compared (`amplitude_error`). Light needles rattle, so that two runs
never agree needle by needle, nor do two revolutions; what has to agree is the thrust.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.multibody.thrust_and_power import groove_thrust
from tripod_doe.joint.order_accuracy import SMALLEST_THIRD
from tripod_doe.joint.orders import ORDERS, complex_amplitudes
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.run import Run
from tripod_doe.model_interface import Outcome

ERROR_LIMIT = 0.05
"""Share of the third order above which a numerical error makes a run with a given tolerance or step inaccurate."""

_UNREST_LIMIT = 1 / 3
"""Effective difference of the thrust's waveforms in the last two revolutions over the third order above which a run is
inaccurate. A joint that rattles or swings slides to and fro at its grooves, which reduces the friction. Measured with
benchmarks/guards.py: up to 0.2 where the third order is right to 1 %, 0.39 where 5 % are lost."""

LEAD = 6
"""The revolution that is run again begins earlier by this part of one: other steps start with a jolt, multistep methods
with another method's step, which is no error of the run. It was seen to ring for up to 60 deg."""


def finer_thrust(assembly: Assembly, again: Run, samples: int) -> FloatArray:
    """Axial force at each groove in the last revolution run again, at the run's samples, shape (groove, sample)."""
    return groove_thrust(assembly, *(x[2 * (samples // LEAD) : -1 : 2] for x in (again.positions, again.velocities)))


def amplitude_error(thrust: FloatArray, finer: FloatArray, samples: int, method: Method) -> FloatArray:
    """Numerical error of every order of the thrust, shape (order,): the change with half the steps, and scatter.

    A method of order p that changes by d is off by d / (1 - 2^-p); p is 1 where a tolerance sets the step: half of it
    is half the error. Where parts rattle, revolutions differ by chance, at all orders alike: complex amplitudes of two
    revolutions by s (root mean square), and so do those of a revolution and of the same run again, which is no error
    of the method. The reported amplitude belongs to the mean of two revolutions: s / (2 sqrt 2) is its standard
    deviation, and twice that is taken for chance, which it exceeds once in twenty. Hence

        error^2 = max(d^2 - s^2, 0) / (1 - 2^-p)^2 + s^2 / 2

    Args:
        thrust, finer: Thrust over the samples of a run, and over those of its last revolution run again in half the
            steps; where that stopped before its end, the error is NaN.
        method: The method of both.
    """
    if finer.size < samples:
        return np.full(ORDERS.size, np.nan)
    last, before = thrust[-samples:], thrust[-2 * samples : -samples]
    change, chance = np.abs(complex_amplitudes(last - finer)), np.abs(complex_amplitudes(last - before)[1:])
    scatter = (chance**2).mean()
    share = 1 - 0.5 ** (1 if method.controlled else method.order)
    error: FloatArray = np.sqrt(np.maximum(change**2 - scatter, 0) / share**2 + scatter / 2)
    return error


def miss_of_given(result: Run, again: Run, thrust: FloatArray, error: FloatArray, values: JointValues[float]) -> str:
    """By how much the third order of a run with a given tolerance or step misses what may be used, or nothing.

    Args:
        result, again: The run, and its last revolution run again.
        thrust: Of the last revolutions, shape (revolution, sample).
        error: Numerical error of every order.
    """
    if again.outcome != Outcome.FINISHED:
        return f"the run with half the tolerance or step failed: {again.detail}"
    third = abs(complex_amplitudes(thrust).mean(0)[3])
    if error[3] <= ERROR_LIMIT * max(third, SMALLEST_THIRD * abs(values.torque) / values.pitch_radius):
        return ""
    advice = "lower relative_tolerance or step_s"
    return f"{error[3]:.3g} N of {third:.3g} N of the third order are numerical error; {advice}"


def judge(result: Run, thrust: FloatArray, missed: str, values: JointValues[float]) -> tuple[Outcome, str]:
    """Whether the orders of a run may be used: its outcome, and why not.

    Args:
        thrust: Of the last revolutions, shape (revolution, sample).
        missed: Why its numerical error is too large; empty where it is not.
    """
    if result.outcome != Outcome.FINISHED:
        return result.outcome, result.detail
    third = abs(complex_amplitudes(thrust).mean(0)[3])
    if not np.isfinite(third):
        return Outcome.DIVERGED, "the thrust is not finite"
    if missed:
        return Outcome.INACCURATE, missed
    unrest = math.sqrt(2 * float(((thrust[-1] - thrust[-2]) ** 2).mean()))
    floor = ERROR_LIMIT * SMALLEST_THIRD * abs(values.torque) / values.pitch_radius
    if unrest > max(_UNREST_LIMIT * third, floor):
        text = f"the thrust of the last two revolutions differs by {unrest:.3g} N (third order: {third:.3g} N)"
        return Outcome.INACCURATE, f"{text}: the joint rattles or still swings; lower the step or raise cycles"
    return Outcome.FINISHED, ""
