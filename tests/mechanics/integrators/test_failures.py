"""Every method has a scene where it fails, and the run says so: what failed, when, and at which body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from example_scenes import dropped_ball, pendulum, rolling_sphere
from needle_ring import needle_ring

from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import run
from tripod_doe.mechanics.scenes.needle_between_plates import closed_form, simulator
from tripod_doe.mechanics.solve.elimination import multiply
from tripod_doe.mechanics.solve.equations_of_motion import linearise
from tripod_doe.mechanics.solve.newton import factorise_system, gather, solve_system
from tripod_doe.model_interface import Outcome


def numbers(**values):
    return {k: float(v) for k, v in simulator.effective(values).items() if isinstance(v, int | float)}


def needle(method, settings, step):
    """A skewed needle between plates: the run, and how far its drift is off the closed form."""
    values = numbers(duration_s=2e-3, contact_damping_s_per_mm=0.001)
    result = simulator.run(values, method, step, settings)
    return result, abs(result.positions[-1, 1, 1] / closed_form(values)[1] - 1)


def bounce(method, settings, step):
    """A ball that must come back to its height: the run, and how far it is off it."""
    ball, duration, _ = dropped_ball()
    result = run(assemble(ball), method, duration, step=step, samples=20, settings=settings)
    return result, abs((result.positions[-1, 1, 2] - 0.1) / 0.05 - 1)


def stiff_bounce(method, settings, step):
    """The same on a hundred times stiffer plane, which it touches for 2 ms."""
    ball, duration, _ = dropped_ball(stiffness=1e8)
    result = run(assemble(ball), method, duration, step=step, samples=20, settings=settings)
    return result, abs((result.positions[-1, 1, 2] - 0.1) / 0.05 - 1)


class Failure(NamedTuple):
    """A method on a scene, with the step or the tolerance that is too coarse."""

    method: str
    simulate: object
    setting: float


TOUCHING = dropped_ball()[2]

FAILURES = [
    # beyond 2 m v_st / (mu f_n): smooth, and wrong
    Failure("symplectic-euler", needle, 2e-7),
    Failure("rk4", needle, 2e-7),
    # a step longer than the contact
    *(
        Failure(method, bounce, 1.5 * TOUCHING)
        for method in (
            "symplectic-euler",
            "rk4",
            "linearly-implicit-euler",
            "implicit-euler",
            "bdf2",
            "generalized-alpha",
        )
    ),
    # a tolerance that lets a step jump over it
    Failure("adaptive-euler", bounce, 1e-2),
    Failure("rosenbrock", stiff_bounce, 1e-1),
    Failure("scipy-radau", stiff_bounce, 1e-1),
    Failure("scipy-bdf", bounce, 1e-2),
    Failure("scipy-lsoda", bounce, 1e-2),
    Failure("scipy-dop853", stiff_bounce, 1e-1),
]


def test_every_method_has_a_scene_where_it_fails():
    assert {failure.method for failure in FAILURES} == set(METHODS)


@pytest.mark.parametrize("failure", FAILURES, ids=lambda f: f"{f.method}-{f.simulate.__name__}")
def test_a_method_that_fails_is_found_out(failure):
    """Exact physics is missed by more than 5 %, with finite numbers; the outcome is not finished, and says when."""
    controlled = METHODS[failure.method].controlled
    settings = Settings(tolerance=failure.setting if controlled else 1e-6, budget=1_000_000)
    result, error = failure.simulate(failure.method, settings, None if controlled else failure.setting)
    assert error > 0.05
    assert result.outcome in (Outcome.INACCURATE, Outcome.DIVERGED)
    assert "t = " in result.detail


@pytest.mark.parametrize("method", ["symplectic-euler", "rk4"])
def test_explicit_methods_beyond_the_friction_limit_are_smooth_and_wrong(method):
    """Nothing in the states shows it: the needle keeps going at an even speed, only elsewhere. Halved steps show it, or the
    energy: friction takes mu f |v| of the sampled slips, and these are not what moves the needle."""
    result, error = needle(method, Settings(), 2e-7)
    speeds = np.diff(result.positions[1:, 1, 1])
    assert error > 0.1
    assert np.ptp(speeds) < 0.02 * abs(speeds.mean())
    assert result.outcome == Outcome.INACCURATE
    assert result.disagreement > 0.01 or result.energy_residual > 0.05


def slip_by_linear_steps(secant, step, duration):
    """Slip of a thrown ball at the end, by linearly implicit Euler with friction's secant slope (1) or its tangent (0)."""
    assembly = assemble(rolling_sphere())
    tables, work, state = assembly.tables, assembly.work(), assembly.initial_state()
    change = np.zeros((len(assembly.names), 8))
    for _ in range(round(duration / step)):
        linearise(tables, work, state.positions, state.velocities, secant, step, step * step, work.matrix)
        if not factorise_system(tables, work, state.positions):
            return np.nan
        work.blocks[:] = 0.0
        gather(tables, work.force, step, work.blocks)
        linearise(tables, work, state.positions, state.velocities, secant, 0.0, 1.0, work.stiffness)
        gather(tables, state.velocities, 1.0, rows := np.zeros_like(work.blocks))
        multiply(tables.pattern, work.stiffness, rows, -step * step, work.blocks)
        solve_system(tables, work, work.gamma, change)
        state.velocities += change[:, :6]
        for i in range(len(assembly.names)):
            move(state.positions[i], step * np.append(state.velocities[i], [0.0, 0.0]), state.positions[i])
    return abs(state.velocities[1, 0] - 0.1 * state.velocities[1, 4])


