"""The load zone of a bearing against needles that are counted one by one."""

from __future__ import annotations

import numpy as np
import pytest
from needle_sums import loads

from tripod_doe.joint.derived_constants import load_zone


@pytest.mark.parametrize("clearance", [0.0, 0.002, 0.015])
def test_load_zone_agrees_with_the_sum_over_needles(clearance):
    """Exact physics, needles counted one by one and averaged over their position; 2 % is their ripple."""
    stiffness, count, load = 6.3e5, 27.0, 800.0  # of the types that joints pass: others compile anew
    kappa, penetration = load_zone.bearing_load_zone(load, clearance, stiffness, count)
    shift = clearance + 2 * penetration
    sums = np.mean(
        [loads(shift, clearance, stiffness, count, a) for a in np.linspace(0, 2 * np.pi / count, 50)], axis=0
    )
    assert sums[0] == pytest.approx(load, rel=2e-3)
    assert sums[1] / sums[0] == pytest.approx(kappa, rel=2e-3)


def test_load_zone_limits():
    """Published number: 4.08 F/Z is the largest needle load without clearance (handbooks; 4.085 for m = 10/9)."""
    stiffness = 6.3e5
    kappa, penetration = load_zone.bearing_load_zone(800.0, 0.0, stiffness, 27.0)
    assert stiffness * penetration ** (10 / 9) == pytest.approx(4.085 * 800 / 27, rel=1e-3)
    assert kappa == pytest.approx(1.258, abs=1e-3)
    assert load_zone.bearing_load_zone(800.0, 0.4, stiffness, 27.0)[0] == pytest.approx(1, abs=5e-3)
    preloaded, _ = load_zone.bearing_load_zone(800.0, -0.005, stiffness, 27.0)
    assert preloaded > 5
