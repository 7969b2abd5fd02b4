"""Amplitude of a force at any number of cycles per revolution, also between whole orders."""

import numpy as np

from tripod_doe.array_types import FloatArray

FEWEST_CYCLES = 3  # cycles of an oscillation in the record; with fewer it may be drift

_MOST_SAMPLES = 2**18


def cycle_amplitudes(rotation_deg: FloatArray, thrust_n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cycles per revolution and amplitudes of a whole record (Hann window); empty for a short one.

    Args:
        rotation_deg: Rotation angle in deg, not falling, shape (sample,).
        thrust_n: Force in N, NaN at dropouts, shape (sample,).
    """
    there = np.isfinite(thrust_n)
    angle, force = rotation_deg[there], thrust_n[there]
    count = min(angle.size, _MOST_SAMPLES)
    if count < 2 * FEWEST_CYCLES or not angle[-1] > angle[0]:
        return np.array([]), np.array([])
    even = np.interp(np.linspace(angle[0], angle[-1], count), angle, force)
    window = np.hanning(count)
    amplitude = 2 * np.abs(np.fft.rfft((even - even.mean()) * window)) / window.sum()
    cycles = np.arange(amplitude.size) / ((angle[-1] - angle[0]) / 360)
    return cycles[FEWEST_CYCLES:], amplitude[FEWEST_CYCLES:]


def longest_stop(rotation_deg: FloatArray, force: FloatArray) -> tuple[float, float]:
    """The longest angle, deg, over which a force has one and the same value, and this value.

    Args:
        rotation_deg, force: Shape (sample,), NaN at dropouts.
    """
    there = np.flatnonzero(np.isfinite(force))
    values, angle = force[there], rotation_deg[there]
    starts = np.flatnonzero(np.append(True, np.diff(values) != 0))
    widths = angle[np.append(starts[1:], values.size) - 1] - angle[starts]
    at = int(np.argmax(widths))
    return float(widths[at]), float(values[starts[at]])


def refined_peak(
    rotation_deg: FloatArray, thrust_n: FloatArray, cycles: FloatArray, amplitude: FloatArray
) -> float | None:
    """Cycles per revolution of the strongest oscillation, interpolated between spectral lines; None if there is none.

    Args:
        rotation_deg, thrust_n: The record.
        cycles, amplitude: Its spectrum.
    """
    from scipy.optimize import minimize_scalar

    if not amplitude.size or not amplitude.max() > 0:
        return None
    there = np.isfinite(thrust_n)
    angle, force = rotation_deg[there] / 360, thrust_n[there] - np.mean(thrust_n[there])
    window = np.sin(np.pi * (angle - angle[0]) / (angle[-1] - angle[0])) ** 2
    weighed = force * window
    at, line = float(cycles[int(np.argmax(amplitude))]), float(cycles[1] - cycles[0])
    minimum = minimize_scalar(
        lambda cycle: -abs(np.sum(weighed * np.exp(-2j * np.pi * cycle * angle))),
        bounds=(at - line, at + line),
        method="bounded",
        options={"xatol": 1e-4 * line},
    )
    return float(minimum.x)
