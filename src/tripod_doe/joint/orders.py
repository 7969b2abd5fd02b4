"""Rotating orders of a periodic signal, exact for whole revolutions.

A signal is f(phi) = A_0 cos p_0 + sum_k A_k cos(k phi + p_k) with A_k >= 0 and -180 < p_k <= 180 deg; p_0 is 0 or 180.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import ComplexArray, FloatArray

ORDERS = np.arange(13)
"""The rotating orders that every model reports."""


def complex_amplitudes(signal: FloatArray) -> ComplexArray:
    """Complex amplitudes A_k exp(i p_k) of a signal over whole revolutions.

    Args:
        signal: Shape (..., samples of one revolution).

    Returns:
        ndarray, shape (..., order)
    """
    spectrum: ComplexArray = np.fft.rfft(signal)[..., : ORDERS.size] / signal.shape[-1]
    spectrum[..., 1:] *= 2
    return spectrum


def ahead(signal: FloatArray, angle: float) -> FloatArray:
    """A signal f(phi) over a whole revolution as f(phi + angle), exact for all orders that its samples resolve.

    Args:
        signal: Shape (..., samples of one revolution).
        angle: In rad.
    """
    count = signal.shape[-1]
    spectrum = np.fft.rfft(signal)
    turned: FloatArray = np.fft.irfft(spectrum * np.exp(1j * angle * np.arange(spectrum.shape[-1])), count)
    return turned


def amplitude_and_phase(complex_amplitude: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Amplitudes and phases in degrees, -180 < p <= 180, of complex amplitudes of any shape."""
    phase = np.degrees(np.angle(complex_amplitude))
    return np.abs(complex_amplitude), np.where(phase <= -180, 180.0, phase)


def rms(amplitude: FloatArray) -> FloatArray:
    """Effective value a order, A_k / sqrt 2, and A_0 itself; orders along the last axis (the paper's Fig. 14)."""
    return np.concatenate([amplitude[..., :1], amplitude[..., 1:] / np.sqrt(2)], axis=-1)
