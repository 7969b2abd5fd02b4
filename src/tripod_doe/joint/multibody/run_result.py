"""The result of a run of a multibody model, and its requested outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.run import Run
from tripod_doe.mechanics.stability.rates import Rates
from tripod_doe.model_interface import Outcome


class StoppedError(Exception):
    """A run stopped before its end."""

    def __init__(self, stopped: Run) -> None:
        super().__init__(stopped.detail)
        self.stopped = stopped


@dataclass(frozen=True)
class Wanted:
    """Requested results of a run."""

    samples: int  # samples per revolution
    rates: bool = False  # whether to find what limits the step
    split: bool = False  # whether to split the thrust into the parts of the mechanisms
    contacts: frozenset[str] = frozenset()  # outputs of contacts


@dataclass(frozen=True)
class VibrationReadings:
    """A self-excited vibration in numbers, in the order of `outputs.VIBRATION_OUTPUTS`."""

    growth: float  # factor by which it grows per revolution while it is small; 1 where none grows
    rate: float  # the same as a rate, 1/s; 0 where none grows
    hertz: float  # its frequency while it is small; 0 where none grows
    unrest: float  # effective value of the thrust above the orders that are reported


@dataclass(frozen=True)
class Readings:
    """Results read off a complete run, in internal units."""

    # axial force on the housing at each groove in the last revolutions, two or more, shape (revolution, groove, sample)
    groove_thrust: FloatArray
    # part of each mechanism in their sum, shape (revolution, part, sample); None unless requested
    thrust_parts: FloatArray | None
    friction_power: FloatArray  # mean power lost to each mechanism over these revolutions, shape (mechanism,)
    # numerical error of every order of the thrust, shape (order,); NaN if unknown
    amplitude_error: FloatArray
    # skew, skew_summary: skew of the needle that carries the most, shape (trunnion, 2 x sample), and its mean, smallest
    # and largest value in every revolution, shape (trunnion, cycle, 3); rad, None without needles
    skew: FloatArray | None
    skew_summary: FloatArray | None
    penetration: float  # the largest of any contact, without the initial transient
    # energy that the balance misses over what friction dissipates, or over a thousandth of the transmitted energy
    energy_residual: float
    rates: Rates | None = None  # what limits the step in the last third of a revolution; None unless requested
    vibration: VibrationReadings | None = None  # self-excited vibration of the joint; None if not requested
    contacts: Mapping[str, FloatArray] = field(default_factory=dict)  # requested outputs of contacts, by name


@dataclass(frozen=True)
class JointRun:
    """Outcome, results and counted work of a run."""

    # outcome, detail: how it ended, and the reason for a failure or a note
    outcome: Outcome
    detail: str
    readings: Readings | None = None  # its results, whatever its outcome; None if it stopped before its end
    setting: float = math.nan  # tolerance or step of its results; NaN without a run
    settled: bool = False  # whether the run chose it by itself
    # steps, force_evaluations, solves: counted work of all passes, error estimate included
    steps: int = 0
    force_evaluations: int = 0
    solves: int = 0
    followed: float = 0.0  # time of the motion, up to its end or the failure
