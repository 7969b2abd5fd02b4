"""A joint followed revolution by revolution: only the results of each revolution are kept, not its states.

The thrust is read at all steps, so that a vibration is not aliased to a low order. Waveforms are resampled without
frequencies above the sampling limit of the results, as behind the filter of a measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.joint.multibody.run_result import StoppedError, Wanted
from tripod_doe.joint.multibody.thrust_and_power import groove_readings, has_needle_bodies, needle_skews
from tripod_doe.joint.multibody.thrust_parts import thrust_parts
from tripod_doe.joint.orders import ORDERS, complex_amplitudes
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run
from tripod_doe.model_interface import Outcome

_RATE = 2e4
"""Least samples per second: contact damping keeps the contacts, which could vibrate faster, from doing so."""

_TAKING_OVER = 1 / 3
"""Part of a revolution for the change to other steps: one period of the motion, except for different skews."""

_BALANCED = 12
"""Samples of a revolution at which energies are balanced."""

_CORRECTION = 1e-6
"""Relative correction at which the iterations of an implicit step end: a tighter one changes no digit of a mean order
and costs 50 % more."""

_HALVED = 3
"""Most halvings of the tolerance or step if a revolution stops before its end."""

_OFTEN, _LEAST_STOPS = 2 / 3, 2
"""Share of stopped revolutions above which all are followed with half the step, and the least number of stops for that:
a revolution that stops half-way and is repeated with half the step costs two and a half."""


@dataclass(frozen=True)
class Revolution:
    """Results of one revolution, in internal units; waveforms at the samples of the run's results."""

    thrust: FloatArray  # at each groove, shape (groove, sample)
    thirds: ComplexArray  # complex orders of their sum, each third of the revolution by itself, shape (3, order)
    parts: FloatArray | None  # part of each mechanism, shape (part, sample); None unless requested
    power: FloatArray  # mean power lost to each mechanism, shape (mechanism,)
    unrests: FloatArray  # effective value of the thrust above the orders that are reported, in each third, shape (3,)
    # skew, skew_summary: see `needle_skews`; None without needles
    skew: FloatArray | None
    skew_summary: FloatArray | None
    # penetration, energy_residual: see `mechanics.run.Run`
    penetration: float
    energy_residual: float

    @property
    def orders(self) -> ComplexArray:
        """Complex orders of the thrust, shape (order,)."""
        orders: ComplexArray = self.thirds.mean(0)
        return orders

    @property
    def unrest(self) -> float:
        """Effective value of the thrust above the orders that are reported."""
        return float(np.sqrt((self.unrests**2).mean()))


