"""Outputs that follow from the thrust at the grooves."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.joint.outputs import thrust_outputs


def test_orders_are_of_all_revolutions_and_waveforms_of_the_last_two():
    """Exact: five revolutions of one groove whose third orders are 1 to 5 N."""
    phi = 2 * np.pi * np.arange(60) / 60
    thrust = np.array([[size * np.cos(3 * phi)] for size in range(1, 6)])[None]
    found = thrust_outputs(thrust, ["thrust", "thrust_amplitude", "thrust_amplitude_scatter"])
    assert found["thrust_amplitude"][0, 3] == pytest.approx(3)
    assert found["thrust_amplitude_scatter"][0, 3] == pytest.approx(1)
    assert found["thrust"][0] == pytest.approx(thrust[0, -2:].ravel())
