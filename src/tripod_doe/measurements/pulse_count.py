"""Number of pulses per revolution of a tachometer, if it is not given: from the speed, or from the force."""

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import option
from tripod_doe.measurements.spectrum import cycle_amplitudes, refined_peak
from tripod_doe.measurements.tachometer import Pulses, angle_between_pulses
from tripod_doe.quantities import number

_NEAR = 0.04  # relative: largest distance of a count from a whole number, and of a stated speed from the true speed
_CLEAR = 0.05  # least part of the strongest amplitude for another oscillation to count
_WHOLE = 0.15  # largest distance of a strong oscillation from a whole order


def infer_pulses(pulses: Pulses, time_s: FloatArray, thrust_n: FloatArray, speed_rpm: float | None) -> tuple[int, str]:
    """Pulses per revolution, and a sentence on the origin of the number; empty for a single pulse.

    With a known speed, the pulse rate gives the number: exactly for few pulses, and for many so that the strongest
    oscillation of the force is a whole order. Otherwise this oscillation counts as the third order, or as another
    order if only that explains the other oscillations.
    """
    flag = option("pulses_per_revolution")
    angle = angle_between_pulses(pulses, time_s, 1)
    cycles, amplitude = cycle_amplitudes(angle, thrust_n)
    strongest = refined_peak(angle, thrust_n, cycles, amplitude)
    if speed_rpm:
        exact = 60 * float(pulses.numbers[-1] / (pulses.times[-1] - pulses.times[0])) / speed_rpm
        count = max(round(exact), 1)
        if _NEAR * exact > 0.5 and strongest:  # the speed cannot distinguish neighbouring counts
            by_order = max(round(strongest * exact), 1) / strongest
            count = round(by_order) if abs(by_order / exact - 1) < _NEAR else count
        if abs(exact / count - 1) > _NEAR:
            return count, (
                f"Check the speed or the pulses: {number(speed_rpm)} rpm would be {number(exact)} pulses per "
                f"revolution; {count} are assumed ({flag})."
            )
        said = f"{count} pulses per revolution follow from the speed of {number(speed_rpm)} rpm ({flag})."
        return count, "" if count == 1 else said
    if strongest is None:
        return 1, ""
    count, order = _count_by_force(cycles, amplitude, strongest)
    return count, "" if count == 1 else (
        f"{count} pulses per revolution are assumed, so that the strongest oscillation of the force is its "
        f"{('first', 'second', 'third')[order - 1]} order ({flag})."
    )


def _count_by_force(cycles: FloatArray, amplitude: FloatArray, strongest: float) -> tuple[int, int]:
    """Pulses per revolution with which the strongest oscillation is the third order, else the second or first one.

    With this number all strong, resolved oscillations must be whole orders; otherwise the third order decides.

    Args:
        cycles, amplitude: Cycles per pulse, and amplitudes of the force.
        strongest: Cycles per pulse of the strongest oscillation.
    """
    wide = 2 * float(cycles[1] - cycles[0])
    peaks = cycles[amplitude > _CLEAR * amplitude.max()]
    choices = []
    for order in (3, 2, 1):
        count = max(round(order / strongest), 1)
        if abs(order / strongest / count - 1) > _NEAR:
            continue
        orders = peaks * count
        if np.all(np.abs(orders - np.rint(orders)) <= max(_WHOLE, wide * count)):
            if count == order == 3 and _has(cycles, amplitude, 3.0) and not _has(cycles, amplitude, 1 / 3):
                return 1, 1  # the ninth order would be strong, but only multiples of three occur
            return count, order
        choices.append((count, order))
    return choices[0] if choices else (1, 3)


def _has(cycles: FloatArray, amplitude: FloatArray, at: float) -> bool:
    """Whether the force oscillates at the given cycles per pulse."""
    near = np.abs(cycles - at) < max(_NEAR * at, 2 * float(cycles[1] - cycles[0]))
    return bool(amplitude[near].max(initial=0.0) > _CLEAR * amplitude.max())
