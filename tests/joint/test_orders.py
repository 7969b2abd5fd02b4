"""Rotating orders: exact for whole revolutions, by the contract's definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tripod_doe.joint.orders import ORDERS, ahead, amplitude_and_phase, complex_amplitudes, rms


@given(
    st.lists(st.floats(0.01, 100), min_size=13, max_size=13),
    st.lists(st.floats(-179.9, 180), min_size=13, max_size=13),
    st.sampled_from([30, 97, 360]),
)
def test_known_orders_come_back(amplitudes, phases, samples):
    """Exact: the definition evaluated, tolerance is rounding."""
    phases[0] = 180.0 if phases[0] < 0 else 0.0
    phi = 2 * np.pi * np.arange(samples) / samples
    signal = sum(a * np.cos(k * phi + np.radians(p)) for k, (a, p) in enumerate(zip(amplitudes, phases, strict=True)))
    amplitude, phase = amplitude_and_phase(complex_amplitudes(signal))
    assert amplitude == pytest.approx(amplitudes, rel=1e-9, abs=1e-9)
    turned = (phase - phases + 180) % 360 - 180
    assert np.abs(turned).max() < 1e-6
    assert (phase > -180).all()
    assert (phase <= 180).all()


@pytest.mark.parametrize("samples", [30, 97])
def test_a_signal_an_angle_ahead_is_its_definition_there(samples):
    """Exact: f(phi + angle) evaluated, for two revolutions at once."""
    phi, angle = 2 * np.pi * np.arange(samples) / samples, 0.013

    def signals(phi):
        return np.stack([1.5 + np.cos(3 * phi + 0.4), np.sin(12 * phi) - 2 * np.cos(phi)])

    assert ahead(signals(phi), angle) == pytest.approx(signals(phi + angle), abs=1e-12)


def test_effective_value_is_the_signals_own():
    """Invariance: the rms of a pure order is A / sqrt 2, of the mean its magnitude."""
    phi = 2 * np.pi * np.arange(360) / 360
    signal = 3.0 * np.cos(4 * phi + 1)
    amplitude, _ = amplitude_and_phase(complex_amplitudes(signal))
    assert rms(amplitude)[4] == pytest.approx(np.sqrt(np.mean(signal**2)))
    assert rms(np.ones(ORDERS.size))[0] == 1