def test_the_tangent_slope_of_friction_fails_where_the_secant_holds():
    """Why no method of one linear solve a step takes the tangent: a sliding ball's tangent sees no friction that could
    stop it, so it slides on to the other side, and to and fro, 7/2 mu g h at a time, instead of rolling. The transition
    velocity is 1 mm/s."""
    step = 0.01
    assert slip_by_linear_steps(1.0, step, 0.5) < 1e-4
    assert slip_by_linear_steps(0.0, step, 0.5) > 0.1 * 7 / 2 * 0.2 * 9.81 * step


def swing(**settings):
    """A pendulum of length 1 in steps of 0.02 s by the classical Runge-Kutta method."""
    return run(assemble(pendulum()), "rk4", 2.0, step=0.02, samples=20, settings=Settings(**settings))


def test_drift_without_stabilisation_is_reported():
    """Accelerations alone let the rod grow longer; projection or Baumgarte's rates hold it."""
    held, drifting = swing(), swing(projection=False)
    assert held.outcome == Outcome.FINISHED, held.detail
    assert held.drift < 1e-12 < swing(projection=False, baumgarte=10.0).drift < drifting.drift
    fast = run(assemble(pendulum()), "rk4", 10.0, step=0.1, samples=20, settings=Settings(projection=False))
    assert fast.outcome == Outcome.INACCURATE
    assert "constraints have drifted by" in fast.detail


def test_baumgartes_rate_beyond_the_steps_is_reported():
    """alpha h beyond 2.785, where the method itself leaves its region of stability on the decay alpha."""
    assert swing(projection=False, baumgarte=20.0).outcome == Outcome.FINISHED
    stiff = swing(projection=False, baumgarte=4.0 / 0.02)
    assert stiff.outcome in (Outcome.DIVERGED, Outcome.INACCURATE)
    assert "t = " in stiff.detail


@pytest.mark.parametrize("method", list(METHODS))
def test_a_budget_of_few_evaluations_is_reported_by_every_method(method):
    settings = Settings(tolerance=1e-6, budget=40)
    result, _ = needle(method, settings, None if METHODS[method].controlled else 1e-8)
    assert result.outcome == Outcome.EVALUATION_LIMIT
    assert "force evaluations at t = " in result.detail


def test_chatter_of_unloaded_needles_is_reported():
    """A loaded ring with clearance: most needles are loose and are thrown to and fro in steps too long for their gaps."""
    assembly = assemble(needle_ring(9, preload=-3e-3, speed=60.0, load=300.0))
    result = run(assembly, "linearly-implicit-euler", 5e-3, step=1e-4, samples=20)
    assert result.outcome in (Outcome.INACCURATE, Outcome.DIVERGED)
    assert "t = " in result.detail
