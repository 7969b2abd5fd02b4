"""A joint followed in passes: all revolutions in coarse steps, and the sampled ones again in finer steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.joint.multibody.numerical_error import LEAD
from tripod_doe.joint.multibody.run_result import StoppedError
from tripod_doe.joint.multibody.thrust_and_power import groove_thrust, has_needle_bodies
from tripod_doe.joint.orders import ahead, complex_amplitudes
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run
from tripod_doe.model_interface import Outcome

_BALANCED = 12
"""Pauses in a revolution at which energies are balanced, where samples need none."""

_ON_TIME = 1e-6
"""Largest distance of a step from the sample that it stands for, over the time between samples."""

_BEGUN_ANEW = 3
"""Most restarts of the first pass, each with half the step, if it stops before its end."""


@dataclass(frozen=True)
class Motion:
    """The result of following a joint in passes."""

    # all revolutions, up to where the run stopped; the sampled ones at the end are those of the finest pass
    result: Run
    sampled: int  # number of sampled revolutions; 0 if the run stopped before its end
    # setting, lag: tolerance or step of the finest pass, and the rotation angle in rad by which its thrust is late
    setting: float
    lag: float
    error: FloatArray  # numerical error of every order, shape (order,)
    missed: str  # in words, the excess of the error over the allowed one and a remedy; empty if there is no excess
    runs: tuple[Run, ...]  # all runs, for the work that they took
    swings: bool = False  # whether a transient remains
    repeats: bool = True  # whether its revolutions are alike, so that its error is due to its steps
    extrapolation: Extrapolation | None = None  # to steps of zero; None if it is not extrapolated


@dataclass(frozen=True)
class Pass:
    """The sampled revolutions, followed with one setting."""

    setting: float  # tolerance or step
    parts: tuple[Run, ...]  # runs, each of which continues the one before it
    before: int  # samples of the first part before the sampled revolutions
    orders: ComplexArray  # complex orders of the thrust, shape (revolution, order)

    @property
    def evaluations_per_sample(self) -> float:
        """Force evaluations from one sample to the next."""
        return sum(part.force_evaluations for part in self.parts) / sum(part.times.size - 1 for part in self.parts)


@dataclass(frozen=True)
class Extrapolation:
    """The runs from which the signals of a motion that repeats are extrapolated to steps of zero."""

    # first, first_lag: run of the first pass, which ends in two sampled revolutions, and by which angle it is late
    first: Run
    first_lag: float
    # coarse, coarse_lag: the same of the pass before the finest one
    coarse: Run
    coarse_lag: float
    weight: float  # what the finest pass is still off, over its difference to the one before

    @classmethod
    def of(cls, joint: FollowedJoint, first: Pass, coarse: Pass, finest: Pass) -> Extrapolation:
        """Extrapolate from passes of a single part each."""
        lags = joint.lag(first.setting), joint.lag(coarse.setting)
        weight = 1 / (coarse.setting / finest.setting - 1)
        return cls(first.parts[0], lags[0], coarse.parts[0], lags[1], weight)


@dataclass
class FollowedJoint:
    """A joint, how it is followed, and all runs of it so far."""

    # assembly, values, method: the joint, its operating point, and the method
    assembly: Assembly
    values: JointValues[float]
    method: Method
    samples: int  # samples per revolution
    limits: Limits  # what one revolution may show
    runs: list[Run] = field(default_factory=list)  # all runs, for the work that they took

    @property
    def left(self) -> int:
        """Force evaluations that the budget leaves."""
        return int(self.values.evaluation_budget) - sum(part.force_evaluations for part in self.runs)

    @property
    def remembers(self) -> bool:
        """Whether needles are bodies: their skew depends on all steps before."""
        return has_needle_bodies(self.assembly)

    @property
    def extrapolates(self) -> bool:
        """Whether its signals are off in proportion to the steps; needles knock at other times in other steps."""
        return self.method.name == "adaptive-euler" and not self.remembers

    @property
    def _time_of_sample(self) -> float:
        return 2 * math.pi / self.values.speed / self.samples

    def settled(self, setting: float) -> float:
        """The tolerance or step as it acts: the time between samples is divided into equal steps."""
        if self.method.name == "adaptive-euler":
            whole = math.pi / self.samples  # tolerance whose step is the time between samples
        elif self.method.controlled:
            return setting
        else:
            whole = self._time_of_sample
        return whole / max(math.ceil(whole / setting - 1e-6), 1)

    def lag(self, setting: float) -> float:
        """Rotation angle by which the thrust is late, in rad: half a step of implicit Euler.

        Its velocity is the mean over a step and so belongs to the step's middle, its positions to the end; friction
        follows the velocity. With the thrust taken at the middle, the third order of the reference joint is off by 0.3
        % in place of 1.2 % with a tolerance of 4.4e-3 (`rollers`). Other methods are of second order.
        """
        if self.method.name == "adaptive-euler":
            return self.settled(setting)
        return 0.5 * self.values.speed * self.settled(setting) if self.method.name == "implicit-euler" else 0.0

    def first(self, setting: float) -> Pass:
        """Follow all revolutions from the start of the scene; the last two are sampled.

        Raises:
            StoppedError: If it stops on its way, also in finer steps.
        """
        cycles = int(self.values.cycles)
        for attempt in range(_BEGUN_ANEW + 1):
            try:
                whole = self._follow(setting, cycles * self.samples, None)
                break
            except StoppedError as error:
                if attempt == _BEGUN_ANEW or error.stopped.outcome == Outcome.EVALUATION_LIMIT:
                    raise
                setting = self.settled(setting / 2)
        return self._pass(setting, (whole,), (cycles - 2) * self.samples)

    def again(self, coarse: Pass, setting: float, revolutions: int) -> Pass:
        """Follow the last revolutions of another pass in other steps, from its state a little before them.

        Needles are followed from the start again: their skew depends on all previous steps (with steps of 0.5 deg in
        the dropped revolutions the second order of the reference joint is 12 % too small).
        """
        before = coarse.before + (len(coarse.orders) - revolutions) * self.samples
        lead = before if self.remembers else min(self.samples // LEAD, before)
        start = _state(coarse.parts[0], before - lead)
        length = lead + revolutions * self.samples
        return self._pass(setting, (self._follow(setting, length, start),), lead)

    def longer(self, one: Pass, revolutions: int) -> Pass:
        """Continue a pass up to a number of sampled revolutions."""
        more = (revolutions - len(one.orders)) * self.samples
        part = self._follow(one.setting, more, _state(one.parts[-1], -1))
        return self._pass(one.setting, (*one.parts, part), one.before)

    def last(self, one: Pass, revolutions: int) -> Pass:
        """The same pass with the last revolutions sampled only."""
        whole = _joined([(part, slice(1 if at else 0, None)) for at, part in enumerate(one.parts)])
        return Pass(one.setting, (whole,), whole.times.size - 1 - revolutions * self.samples, one.orders[-revolutions:])

    def motion(self, first: Pass, finest: Pass) -> Run:
        """All revolutions as one run: the sampled ones are those of the finest pass."""
        before = first.before + max(len(first.orders) - len(finest.orders), 0) * self.samples
        pieces = [(first.parts[0], slice(0, before - finest.before)), (finest.parts[0], slice(None))]
        pieces += [(part, slice(1, None)) for part in finest.parts[1:]]
        return replace(
            _joined(pieces),
            energy_residual=max((part.energy_residual for part in finest.parts), key=abs),
            outcome=(worst := _worst(finest.parts)).outcome,
            detail=worst.detail,
        )

    def _follow(self, setting: float, samples: int, start: State | None) -> Run:
        """Follow a number of samples, from the start of the scene or from a state."""
        result = self._run(setting, samples, start, stops=self._few_stops(samples))
        if result.times.size != samples + 1:
            result = self._run(setting, samples, start, stops=samples)
        self.runs.append(result)
        if result.times.size <= samples:
            raise StoppedError(result)
        return result

    def _few_stops(self, samples: int) -> int:
        """Pauses of a run at which energies are balanced: few, if samples are among its equal steps anyway.

        Each pause costs as much as a step of `rollers`. The steps of `needles` are too large to be kept.
        """
        if self.remembers or self.method.name != "adaptive-euler":
            return samples
        return samples // math.gcd(samples, max(self.samples // _BALANCED, 1))

    def _run(self, setting: float, samples: int, start: State | None, stops: int) -> Run:
        """Follow a number of samples with some pauses; all steps are returned unless samples are among them."""
        controlled, settings = self.method.controlled, Settings(budget=max(self.left, 1))
        result = run(
            self.assembly,
            self.method.name,
            samples * self._time_of_sample,
            step=None if controlled else setting,
            samples=stops,
            settings=settings._replace(tolerance=setting) if controlled else settings,
            start=start,
            limits=replace(self.limits, turned_over=self.limits.turned_over * samples / self.samples),
            every_step=stops < samples,
        )
        each, rest = divmod(result.times.size - 1, samples)
        if rest or not each:
            return result
        times, wanted = result.times[::each], result.times[0] + self._time_of_sample * np.arange(samples + 1)
        if np.abs(times - wanted).max() > _ON_TIME * self._time_of_sample:
            return result
        # what reads them would compile once more for a view
        positions, velocities = (np.ascontiguousarray(all_[::each]) for all_ in (result.positions, result.velocities))
        return replace(result, times=times, positions=positions, velocities=velocities)

    def _pass(self, setting: float, parts: tuple[Run, ...], before: int) -> Pass:
        orders = [self._orders(part, slice(before if part is parts[0] else 0, -1), setting) for part in parts]
        return Pass(setting, parts, before, np.concatenate(orders))

    def _orders(self, part: Run, states: slice, setting: float) -> ComplexArray:
        thrust = groove_thrust(self.assembly, part.positions[states], part.velocities[states]).sum(0)
        return complex_amplitudes(ahead(thrust.reshape(-1, self.samples), self.lag(setting)))


def _state(result: Run, sample: int) -> State:
    return State(float(result.times[sample]), result.positions[sample], result.velocities[sample])


def _worst(parts: Sequence[Run]) -> Run:
    """The first part that failed, or the last one."""
    return next((part for part in parts if part.outcome != Outcome.FINISHED), parts[-1])


def _joined(pieces: Sequence[tuple[Run, slice]]) -> Run:
    """Join samples of several runs to one run, with the counted work of the last."""
    worst = _worst([part for part, _ in pieces])
    times, positions, velocities = (
        np.concatenate([getattr(part, name)[kept] for part, kept in pieces])
        for name in ("times", "positions", "velocities")
    )
    return replace(
        worst,
        times=times,
        positions=positions,
        velocities=velocities,
        penetration=max(part.penetration for part, _ in pieces),
        energy_residual=max((part.energy_residual for part, _ in pieces), key=abs),
    )
