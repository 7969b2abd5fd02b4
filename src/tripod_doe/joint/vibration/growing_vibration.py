"""Onset of self-excited vibration: whether a joint vibrates by itself, and the damping that would prevent it.

The friction laws rise with the slip, so that friction damps. It excites by turning normal forces into other directions:
it couples motions with nearby frequencies in one direction only: one drives the other (mode coupling). Contact damping
acts against it, and friction across the slip. Parts of the largest growth rate of departures, 1/s:

    joint, grooves' friction                    frequency    rate   groove sliding  needle sliding  contact damping
    7 deg, 76 N m, 1860 rpm, 0.015 (needles 0.14)  741 Hz      78               59             404              -31
    10 deg, 25 N m, 600 rpm, 0.1                   708 Hz      75              546             108              -14
    9 deg, 57 N m, 1170 rpm, 0.18                 2810 Hz    3150             3870            1019             -104

The rest is elastic. Near 700 Hz the output shaft oscillates against the contacts, in most of a revolution: two to three
times the assumed contact damping suppresses it. At some kHz a roller spins against the shaft, in parts of a revolution,
and grows too fast for contact damping.

The usual method of runs damps vibrations and gives a smooth motion; departures from it are tested for growth. The
result holds for small departures; a run with a method of little damping (`vibrating_run`) gives their final size and
effect on the thrust.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.numerical_error import LEAD
from tripod_doe.joint.multibody.revolutions import unrest
from tripod_doe.joint.multibody.thrust_and_power import groove_thrust
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.contact_damping_parameters import FACTOR, TIME
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run
from tripod_doe.mechanics.stability.floquet import Growth, departure_matrices, fastest_growth, oscillating_rates
from tripod_doe.number_text import duration

_METHOD = "adaptive-euler"
"""The method whose motion is tested: it damps vibrations. A method of little damping leaves the smooth motion:
departures then grow differently, or by chance not at all (measured: 0.93 for 200, linearly implicit Euler at 7e-6
s)."""


class _Look(NamedTuple):
    """Sampling of a smooth motion: states per revolution, samples from one to the next, and the tolerance."""

    states: int
    between: int
    tolerance: float

    @property
    def samples(self) -> int:
        """Samples of a revolution."""
        return self.states * self.between


_SUSPECTS, _AT = _Look(24, 2, 4e-3), (5, 7, 9, 11)
"""For a first look: the samples of a motion from its start that are linearised, a sixth of a revolution."""
_DIES_OUT = -3.0
"""Logarithm of the growth in a revolution below which no vibration is expected: of 45 vibrating joints on record one is
below it (-8.3; its third order changes by 4 %), of calm ones five in six, and all ordinary ones (-4.8 at most)."""
_ASKS, _DECIDES = _Look(24, 6, 4e-3), _Look(144, 2, 1e-3)
"""Few states give a first result; if it shows growth, many states decide: friction damps most at slip reversals, which
few states hit or miss by chance. A motion as coarse as the first may show false growth (measured: 9 for 1); a motion
finer than the second leaves the smooth motion if a small kick can start the vibration."""

_GROWS = 1.1
"""Growth in a revolution above which a joint vibrates: free rotations neither grow nor decay; finite differences give
0.93 to 1.07 for them."""

_FAST = 12
"""Order above which a departure is a vibration: slower departures are visible in the orders of the thrust."""

_BUILT_UP = math.log(1e6)
"""Logarithm of the growth in a revolution above which a vibration is independent of its start."""

_STRONGER = (2.0, 4.0, 8.0, 16.0, 32.0)
"""Trial factors on contact damping to suppress a vibration."""

_LEAST_FACTOR, _LEAST_TIME = 1e-4, 1e-6
"""Least contact damping that is multiplied, in s/mm (dry) or s (greased)."""


@dataclass(frozen=True)
class Vibration:
    """A vibration that grows from the smooth motion of a joint."""

    growth: Growth  # how fast small departures grow
    third: float  # third order of the thrust in the smooth motion
    unrest: float  # effective value of the thrust above the orders that are reported, in the smooth motion
    revolution: tuple[State, ...] = ()  # states of the smooth motion at both ends of equal parts of a revolution

    @property
    def described(self) -> str:
        """Frequency and growth, in words."""
        if self.growth.rate <= 0:
            return "the motion does not repeat, though small departures from it die out"
        tenfold = duration(math.log(10) / self.growth.rate, 2)
        return f"self-excited vibration at about {self.hertz:.0f} Hz, growing tenfold in {tenfold}"

    @property
    def states(self) -> tuple[State, ...]:
        """Few of these states, at the middles of equal parts of the revolution."""
        return self.revolution[_ASKS.between // 2 :: _ASKS.between]

    @property
    def builds_up(self) -> bool:
        """Whether it builds up within a revolution."""
        return self.growth.climb >= _BUILT_UP

    @property
    def hertz(self) -> float:
        """Its frequency in Hz."""
        return self.growth.frequency / (2 * math.pi)


def growing_vibration(values: JointValues[float], assembly: Assembly | None = None) -> Vibration | None:
    """Find a vibration that grows from the smooth motion of a joint; None if all departures decay.

    Joints are tested with lumped bearings: needle bodies rattle and have no smooth motion.

    Args:
        assembly: The joint with lumped bearings, if already assembled.
    """
    assembly = assembly or assemble(build_joint(values, needles=False))
    if not _may_vibrate(assembly, values):
        return None
    asked = _smooth(assembly, values, _ASKS)
    if not (asked and (growth := _vibrates(departure_matrices(assembly, asked.middles), values))):
        return None
    decides = _smooth(assembly, values, _DECIDES, asked)
    if decides and not (growth := _vibrates(departure_matrices(assembly, decides.middles), values)):
        return None
    thrust = groove_thrust(assembly, asked.run.positions[asked.last], asked.run.velocities[asked.last]).sum(0)
    return Vibration(growth, float(np.abs(complex_amplitudes(thrust))[3]), unrest(thrust), asked.revolution)


def _may_vibrate(assembly: Assembly, values: JointValues[float]) -> bool:
    """Whether oscillations grow, on average over a sixth of a revolution, at rates as if the motion stood still.

    Vibrations are much faster than the revolution, so they grow by little else. Thirds are alike but for skews, and
    half a revolution on all that moves along the axis has changed sign: sixths differ by skews and the shaft's length,
    by up to 40 in the logarithm of their growth. So the limit lies well below none.
    """
    revolution = 2 * math.pi / values.speed
    smooth = run(
        assembly,
        _METHOD,
        revolution * _AT[-1] / _SUSPECTS.samples,
        samples=_AT[-1],
        settings=Settings(tolerance=_SUSPECTS.tolerance),
        limits=Limits(windows=0),
    )
    if smooth.times.size <= _AT[-1]:
        return True
    states = [_Smooth(smooth, _SUSPECTS).state(sample) for sample in _AT]
    rates = oscillating_rates(departure_matrices(assembly, states), _FAST * values.speed)
    return not revolution * rates.mean() <= _DIES_OUT


def damping_against(values: JointValues[float], states: Sequence[State]) -> str:
    """Contact damping that would suppress the vibration of a joint, among doublings of its value.

    A smooth motion is the same with any contact damping: contacts deform slowly. So one motion serves all values, and
    the matrices of departures are linear in contact damping, as the forces are.

    Args:
        states: Of its smooth motion (`Vibration.states`).

    Returns:
        Parameter and value; empty if the joint vibrates with all trial values.
    """
    dry = values.contact_damping > 0
    own = max(values.contact_damping, _LEAST_FACTOR) if dry else max(values.contact_damping_time, _LEAST_TIME)
    field, parameter = ("contact_damping", FACTOR) if dry else ("contact_damping_time", TIME)
    damped = (replace(values, **{field: factor * own}) for factor in (1, 2))
    once, twice = (departure_matrices(assemble(build_joint(given, needles=False)), states) for given in damped)
    for factor in _STRONGER:
        if not _vibrates(once + (factor - 1) * (twice - once), values):
            return f"{parameter} = {factor * own:.2g}"
    return ""


def _vibrates(departures: FloatArray, values: JointValues[float]) -> Growth | None:
    """Growth of departures in a revolution, if they become a vibration; else None."""
    growth = fastest_growth(departures, 2 * math.pi / values.speed)
    return growth if growth.factor > _GROWS and growth.frequency > _FAST * values.speed else None


@dataclass(frozen=True)
class _Smooth:
    """A smooth motion whose start has died out in its last revolution."""

    run: Run
    look: _Look

    @property
    def last(self) -> slice:
        """Its last revolution, without the start state."""
        return slice(-self.look.samples, None)

    @property
    def middles(self) -> tuple[State, ...]:
        """The states that are linearised, at the middles of equal parts of its last revolution."""
        return self.revolution[self.look.between // 2 :: self.look.between]

    @property
    def revolution(self) -> tuple[State, ...]:
        """All states of its last revolution, with that at its start."""
        return tuple(self.state(k) for k in range(-1 - self.look.samples, 0))

    def state(self, sample: int) -> State:
        """A sample, negative ones counted from the end."""
        return State(float(self.run.times[sample]), self.run.positions[sample], self.run.velocities[sample])

    def before(self, share: int) -> State:
        """The state at this part of a revolution before the end."""
        return self.state(-1 - self.look.samples - self.look.samples // share)


def _smooth(
    assembly: Assembly, values: JointValues[float], look: _Look, other: _Smooth | None = None
) -> _Smooth | None:
    """Follow a smooth motion: two revolutions from the start, or the last one of another and a little before it.

    Returns:
        None if the run stopped before its end.
    """
    before = look.samples // LEAD if other else look.samples
    smooth = run(
        assembly,
        _METHOD,
        2 * math.pi / values.speed * (1 + before / look.samples),
        samples=look.samples + before,
        start=other.before(LEAD) if other else None,
        settings=Settings(tolerance=look.tolerance),
        limits=Limits(windows=0),
    )
    return _Smooth(smooth, look) if smooth.times.size > look.samples + before else None
