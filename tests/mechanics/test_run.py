"""Runs check themselves, and constrained motion by every method (exact physics)."""

import math

import numpy as np
import pytest
from example_scenes import pendulum, rolling_sphere

from tripod_doe.errors import InputError
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.mechanics.scene import (
    GROUND,
    Body,
    Distance,
    Fixed,
    Friction,
    Plane,
    PointInPlane,
    PrescribedRotation,
    Revolute,
    Scene,
    SphereRow,
    Spring,
    Universal,
)
from tripod_doe.mechanics.solve.newton import largest_correction
from tripod_doe.model_interface import Outcome


def _driven_arm():
    """An arm that a drive turns about z with angle 0.3 + 2 t + 1.5 t^2, and a box fixed to its end."""
    arm = Body(
        "arm",
        2.0,
        (0.1, 0.2, 0.3),
        position=(0.5 * math.cos(0.3), 0.5 * math.sin(0.3), 0.0),
        attitude=(math.cos(0.15), 0.0, 0.0, math.sin(0.15)),
        angular_velocity=(0.0, 0.0, 2.0),
        velocity=(-math.sin(0.3), math.cos(0.3), 0.0),
    )
    box = Body(
        "box",
        1.0,
        (0.05, 0.05, 0.05),
        position=(math.cos(0.3), math.sin(0.3), 0.0),
        velocity=(-2.0 * math.sin(0.3), 2.0 * math.cos(0.3), 0.0),
        angular_velocity=(0.0, 0.0, 2.0),
    )
    joints = (
        Revolute(GROUND, "arm", point_b=(-0.5, 0.0, 0.0)),
        PrescribedRotation(GROUND, "arm", angle=0.3, rate=2.0, acceleration=3.0),
        Fixed("arm", "box"),
    )
    return Scene((arm, box), constraints=joints)


@pytest.mark.parametrize(
    ("method", "step", "error"),
    [
        ("rk4", 1e-3, 1e-9),
        ("rosenbrock", None, 1e-6),
        ("bdf2", 1e-3, 1e-3),
        ("generalized-alpha", 1e-3, 1e-3),
        ("linearly-implicit-euler", 1e-3, 1e-2),
    ],
)
def test_driven_arm_follows_its_drive_and_takes_its_work(method, step, error):
    result = run(assemble(_driven_arm()), method, 1.0, step=step, samples=10)
    assert result.outcome == Outcome.FINISHED, result.detail
    angle = 0.3 + 2.0 + 1.5
    np.testing.assert_allclose(result.positions[-1, 2, :2], [math.cos(angle), math.sin(angle)], atol=max(error, 1e-12))
    inertia = 0.3 + 2.0 * 0.25 + 0.05 + 1.0
    assert result.work[0] == pytest.approx(0.5 * inertia * (5.0**2 - 2.0**2), rel=max(error, 1e-5))


@pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.compiled])
def test_pendulum_by_every_method(method):
    reference = run(assemble(pendulum()), "rk4", 1.0, step=1e-3).positions[-1, 1, :2]
    # first order: half a step times the acceleration of up to 3 g, and what the second follows from
    errors = {1: 6e-3, 2: 2e-5, 3: 1e-6, 4: 1e-10}
    settings = Settings(tolerance=1e-8 if METHODS[method].order > 1 else 1e-4)
    result = run(assemble(pendulum()), method, 1.0, step=2.5e-4, settings=settings)
    assert result.outcome == Outcome.FINISHED, result.detail
    np.testing.assert_allclose(result.positions[-1, 1, :2], reference, atol=errors[METHODS[method].order])
    assert np.linalg.norm(result.positions[-1, 1, :3]) == pytest.approx(1.0, abs=1e-6)


def test_universal_joint_transmits_rotation_with_its_known_ratio():
    """Two shafts at 0.5 rad through a universal joint: tan(output) = tan(input) / cos(0.5)."""
    bend = 0.5
    first = Body("in", 1.0, (1.0, 1.0, 1.0), angular_velocity=(1.0, 0.0, 0.0))
    # the output shaft's axis is its body x, turned by the bend about z
    second = Body(
        "out",
        1.0,
        (1.0, 1.0, 1.0),
        attitude=(math.cos(bend / 2), 0.0, 0.0, math.sin(bend / 2)),
        angular_velocity=(1.0, math.tan(bend), 0.0),
    )
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    joints = (
        Revolute(GROUND, "in", axis_a=x, axis_b=x),
        PrescribedRotation(GROUND, "in", axis_a=x, reference_a=y, reference_b=y, rate=1.0),
        Revolute(GROUND, "out", axis_a=(math.cos(bend), math.sin(bend), 0.0), axis_b=x),
        Universal("in", "out", axis_a=y, axis_b=z),
    )
    result = run(assemble(Scene((first, second), constraints=joints)), "rk4", 1.0, step=1e-3)
    w, i, _, k = result.positions[-1, 2, 3:]
    # attitude of the output: the bend, then a turn about its own axis
    turned = 2 * math.atan2(i, w) if abs(k) < 1e-12 else 2 * math.atan2(i / math.cos(bend / 2), w / math.cos(bend / 2))
    assert turned == pytest.approx(math.atan(math.tan(1.0) / math.cos(bend)), abs=1e-9)


