"""Whether the joint would vibrate by itself: smooth motions that the method holds up, and the equations would not.

Friction that follows the slip feeds a vibration of rollers and spider of some hundred hertz, which contact damping and
friction across the slip take energy from. At low torque and low speed the feeding wins: at the reference joint below
about 10 N m at 300 rpm, 7 N m at 600 rpm, and at more where the grooves rub more (0.09: 22 N m at 700 rpm). Nothing
says how large the vibration grows but a run that does not damp it, over many revolutions (seen: growth of 1.2 to 40 a
revolution takes 0 to 12 % off the third order).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tripod_doe.joint.multibody import build_joint
from tripod_doe.mechanics.assembly import State, assemble
from tripod_doe.mechanics.floquet import Growth, fastest_growth
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run

__all__ = ["growth_in_a_revolution", "vibration"]

_FEW, _MANY = 24, 144
"""States of a revolution at which departures are looked at: few ask, and where they see growth, many decide. Friction
damps most where a slip turns round, which few states hit or miss."""

_GROWS = 1.1
"""Growth in a revolution above which a joint vibrates: what turns freely neither grows nor dies out, which differences
of states show as 0.93 to 1.07."""

_FAST = 12
"""Order above which a departure is a vibration: slower ones would be seen in the orders of the thrust."""

_SAMPLES = 2 * _MANY
_COARSE, _FINE = 4e-3, 1e-3
"""Tolerances of the motion with lumped bearings that is asked first, and of the one that decides: its own error may
show growth that is not there (seen: 1.4 at the first, 1.0 at the second)."""


def vibration(values: Mapping[str, float], result: Run, samples: int) -> str:
    """Say at which frequency the joint of a run would vibrate by itself, or nothing if it would not.

    Departures are looked at with lumped bearings: needles rattle in runs of any method. Joints with needle bodies were
    seen to vibrate and to stay calm where those with lumped bearings do, but for one at 5 N m that the needles calmed.
    Close to the border, vibrations may grow within a revolution and die out again in it; a smooth run is not refused.

    Parameters
    ----------
    values
        Joint parameters in internal units.
    result
        A run of the joint.
    samples
        Its samples a revolution.
    """
    if not result.assembly.tables.bearings.size:
        result, samples = _lumped(values, _COARSE), _SAMPLES
    if not _vibrates(result, samples, _FEW, values):
        return ""
    growth = _vibrates(_lumped(values, _FINE), _SAMPLES, _MANY, values)
    if not growth:
        return ""
    return (
        f"the joint vibrates by itself at about {growth.frequency / (2 * math.pi):.0f} Hz, growing {growth.factor:.2g} "
        "times in a revolution, which this run damps away; raise torque, speed or contact damping, or use model "
        "equilibrium for the motion without vibration"
    )


def _vibrates(result: Run, samples: int, count: int, values: Mapping[str, float]) -> Growth | None:
    """How departures grow, if that makes a vibration; nothing is known of a motion that did not come to its end."""
    if result.times.size <= 2 * samples:
        return None
    growth = growth_in_a_revolution(result, samples, count)
    return growth if growth.factor > _GROWS and growth.frequency > _FAST * values["speed_rpm"] else None


def growth_in_a_revolution(result: Run, samples: int, count: int) -> Growth:
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


def _lumped(values: Mapping[str, float], tolerance: float) -> Run:
    """Two revolutions with lumped bearings: the start has died out in the second one."""
    time = 4 * math.pi / values["speed_rpm"]
    return run(
        assemble(build_joint(values, needles=False)), "adaptive-euler", time, samples=2 * _SAMPLES,
        settings=Settings(tolerance=tolerance), limits=Limits(windows=0),
    )  # fmt: skip
