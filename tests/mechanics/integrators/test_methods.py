"""Every method on one smooth scene: observed order, and agreement (exact mathematics)."""

import numpy as np
import pytest
from example_scenes import smooth_groove
from threadpoolctl import threadpool_limits

import tripod_doe as td
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import DIVERGED, FINISHED, Settings, begin_watch
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.tables import REJECTED

END = 2e-3
FIXED = {name: method for name, method in METHODS.items() if method.compiled}


def _followed(method, count, **settings):
    """Status, steps that were rejected, and the end of the motion."""
    assembly = assemble(smooth_groove())
    state, work = assembly.initial_state(), assembly.work()
    begin_watch(assembly.tables, work, state.positions, state.velocities, 0.0)
    numerics = Settings(**{"correction": 1e-13, "controlled": False} | settings)
    status = method.integrate(
        assembly.tables, work, state.positions, state.velocities, np.zeros(3), END, count, numerics
    )
    end = np.concatenate([state.positions[1:].ravel(), 1e-3 * state.velocities[1:].ravel()])
    return status, int(work.counters[REJECTED]), end


def _end(method, count, **settings):
    status, _, end = _followed(method, count, **settings)
    assert status == 0
    return end


@pytest.fixture(scope="module")
def reference():
    return _end(METHODS["rk4"], 25600)


@pytest.mark.parametrize("name", FIXED)
def test_observed_order_is_the_declared_one(name, reference):
    method = FIXED[name]
    counts = {1: (6400, 12800), 2: (1600, 3200), 3: (800, 1600), 4: (400, 800)}[method.order]
    errors = [np.abs(_end(method, count) - reference).max() for count in counts]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.2)


def test_a_step_of_bdf2_that_does_not_converge_is_made_in_parts(reference):
    """Regression: one needle that rattled ended a revolution, which was followed again in half steps, and all after it."""
    status, rejected, end = _followed(METHODS["bdf2"], 100, correction=1e-9, iterations=4)
    assert (status, 5 < rejected < 50) == (FINISHED, True)
    first_order = _end(METHODS["linearly-implicit-euler"], 100)
    assert np.abs(end - reference).max() < 0.5 * np.abs(first_order - reference).max()


def test_a_step_of_bdf2_that_does_not_converge_in_parts_ends_the_run():
    assert _followed(METHODS["bdf2"], 100, iterations=1)[:2] == (DIVERGED, 4)


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if method.controlled and method.order > 1])
def test_tolerance_is_met(name, reference):
    end = _end(METHODS[name], 1, controlled=True, tolerance=1e-8)
    # a tolerance a step, some hundred steps, scales of 1 mm and 20 to 50 in the velocities (here times 1e-3)
    assert np.abs(end - reference).max() < 1e-6


def test_the_pace_of_a_scene_follows_its_tolerance(reference):
    """First order: a tenth of the tolerance is a tenth of the error; steps are 2 tolerance times the time scale of 1."""
    errors = [
        np.abs(_end(METHODS["adaptive-euler"], 1, controlled=True, tolerance=t) - reference).max() for t in (1e-6, 1e-7)
    ]
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.2)


def test_scipys_methods_give_the_same_on_any_number_of_threads_of_linear_algebra():
    """LU factors are rounded differently on two threads; workers have one, a process of its own has all cores."""
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads, "blas"):
            found.append(td.simulate(scene="roller-in-groove", method="scipy-radau", relative_tolerance=1e-3))
    assert float(found[0]["axial_force_n"]) == float(found[1]["axial_force_n"])
