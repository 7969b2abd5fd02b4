"""Runs against themselves in half the steps: coarse runs are found out, and right ones are left alone."""

import numpy as np
import pytest
from example_scenes import rolling_sphere

from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import run
from tripod_doe.mechanics.scenes.needle_between_plates import simulator
from tripod_doe.model_interface import Outcome


def needle(method, setting, **values):
    """A run of the needle between plates and its drift."""
    numbers = {k: float(v) for k, v in simulator.effective(values).items() if isinstance(v, int | float)}
    controlled = METHODS[method].controlled
    settings = Settings(tolerance=setting if controlled else 1e-6)
    result = simulator.run(numbers, method, None if controlled else setting, settings)
    return result, result.positions[-1, 1, 1]


def thrown(method, setting, friction, transition):
    """A ball that slides, then rolls, by a step or a tolerance."""
    settings = Settings(tolerance=setting if METHODS[method].controlled else 1e-6)
    return run(assemble(rolling_sphere(friction, transition)), method, 0.4, step=setting, samples=20, settings=settings)


def test_a_run_of_few_steps_is_run_again_whole():
    """Four windows of one step each saw a quarter of what a hundred steps get wrong: it settles between them."""
    values = {
        "friction_a": 0.0453,
        "friction_b": 0.05162,
        "plate_speed_mm_s": 46.64,
        "skew_deg": 1.246,
        "load_n": 34.99,
        "duration_s": 0.02,
    }
    result, drift = needle("linearly-implicit-euler", 3.68e-4, **values)
    _, truth = needle("rosenbrock", 1e-7, **values)
    assert abs(drift / truth - 1) > 0.05
    assert result.outcome == Outcome.INACCURATE
    assert "half the step changes the motion" in result.detail


@pytest.mark.parametrize(
    ("method", "setting", "friction", "transition"),
    [
        ("scipy-lsoda", 0.0227, 0.3095, 0.0003837),
        ("symplectic-euler", 0.000178, 0.1598, 0.000175),
        ("bdf2", 0.00345, 0.3659, 0.002145),
    ],
)
def test_what_is_left_of_a_slip_that_is_over_is_no_failure(method, setting, friction, transition):
    """The ball rolls; a rest of slip reverses or goes to zero, over next to nothing of the slip path 1/7 v^2/(mu g)."""
    result = thrown(method, setting, friction, transition)
    truth = thrown("rosenbrock", 1e-9, friction, transition)
    apart = np.abs(result.positions[-1, 1, 0] - truth.positions[-1, 1, 0])
    assert apart < 0.01 / (7 * friction * 9.81)
    assert result.outcome == Outcome.FINISHED, result.detail


@pytest.mark.slow
def test_a_tolerance_near_what_a_solver_can_do_is_held_against_a_looser_one():
    """SciPy's BDF fails at a tenth of this tolerance; at ten times it the drift is the same."""
    values = {
        "friction_a": 0.0921,
        "friction_b": 0.01744,
        "plate_speed_mm_s": 414.8,
        "skew_deg": -0.638,
        "load_n": 411.2,
        "duration_s": 0.01,
        "contact_damping_s_per_mm": 0.001,  # what SciPy can do depends on the damping
    }
    result, _ = needle("scipy-bdf", 2.21e-7, **values)
    assert result.outcome == Outcome.FINISHED, result.detail


def test_a_long_run_is_checked_by_windows():
    few, many = (run(assemble(rolling_sphere()), "bdf2", 0.4, step=step) for step in (0.4 / 500, 0.4 / 501))
    assert few.check_evaluations > few.force_evaluations
    assert 0 < many.check_evaluations < 0.2 * many.force_evaluations
