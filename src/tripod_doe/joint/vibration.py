"""Self-excited vibration: whether a joint vibrates by itself, and with which damping it would not.

The friction laws rise with the slip, so that friction damps. What excites is that it turns normal forces into other
directions: it couples motions with nearby frequencies one way only, and one drives the other (mode coupling). Contact
damping acts against it, and friction across the slip. Parts of the rate at which a departure grows fastest, 1/s:

    joint, grooves' friction                    frequency    rate   groove sliding  needle sliding  contact damping
    7 deg, 76 N m, 1860 rpm, 0.015 (needles 0.14)  741 Hz      78               59             404              -31
    10 deg, 25 N m, 600 rpm, 0.1                   708 Hz      75              546             108              -14
    9 deg, 57 N m, 1170 rpm, 0.18                 2810 Hz    3150             3870            1019             -104

The rest is elastic. At some 700 Hz the output shaft turns against the contacts, in most of a revolution: twice to three
times the contact damping that is assumed here ends it. At some kHz a roller spins against the shaft, in parts of a
revolution, and faster than contact damping could take it there.

The method that runs use damps vibrations. So departures from the smooth motion that it gives are tested for growth.
The answer holds for small departures; how large they become, and what that makes of the thrust, is seen by following
the joint with a method that does not damp (`vibrating_run`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tripod_doe.joint.multibody_scene import build_joint
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.readings import groove_thrust
from tripod_doe.joint.revolutions import unrest
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.floquet import Growth, fastest_growth
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run

__all__ = ["Vibration", "damping_against", "growing_vibration"]

_METHOD = "adaptive-euler"
"""The method whose motion is tested: it damps vibrations. A method that damps little is on its way into them,
where departures grow otherwise, or by chance not at all (seen: 0.93 for 200, linearly implicit Euler at 7e-6 s)."""

_FEW, _MANY = 24, 144
"""States of a revolution at which departures are looked at: few ask, and where they see growth, many decide. Friction
damps most where a slip turns round, which few states hit or miss."""

_ASKS, _DECIDES = 4e-3, 1e-3
"""Tolerance of the motion that is asked, and of that which decides: the error of a coarser one may show growth that is
not there (seen: 1.4 for 1), and a finer one leaves the smooth motion where a small kick is enough for that."""

_GROWS = 1.1
"""Growth in a revolution above which a joint vibrates: what turns freely neither grows nor dies out, which differences
of states show as 0.93 to 1.07."""

_FAST = 12
"""Order above which a departure is a vibration: slower ones would be seen in the orders of the thrust."""

_STRONGER, _LEAST_DAMPING = (2.0, 4.0, 8.0, 16.0, 32.0), 1e-4
"""Factors of contact damping that are tried against a vibration, and the damping in s/mm that counts at least."""


@dataclass(frozen=True)
class Vibration:
    """A vibration that grows from the smooth motion of a joint.

    Attributes
    ----------
    growth
        How fast small departures grow.
    third
        Third order of the thrust in the smooth motion.
    unrest
        Effective value of the thrust above the orders that are reported, in the smooth motion.
    """

    growth: Growth
    third: float
    unrest: float

    @property
    def described(self) -> str:
        """Frequency and growth, in words."""
        factor = f"growing by a factor of {self.growth.factor:.2g} per revolution"
        return f"self-excited vibration at about {self.hertz:.0f} Hz, {factor}"

    @property
    def hertz(self) -> float:
        """Its frequency in Hz."""
        return self.growth.frequency / (2 * math.pi)


def growing_vibration(values: JointValues[float]) -> Vibration | None:
    """Find a vibration that grows from the smooth motion of a joint; None where all departures die out.

    Needles rattle, so that a joint with needle bodies has no smooth motion whose departures could be followed: joints
    are tested with lumped bearings.

    Parameters
    ----------
    values
        The operating point.
    """
    assembly = assemble(build_joint(values, needles=False))
    asked = _smooth(assembly, values, 8 * _FEW, _ASKS)
    if not (growth := _vibrates(asked, 8 * _FEW, _FEW, values)):
        return None
    decides = _smooth(assembly, values, 2 * _MANY, _DECIDES)
    if _came_to_its_end(decides, 2 * _MANY) and not (growth := _vibrates(decides, 2 * _MANY, _MANY, values)):
        return None
    last = slice(-8 * _FEW, None)
    thrust = groove_thrust(assembly, asked.positions[last], asked.velocities[last]).sum(0)
    return Vibration(growth, float(np.abs(complex_amplitudes(thrust))[3]), unrest(thrust))


def damping_against(values: JointValues[float]) -> float | None:
    """Contact damping in s/mm with which a joint that vibrates would not, among doublings of what it has.

    Parameters
    ----------
    values
        The operating point.

    Returns
    -------
    float or None
        None where the joint vibrates with all that are tried.
    """
    own = max(values.contact_damping, _LEAST_DAMPING)
    for factor in _STRONGER:
        damped = replace(values, contact_damping=factor * own)
        asked = _smooth(assemble(build_joint(damped, needles=False)), damped, 8 * _FEW, _ASKS)
        if _came_to_its_end(asked, 8 * _FEW) and not _vibrates(asked, 8 * _FEW, _FEW, damped):
            return factor * own
    return None


def _came_to_its_end(result: Run, samples: int) -> bool:
    return result.times.size > 2 * samples


def _vibrates(result: Run, samples: int, count: int, values: JointValues[float]) -> Growth | None:
    """How departures grow, if that makes a vibration; nothing is known of a motion that did not come to its end."""
    if not _came_to_its_end(result, samples):
        return None
    growth = _growth_in_a_revolution(result, samples, count)
    return growth if growth.factor > _GROWS and growth.frequency > _FAST * values.speed else None


def _growth_in_a_revolution(result: Run, samples: int, count: int) -> Growth:
    """How departures from the last revolution of a run grow in it, from so many states.

    Parameters
    ----------
    result
        A run of the joint.
    samples
        Its samples a revolution.
    count
        States that are looked at, at most all samples.
    """
    middles = ((np.arange(count) + 0.5) / count * samples).astype(int)
    states = [
        State(float(result.times[k]), result.positions[k], result.velocities[k])
        for k in np.unique(middles) - 1 - samples
    ]
    return fastest_growth(result.assembly, states, float(result.times[-1] - result.times[-1 - samples]))


def _smooth(assembly: Assembly, values: JointValues[float], samples: int, tolerance: float) -> Run:
    """Two revolutions of a smooth motion: the start has died out in the second one."""
    return run(
        assembly, _METHOD, 4 * math.pi / values.speed, samples=2 * samples,
        settings=Settings(tolerance=tolerance), limits=Limits(windows=0),
    )  # fmt: skip
