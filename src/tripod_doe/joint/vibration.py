"""Self-excited vibration: whether the joint would vibrate where the method of a run damps it.

Friction that depends on the slip excites a vibration of rollers and spider at some hundred hertz; contact damping, and
friction across the slip, damp it. At low torque and low speed the excitation is stronger: at the reference joint below
about 10 N m at 300 rpm and 7 N m at 600 rpm, and up to a higher torque with more groove friction (0.09: 22 N m at 700
rpm). How large the vibration becomes is known only from a run that does not damp it: a growth by 1.2 to 40 per
revolution reduces the third order by 0 to 12 %. The result holds for as many revolutions as the run follows; slow
growth may show later (1.09 per revolution, which is not reported, reduced it by 5 % after ten).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tripod_doe.joint.multibody_scene import build_joint
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.readings import groove_thrust
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.floquet import Growth, fastest_growth
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run

__all__ = ["Vibration", "vibration"]

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

_UNDAMPED, _STEP = "generalized-alpha", 3e-5
"""What leaves vibrations alone: a third of the step changes the third order that they leave by 0.3 % (by 4 % at the
joint that vibrates most, where it changes as much from one revolution to the next)."""

_LEAST = 2e-3
"""Share of |T| / R_p: a smaller third order, as a straight joint has, counts as one of this size."""

_ADVICE = "raise torque, speed or contact damping, or use model kinetostatic for the motion without vibration"


@dataclass(frozen=True)
class Vibration:
    """A vibration that a run damps away.

    Attributes
    ----------
    invalidates
        Whether it reduces the third order so much that the run is wrong.
    note
        Frequency, growth and loss, in words.
    """

    invalidates: bool
    note: str


def vibration(
    values: JointValues[float], limit: float, result: Run, samples: int, method: str, tolerance: float
) -> Vibration | None:
    """Estimate how much a vibration would reduce the third order of a run; None where nothing vibrates.

    Departures from a smooth motion of the joint are tested for growth; where they grow, the same revolutions are run
    without damping. The growth alone does not show the loss: 1.5 per revolution was seen to cost 11 %, 1e10 (at 3 kHz)
    half a percent. Needles rattle with any method, so that they have no smooth motion whose departures could be
    followed, and undamped runs of needles cost thirty times as much: they are tested with lumped bearings. Of 20
    points that were also run undamped with needles, lumped bearings predicted a loss above 5 % wrongly at one.

    Parameters
    ----------
    values
        The operating point.
    limit
        Largest loss, as a share of the third order, with which a run is right.
    result, samples, method, tolerance
        The run, its samples per revolution, and its numerics.
    """
    assembly = result.assembly
    lumped = bool(assembly.tables.bearings.size)
    if not (lumped and method == _METHOD and tolerance <= _ASKS):
        assembly, samples = assembly if lumped else assemble(build_joint(values, needles=False)), 8 * _FEW
        result = _smooth(assembly, values, samples, _ASKS)
    if not _vibrates(result, samples, _FEW, values):
        return None
    many = 2 * _MANY
    smooth = _smooth(assembly, values, many, _DECIDES)
    if not (growth := _vibrates(smooth, many, _MANY, values)):
        return None
    free = _undamped(assembly, values, many)
    if free.times.size <= int(values.cycles) * many:  # it stopped on its way
        return None
    third = _third_order(smooth, many, 1)
    least = _LEAST * abs(values.torque) / values.pitch_radius
    lost = (third - _third_order(free, many, 2)) / max(third, least)
    percent = round(100 * lost, 1) + 0.0  # no negative zero
    note = f"{_described(growth)}; without damping, lumped bearings have a third order lower by {percent:g} %"
    return Vibration(True, f"{note}; {_ADVICE}") if abs(lost) > limit else Vibration(False, note)


def _described(growth: Growth) -> str:
    return (
        f"self-excited vibration at about {growth.frequency / (2 * math.pi):.0f} Hz, growing by a factor of "
        f"{growth.factor:.2g} per revolution, which this run damps"
    )


def _third_order(result: Run, samples: int, revolutions: int) -> float:
    """Third order of the thrust in the last revolutions."""
    last = slice(-revolutions * samples, None)
    thrust = groove_thrust(result.assembly, result.positions[last], result.velocities[last]).sum(0)
    return float(np.abs(complex_amplitudes(thrust.reshape(revolutions, samples)).mean(0))[3])


def _vibrates(result: Run, samples: int, count: int, values: JointValues[float]) -> Growth | None:
    """How departures grow, if that makes a vibration; nothing is known of a motion that did not come to its end."""
    if result.times.size <= 2 * samples:
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


def _undamped(assembly: Assembly, values: JointValues[float], samples: int) -> Run:
    """As many revolutions as a run follows, without damping."""
    cycles = int(values.cycles)
    return run(
        assembly, _UNDAMPED, cycles * 2 * math.pi / values.speed, step=_STEP, samples=cycles * samples,
        limits=Limits(windows=0),
    )  # fmt: skip