def _ball(**friction):
    ball = Body("ball", 1e-3, (1e-2,) * 3, position=(0, 0, 5.0 - 0.01), velocity=(10.0, 0, 0), force=(0, 0, -10.0))
    touch = SphereRow("ball", Plane(GROUND), 5.0, 1e4, damping=0.1, friction=Friction(0.1, 0.1))
    return Scene((ball,), contacts=(touch,), speed_scale=10.0)


def test_outcomes_name_time_and_body():
    assembly = assemble(_ball())
    diverged = run(assembly, "rk4", 0.1, step=5e-2)
    assert diverged.outcome in (Outcome.DIVERGED, Outcome.INACCURATE)
    assert "t = " in diverged.detail
    spent = run(assembly, "rk4", 0.1, step=1e-6, settings=Settings(budget=100))
    assert spent.outcome == Outcome.EVALUATION_LIMIT
    floor = run(assembly, "rosenbrock", 0.1, settings=Settings(tolerance=1e-12, floor=1e-3))
    assert floor.outcome == Outcome.STEP_LIMIT
    assert "body ball" in floor.detail
    deep = run(assembly, "bdf2", 1e-3, step=1e-5, limits=Limits(penetration=1e-4))
    assert deep.outcome == Outcome.INACCURATE
    assert "penetration" in deep.detail
    assert "body ball" in deep.detail


def test_a_coarse_step_is_found_by_its_halves():
    """A ball that changes from sliding to rolling, in steps that jump over the change."""
    result = run(assemble(rolling_sphere()), "linearly-implicit-euler", 0.4, step=0.05)
    assert result.outcome != Outcome.FINISHED


def test_checks_cost_less_than_a_tenth():
    result = run(assemble(rolling_sphere()), "bdf2", 0.4, step=1e-4)
    assert result.outcome == Outcome.FINISHED, result.detail
    assert 0 < result.check_evaluations < 0.1 * result.force_evaluations


def test_bad_calls():
    with pytest.raises(InputError, match="did you mean 'bdf2'"):
        run(assemble(_ball()), "bdf3", 0.1, step=1e-4)
    with pytest.raises(InputError, match="needs a step"):
        run(assemble(_ball()), "bdf2", 0.1)
    with pytest.raises(InputError, match="at least one sample"):
        run(assemble(_ball()), "bdf2", -0.1, step=1e-4)


@pytest.mark.parametrize(
    ("method", "error"),
    [("linearly-implicit-euler", 1e-2), ("implicit-euler", 1e-2), ("bdf2", 5e-5), ("generalized-alpha", 5e-5)],
)
def test_reactions_reach_bodies_that_hang_on_a_constrained_one(method, error):
    """Exact physics: a ball on a stiff spring below a pendulum's bob; every method must find the motion of rk4.

    First order errs by half a step times the acceleration of up to 3 g over half a second, second order by its square.
    """
    bob = Body("bob", 1.0, (1.0, 1.0, 1.0), position=(-1.0, 0.0, 0.0))
    ball = Body("ball", 0.5, (1.0, 1.0, 1.0), position=(-1.0, -0.5, 0.0))
    spring = Spring("bob", "ball", 1e5, 0.5, damping=500.0)
    joints = (Distance(GROUND, "bob", 1.0), PointInPlane(GROUND, "bob"))
    scene = Scene((bob, ball), springs=(spring,), constraints=joints, gravity=(0.0, -9.81, 0.0))
    reference = run(assemble(scene), "rk4", 0.5, step=1e-4)
    result = run(assemble(scene), method, 0.5, step=1e-3)
    np.testing.assert_allclose(result.positions[-1, 1:, :2], reference.positions[-1, 1:, :2], atol=error)
    np.testing.assert_allclose(result.work[0], reference.work[0], rtol=2 * error)


def test_a_wrong_turn_is_found_although_its_centre_stays():
    """Implicit Euler is exact for the speed of a rotor under a constant moment, and 10 % wrong for its angle."""
    rotor = Body("rotor", 1.0, (1.0, 1.0, 1.0), moment=(0.0, 0.0, 1.0))
    result = run(assemble(Scene((rotor,))), "linearly-implicit-euler", 1.0, step=0.1)
    assert 2 * math.asin(result.positions[-1, 1, 6]) == pytest.approx(0.55, rel=1e-9)  # exact: 0.5
    assert result.outcome == Outcome.INACCURATE
    assert "body rotor" in result.detail
    fine = run(assemble(Scene((rotor,))), "bdf2", 1.0, step=1e-3)
    assert fine.outcome == Outcome.FINISHED, fine.detail


