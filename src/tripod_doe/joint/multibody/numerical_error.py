"""Numerical error of a run, and the check whether its third order is accurate enough.

The error is measured, not assumed: the last revolution is run again in steps of half the size, from a sixth of a
revolution before it, and every order of the two is compared (`amplitude_error`). Light needles rattle: single needles
never agree between two runs or two revolutions; only the thrust must agree.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.accuracy import SMALLEST_THIRD
from tripod_doe.joint.multibody.thrust_and_power import groove_thrust
from tripod_doe.joint.orders import ORDERS, complex_amplitudes
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.run import Run
from tripod_doe.model_interface import Outcome

ERROR_LIMIT = 0.05
"""Share of the third order above which a numerical error makes a run with a given tolerance or step inaccurate."""

_UNREST_LIMIT = 1 / 3
"""Limit of the effective (rms) difference of the thrust in the last two revolutions over the third order. A joint that
rattles or swings slides to and fro at its grooves, which reduces the friction. Measured with benchmarks/guards.py: up
to 0.2 where the third order is right to 1 %, 0.39 where 5 % are lost."""

LEAD = 6
"""The revolution that is run again begins earlier by this part of one: a change of steps causes a transient (multistep
methods start with another method), which is no error of the run. It lasted up to 60 deg in tests."""


def finer_thrust(assembly: Assembly, again: Run, samples: int) -> FloatArray:
    """Axial force at each groove in the last revolution run again, at the run's samples, shape (groove, sample)."""
    return groove_thrust(assembly, *(x[2 * (samples // LEAD) : -1 : 2] for x in (again.positions, again.velocities)))


def amplitude_error(thrust: FloatArray, finer: FloatArray, samples: int, method: Method) -> FloatArray:
    """Numerical error of every order of the thrust, shape (order,): the change with half the steps, and scatter.

    A change d gives the error d / (1 - 2^-p) of a method of order p; p is 1 if a tolerance sets the step: half of it is
    half the error. Rattling parts make revolutions differ by chance, equally at all orders: the complex amplitudes of
    two revolutions by s (root mean square), and also those of a revolution and its repetition; this is no error of the
    method. The reported amplitude is of the mean of two revolutions: its standard deviation is s / (2 sqrt 2); twice
    that counts as chance, which is exceeded once in twenty. Hence

        error^2 = max(d^2 - s^2, 0) / (1 - 2^-p)^2 + s^2 / 2

    Args:
        thrust, finer: Thrust over the samples of a run, and over those of its last revolution run again in half the
            steps; if the repetition stopped before its end, the error is NaN.
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
    """State in words why the third order of a run with a given tolerance or step is too inaccurate; empty if it is not.

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
    """Outcome of a run from the accuracy of its orders, with the reason for a failure.

    Args:
        thrust: Of the last revolutions, shape (revolution, sample).
        missed: Why its numerical error is too large; empty if it is not.
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
