"""The energy balance knows what loads did, however coarse the steps are (exact physics)."""

import numpy as np
import pytest
from example_scenes import dropped_ball, rolling_sphere

from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.checks.energy_balance import EnergyBalance
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import run
from tripod_doe.model_interface import Outcome


@pytest.mark.parametrize("method", [name for name in METHODS if name != "adaptive-euler"])  # which gives up on a bounce
def test_gravity_works_over_the_way_that_was_taken(method):
    """Weight times height lost, whatever the steps made of the bounce on that way; to the 1e-9 of the speed that implicit
    equations are solved to."""
    ball, duration, _ = dropped_ball()
    result = run(assemble(ball), method, duration, step=2e-3, samples=20, settings=Settings(tolerance=1e-2))
    fallen = result.positions[0, 1, 2] - result.positions[-1, 1, 2]
    assert result.followed == pytest.approx(duration)
    assert result.work[0] == pytest.approx(9.81 * fallen, abs=1e-8)


def test_a_ball_that_a_loose_tolerance_throws_too_low_is_found_out():
    """LSODA's ball came back a tenth too low and was called finished: its powers hid half of what its way shows."""
    ball, duration, _ = dropped_ball(0.07233, 35140000.0)
    result = run(assemble(ball), "scipy-lsoda", duration, samples=20, settings=Settings(tolerance=0.00472))
    error = abs((result.positions[-1, 1, 2] - 0.1) / 0.07233 - 1)
    assert error > 0.05
    assert result.outcome == Outcome.INACCURATE
    assert result.energy_residual == pytest.approx(error, rel=0.1)  # of a height that is energy


def test_a_power_that_breaks_off_within_a_step_is_no_lost_energy():
    """Friction stops where the ball starts to roll; in nine steps the trapezoids' sum misses some per cent there."""
    result = run(assemble(rolling_sphere(0.272, 1.5e-3)), "linearly-implicit-euler", 0.1, step=0.1 / 9, samples=3)
    assert result.outcome == Outcome.FINISHED, result.detail


def test_what_the_same_motion_misses_at_no_step_and_for_good():
    """0.2 and 0.1 are nothing at no step; 0.4 and 0.25 are 0.1 there; the 0.5 of both steps is back at the next sample."""
    times = np.array([1.0, 2.0, 3.0])
    coarse, fine = (EnergyBalance(2.0, times, np.array(missed)) for missed in ([0.2, 0.5, 0.4], [0.1, 0.5, 0.25]))
    assert coarse.refined(fine, 2.0).shares() == pytest.approx([0.0, 0.05, 0.05])
    assert coarse.worst() == pytest.approx(0.25)
