"""Whether the joint would vibrate by itself: smooth motions that the method holds up, and the equations would not.

Friction that follows the slip feeds a vibration of rollers and spider of some hundred hertz, which contact damping and
friction across the slip take energy from. At low torque and low speed the feeding wins: at the reference joint below
about 10 N m at 300 rpm, 7 N m at 600 rpm, and at more where the grooves rub more (0.09: 22 N m at 700 rpm). Nothing
says how large the vibration grows but a run that does not damp it, over many revolutions (seen: growth of 1.2 to 40 a
revolution takes 0 to 12 % off the third order; 1.2 took 9 % after seven revolutions at one point and nothing in twenty
at another, and 1.09, which is not told, 5 % after ten).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.floquet import Growth, fastest_growth
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, Run, run

__all__ = ["vibration"]

_METHOD = "adaptive-euler"
"""The method whose motions are asked: it damps vibrations away. A method that damps little is on its way into them,
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


def vibration(values: Mapping[str, float], result: Run, samples: int, method: str, tolerance: float) -> str:
    """Say at which frequency a joint with lumped bearings would vibrate by itself, or nothing if it would not.

    Nothing is said of joints with needle bodies: they rattle in runs of any method, so that none has a smooth motion to
    ask. They were seen to vibrate at three of five points where lumped bearings do; rattling calms the others.

    Parameters
    ----------
    values
        Joint parameters in internal units.
    result
        A run of the joint.
    samples
        Its samples a revolution.
    method, tolerance
        What it was run with; a run of another method or a coarser tolerance than what is asked is not asked itself.
    """
    assembly = result.assembly
    if not assembly.tables.bearings.size:
        return ""
    if method != _METHOD or tolerance > _ASKS:
        samples = 8 * _FEW
        result = _smooth(assembly, values, samples, _ASKS)
    if not _vibrates(result, samples, _FEW, values):
        return ""
    growth = _vibrates(_smooth(assembly, values, 2 * _MANY, _DECIDES), 2 * _MANY, _MANY, values)
    if not growth:
        return ""
    return (
        f"the joint vibrates by itself at about {growth.frequency / (2 * math.pi):.0f} Hz, growing {growth.factor:.2g} "
        "times in a revolution, which this run damps away; raise torque, speed or contact damping, or use model "
        "kinetostatic for the motion without vibration"
    )


def _vibrates(result: Run, samples: int, count: int, values: Mapping[str, float]) -> Growth | None:
    """How departures grow, if that makes a vibration; nothing is known of a motion that did not come to its end."""
    if result.times.size <= 2 * samples:
        return None
    growth = _growth_in_a_revolution(result, samples, count)
    return growth if growth.factor > _GROWS and growth.frequency > _FAST * values["speed_rpm"] else None


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


def _smooth(assembly: Assembly, values: Mapping[str, float], samples: int, tolerance: float) -> Run:
    """Two revolutions of a smooth motion: the start has died out in the second one."""
    return run(
        assembly, _METHOD, 4 * math.pi / values["speed_rpm"], samples=2 * samples,
        settings=Settings(tolerance=tolerance), limits=Limits(windows=0),
    )  # fmt: skip
