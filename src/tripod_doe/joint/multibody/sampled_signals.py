"""Signals of the sampled revolutions of a motion: thrust at the grooves, powers lost to friction, parts of the thrust.

Where a motion repeats, its signals are extrapolated to steps of zero. Steps of implicit Euler with one solve each leave
an error in proportion to the step, as long as they resolve the motion: the secant slope of friction leaves a share of
each change of velocity. (BDF2 with one solve a step is off by as much; solved to 1e-4, in steps of 2 deg, it is off
by 0.02 % of the third order at four joints, for five to six solves a step.) All signals are extrapolated alike: orders
are those of the waveform, and parts add up to the thrust.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.multibody.passes import Extrapolation, Motion
from tripod_doe.joint.multibody.run_result import Wanted
from tripod_doe.joint.multibody.thrust_and_power import groove_readings
from tripod_doe.joint.multibody.thrust_parts import thrust_parts
from tripod_doe.joint.orders import ORDERS, ahead
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.run import Run


class SampledSignals(NamedTuple):
    """Signals of revolutions, each of shape (revolution, signal, sample)."""

    groove_thrust: FloatArray  # axial force on the housing at each groove
    powers: FloatArray  # power lost to each mechanism, in the order of `parameters.MECHANISMS`
    parts: FloatArray | None  # part of each mechanism in the thrust; None unless requested


def sampled_signals(motion: Motion, values: JointValues[float], wanted: Wanted) -> SampledSignals:
    """Read the signals of a motion, extrapolated where it repeats."""
    signals = _read(motion.result, motion.sampled, motion.lag, values, wanted)
    if motion.extrapolation:
        steps = motion.extrapolation
        first = _read(steps.first, 2, steps.first_lag, values, wanted)
        same = steps.coarse is steps.first
        coarse = first[1:] if same else _read(steps.coarse, 1, steps.coarse_lag, values, wanted)
        signals = _extrapolated(steps, first, coarse, signals)
    thrust, powers, parts = np.split(signals, [_GROOVES, _GROOVES + _POWERS], axis=1)
    return SampledSignals(thrust, powers, parts if wanted.split else None)


_GROOVES, _POWERS = 3, 5
"""Signals of the thrust, one of each groove, and of the powers, one of each mechanism."""


def _read(result: Run, revolutions: int, lag: float, values: JointValues[float], wanted: Wanted) -> FloatArray:
    """Signals of the last revolutions of a run that is late by an angle, shape (revolution, signal, sample)."""
    times, positions, velocities = (
        x[-revolutions * wanted.samples - 1 :] for x in (result.times, result.positions, result.velocities)
    )
    signals = [*groove_readings(result.assembly, positions, velocities)]
    if wanted.split:
        signals.append(thrust_parts(result.assembly, times, positions, velocities, values).sum(1))
    last = slice(0, -1)  # the end of the last revolution is the start of the next one
    by_revolution = np.concatenate(signals)[:, last].reshape(-1, revolutions, wanted.samples)
    return ahead(np.moveaxis(by_revolution, 1, 0), lag)


def _extrapolated(steps: Extrapolation, first: FloatArray, coarse: FloatArray, finest: FloatArray) -> FloatArray:
    """Signals of the last two revolutions in steps of zero.

    The reported orders are extrapolated, and no higher frequencies, for which the steps are long. The revolution before
    the last one differs from it by as much as in the first pass.

    Args:
        first: Signals of two revolutions of the first pass, shape (2, signal, sample).
        coarse, finest: Signals of the last revolution of the last two passes, shape (1, signal, sample).
    """
    change = np.fft.rfft(finest - coarse)
    change[..., ORDERS.size :] = 0.0
    last = finest + steps.weight * np.fft.irfft(change, finest.shape[-1])
    return np.concatenate([last + first[:1] - first[1:], last])