def test_what_is_not_a_number_is_the_largest_correction():
    tables, correction = assemble(_ball()).tables, np.zeros((2, 6))
    correction[0, 3] = math.nan
    assert not math.isfinite(largest_correction(tables, correction, np.zeros(2)))


def test_a_start_off_the_constraints_is_refused():
    joint = Distance(GROUND, "bob", 1.0)
    apart = Scene((Body("bob", 1.0, (1.0, 1.0, 1.0), position=(1.1, 0.0, 0.0)),), constraints=(joint,))
    with pytest.raises(InputError, match="bodies ground and bob start apart by"):
        run(assemble(apart), "rk4", 0.1, step=1e-2)
    body = Body("bob", 1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, 0.0), velocity=(0.3, 0.0, 0.0))
    with pytest.raises(InputError, match="start moving apart by"):
        run(assemble(Scene((body,), constraints=(joint,))), "rk4", 0.1, step=1e-2)


def test_a_small_sphere_too_deep_is_not_hidden_by_a_large_one():
    """Both balls rest on the plane: 0.05 into it is nothing for a radius of 100 and 0.02 too much for one of 0.1."""
    bodies, contacts = [], []
    for name, place, radius, depth in (("large", 0.0, 100.0, 0.05), ("small", 200.0, 0.1, 0.02)):
        bodies.append(
            Body(name, 1.0, (1.0, 1.0, 1.0), position=(place, 0.0, radius - depth), force=(0.0, 0.0, -1e3 * depth**1.5))
        )
        contacts.append(SphereRow(name, Plane(GROUND), radius, 1e3))
    result = run(assemble(Scene(tuple(bodies), contacts=tuple(contacts))), "bdf2", 1e-3, step=1e-4)
    assert result.penetration == pytest.approx(0.05, rel=1e-6)
    assert result.outcome == Outcome.INACCURATE
    assert "a penetration of 0.02 is outside the contact law" in result.detail
    assert "body small" in result.detail


@pytest.mark.parametrize(
    ("method", "least", "most"), [("rk4", 0, 0), ("linearly-implicit-euler", 1, 1), ("bdf2", 1, 9)]
)
def test_linear_systems_are_counted(method, least, most):
    """None a step for explicit methods, one for linearly implicit ones, as many as iterations for implicit ones."""
    result = run(assemble(rolling_sphere()), method, 0.01, step=1e-4)
    assert least * result.steps <= result.solves <= most * result.steps


@pytest.mark.parametrize(("method", "step"), [("bdf2", 4e-4), ("rosenbrock", None)])
def test_the_states_after_all_steps_are_those_that_a_run_passed(method, step):
    """Exact: those of a sample at every step; 2500 equal steps are more than are kept at once."""
    assembly, settings = assemble(pendulum()), Settings(tolerance=1e-6)
    traced = run(assembly, method, 1.0, step=step, settings=settings, limits=Limits(windows=0), every_step=True)
    assert traced.times.size == traced.steps + 1
    assert (np.diff(traced.times) > 0).all()
    assert traced.times[-1] == pytest.approx(1.0)
    if step:
        sampled = run(assembly, method, 1.0, step=step, samples=2500, limits=Limits(windows=0))
        assert traced.positions == pytest.approx(sampled.positions, abs=1e-9)
        assert traced.velocities == pytest.approx(sampled.velocities, abs=1e-8)
    else:
        whole = run(assembly, method, 1.0, settings=settings, limits=Limits(windows=0))
        assert (traced.positions[-1] == whole.positions[-1]).all()


@pytest.mark.parametrize("exponent", [1.5, 10 / 9])
def test_a_greased_contact_lets_a_small_vibration_decay(exponent):
    """Exact physics: m x'' + tau K x' + K x = 0 about the rest position decays at tau K / (2 m)."""
    load, stiffness, time, frequency = 100.0, 1e6, 8e-6, 1.3e4
    depth = (load / stiffness) ** (1 / exponent)
    mass = exponent * load / depth / frequency**2
    touch = SphereRow("ball", Plane(GROUND), 5.0, stiffness, exponent, damping_time=time)
    start = (0.0, 0.0, 5.0 - depth * (1 + 1e-5))
    ball = Body(
        "ball", mass, (1.0,) * 3, position=start, force=(0.0, 0.0, -load), locked=(True, True, False) + (True,) * 3
    )
    decay = time * frequency**2 / 2
    duration = 3 * 2 * math.pi / math.sqrt(frequency**2 - decay**2)
    result = run(assemble(Scene((ball,), contacts=(touch,))), "rk4", duration, step=duration / 4000, samples=1)
    left = (5.0 - depth - result.positions[-1, 1, 2]) / (depth * 1e-5)
    assert left == pytest.approx(math.exp(-decay * duration), rel=1e-3)
    assert 0.01 < left < 0.9