@dataclass
class RevolvingJoint:
    """A joint that is followed revolution by revolution."""

    # assembly, values: the joint and its operating point
    assembly: Assembly
    values: JointValues[float]
    method: Method  # how it is followed
    wanted: Wanted  # results to read off each revolution
    limits: Limits  # what a revolution may show
    budget: int  # force evaluations that are left
    state: State | None = None  # its present state; None at its start
    last_revolution: Run | None = None  # the last revolution that was followed
    halved: int = 0  # number of halvings of tolerance or step from the start of each revolution
    # turns, stops: revolutions, or parts, begun with this number of halvings, and those of them that stopped
    turns: int = 0
    stops: int = 0
    # steps, force_evaluations, solves: counted work
    steps: int = 0
    force_evaluations: int = 0
    solves: int = 0

    @property
    def has_needles(self) -> bool:
        """Whether needles are bodies."""
        return has_needle_bodies(self.assembly)

    @property
    def evaluations_per_revolution(self) -> float:
        """Force evaluations of a revolution like the last one; 0 before the first."""
        if self.last_revolution is None:
            return 0.0
        share = float(self.last_revolution.times[-1] - self.last_revolution.times[0]) / self._duration
        return self.last_revolution.force_evaluations / share

    @property
    def affordable(self) -> float:
        """Number of revolutions like the last one that the budget still allows."""
        each = self.evaluations_per_revolution
        return self.budget / each if each else math.inf

    def follow(self, count: int, setting: float) -> list[Revolution]:
        """Follow a number of revolutions with a tolerance or step.

        Raises:
            StoppedError: See `advance`.
        """
        return [self._read(self.advance(setting, self._duration)) for _ in range(count)]

    def change_to(self, setting: float) -> None:
        """Go back by a part of the last revolution, and follow it again with another tolerance or step.

        Raises:
            StoppedError: See `advance`.
        """
        if self.last_revolution is None:
            return
        times, end = self.last_revolution.times, float(self.last_revolution.times[-1])
        back = int(np.searchsorted(times, end - self._duration * _TAKING_OVER))
        self.state = State(
            float(times[back]), self.last_revolution.positions[back], self.last_revolution.velocities[back]
        )
        self.advance(setting, end - self.state.time)

    def advance(self, setting: float, duration: float) -> Run:
        """Go on for some time, with a tolerance or step.

        A run that stops on its way is repeated with half of it, a few times: rattling needles may need shorter steps
        than a vibration. Where most runs stop, all later ones start with half.

        Raises:
            StoppedError: If it stops on its way all the same, or the budget is used up.
        """
        self.turns, halved = self.turns + 1, self.halved
        while True:
            try:
                return self._tried(setting / 2**halved, duration)
            except StoppedError as stop:
                if stop.stopped.outcome == Outcome.EVALUATION_LIMIT or halved == _HALVED:
                    raise
                self._count_stop(halved)
                halved += 1

    def _count_stop(self, halved: int) -> None:
        """Count a stop after a number of halvings, and halve the setting of all further revolutions if most stop."""
        if halved == self.halved:
            self.stops += 1
            if self.stops >= _LEAST_STOPS and self.stops > _OFTEN * self.turns:
                self.halved, self.turns, self.stops = halved + 1, 1, 0

    def _tried(self, setting: float, duration: float) -> Run:
        controlled = self.method.controlled
        settings = Settings(budget=max(self.budget, 1), correction=_CORRECTION)
        result = run(
            self.assembly,
            self.method.name,
            duration,
            step=None if controlled else setting,
            samples=_BALANCED,
            start=self.state,
            limits=self.limits,
            every_step=True,
            settings=settings._replace(tolerance=setting) if controlled else settings,
        )
        self.steps, self.solves = self.steps + result.steps, self.solves + result.solves
        self.force_evaluations += result.force_evaluations
        self.budget -= result.force_evaluations
        self.last_revolution = result
        if result.outcome != Outcome.FINISHED:
            raise StoppedError(result)
        self.state = State(float(result.times[-1]), result.positions[-1].copy(), result.velocities[-1].copy())
        return result

    @property
    def _duration(self) -> float:
        return 2 * math.pi / self.values.speed

    def _read(self, result: Run) -> Revolution:
        """Read a revolution at its steps, and at equal distances between them.

        Steps resolve the vibration, so that a cubic through what is read at them is as good as they are.
        """
        rate = max(_RATE, result.steps / self._duration)
        samples = math.lcm(3, self.wanted.samples)
        angles = np.arange(samples * math.ceil(rate * self._duration / samples))
        times = result.times[0] + self._duration * angles / angles.size
        states = (result.times, result.positions, result.velocities)

        def at_equal_distances(signals: FloatArray) -> FloatArray:
            read: FloatArray = CubicSpline(result.times, signals, axis=-1)(times)
            return read

        thrust, power = map(at_equal_distances, groove_readings(self.assembly, *states[1:]))
        total, skew, summary = thrust.sum(0), None, None
        if self.has_needles:
            nearest = np.searchsorted(result.times, times[:: angles.size // self.wanted.samples])
            skew, summary = needle_skews(self.assembly, result.positions[nearest], self.values, 1)
        parts = (
            at_equal_distances(thrust_parts(self.assembly, *states, self.values).sum(1)) if self.wanted.split else None
        )
        return Revolution(
            _filtered(thrust, self.wanted.samples),
            _orders_of_thirds(total),
            None if parts is None else _filtered(parts, self.wanted.samples),
            power.mean(1),
            _unrests(total, 3),
            skew,
            summary,
            result.penetration,
            result.energy_residual,
        )


def _filtered(signal: FloatArray, samples: int) -> FloatArray:
    """A periodic signal at fewer samples along its last axis, without the frequencies that these cannot show.

    `scipy.signal.resample` would give the same, and imports half of scipy.
    """
    waves = np.fft.rfft(signal)[..., : samples // 2 + 1]
    if samples % 2 == 0 and samples < signal.shape[-1]:  # the highest frequency gets the contributions from both sides
        waves[..., -1] *= 2
    filtered: FloatArray = np.fft.irfft(waves, samples) * (samples / signal.shape[-1])
    return filtered


def unrest(thrust: FloatArray) -> float:
    """Effective value of a thrust above the orders that are reported, from its samples over one revolution."""
    return float(_unrests(thrust, 1)[0])


def _unrests(thrust: FloatArray, parts: int) -> FloatArray:
    """The same in equal parts of the revolution, shape (part,)."""
    reported = np.fft.irfft(np.fft.rfft(thrust)[: ORDERS.size], thrust.size)
    values: FloatArray = np.sqrt(((thrust - reported) ** 2).reshape(parts, -1).mean(1))
    return values


def _orders_of_thirds(thrust: FloatArray) -> ComplexArray:
    """Complex orders of a thrust over one revolution, for each third; their mean is the order of the revolution."""
    thirds = np.zeros((3, 3, thrust.size // 3))
    thirds[range(3), range(3)] = 3 * thrust.reshape(3, -1)
    return complex_amplitudes(thirds.reshape(3, -1))
