"""What a run of a multibody model came to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.mechanics.rates import Rates
from tripod_doe.simulator import Outcome

__all__ = ["JointRun", "Readings", "VibrationReadings"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class VibrationReadings:
    """A self-excited vibration in numbers, in the order of `outputs.VIBRATION_OUTPUTS`.

    Attributes
    ----------
    growth
        Factor by which it grows per revolution while it is small; 1 where none grows.
    rate
        The same as a rate, 1/s; 0 where none grows.
    hertz
        Its frequency while it is small; 0 where none grows.
    unrest
        Effective value of the thrust above the orders that are reported.
    """

    growth: float
    rate: float
    hertz: float
    unrest: float


@dataclass(frozen=True)
class Readings:
    """What is read off a run that came to its end, in internal units.

    Attributes
    ----------
    groove_thrust
        Axial force on the housing at each groove in the last revolutions, two or more, shape (revolution, groove,
        sample).
    thrust_parts
        Part of each mechanism in their sum, shape (revolution, part, sample); None unless requested.
    friction_power
        Mean power lost to each mechanism over these revolutions, shape (mechanism,).
    amplitude_error
        Numerical error of every order of the thrust, shape (order,); NaN where it is not known.
    skew, skew_summary
        Skew of the needle that carries the most, shape (trunnion, 2 x sample), and its mean, smallest and largest value
        in every revolution, shape (trunnion, cycle, 3); rad, None without needles.
    penetration
        See `mechanics.run.Run`.
    energy_residual
        Energy that the balance misses over what friction dissipates, or over a thousandth of the transmitted energy.
    rates
        What limits the step in the last third of a revolution; None unless requested.
    vibration
        How the joint vibrates by itself; None where it was not asked.
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
    vibration: VibrationReadings | None = None


@dataclass(frozen=True)
class JointRun:
    """What became of a run.

    Attributes
    ----------
    outcome, detail
        How it ended, and why it failed or a note on it.
    readings
        Its results, whatever its outcome; None if it stopped before its end.
    setting
        Tolerance or step of its results; NaN where nothing was run.
    settled
        Whether the run found it by itself.
    steps, force_evaluations, solves
        Counted work of all passes, with that of the error estimate.
    followed
        Time of the motion, up to its end or the failure.
    """

    outcome: Outcome
    detail: str
    readings: Readings | None = None
    setting: float = math.nan
    settled: bool = False
    steps: int = 0
    force_evaluations: int = 0
    solves: int = 0
    followed: float = 0.0
