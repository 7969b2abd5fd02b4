"""The engine on scenes with known motion: published numbers, conservation laws and closed forms."""

import andrews
import example_scenes as examples
import numpy as np
import pytest

from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.run import run
from tripod_doe.model_interface import Outcome


def _finished(scene, method, duration, **options):
    result = run(assemble(scene), method, duration, **options)
    assert result.outcome == Outcome.FINISHED, result.detail
    return result


def test_pendulum():
    result = _finished(examples.pendulum(), "rk4", 10.0, step=1e-3)
    np.testing.assert_allclose(result.positions[-1, 1, :2], (-0.2750874626, -0.9614192051), atol=1e-6)  # IFToMM A01


@pytest.mark.slow
def test_four_bars_pass_their_singular_positions():
    result = _finished(examples.four_bars(2), "rk4", 10.0, step=1e-3)
    upper_end = 2 * result.positions[-1, 1, :2]
    np.testing.assert_allclose(upper_end, (0.328458112, 0.944518538), atol=1e-6)  # IFToMM A02


def test_free_body_keeps_energy_and_angular_momentum():
    scene = examples.free_body()
    result = _finished(scene, "rk4", 100.0, step=1 / 400, samples=50)
    inertia = np.array(scene.bodies[0].inertia)
    w, x, y, z = result.positions[:, 1, 3:].T
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    omega = result.velocities[:, 1, 3:]
    local = np.einsum("ijs,si->sj", turn, omega)
    momentum = np.einsum("ijs,sj->si", turn, local * inertia)
    energy = 0.5 * (local**2 * inertia).sum(axis=1)
    assert np.abs(local[:, 1]).min() < 3.0  # it tumbles: the spin about the middle axis reverses
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    np.testing.assert_allclose(
        momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-8 * np.linalg.norm(momentum[0])
    )


def test_thrown_ball_ends_rolling_at_five_sevenths():
    result = _finished(examples.rolling_sphere(), "bdf2", 0.4, step=2e-4, samples=40)
    velocity = result.velocities[-1, 1]
    assert velocity[0] == pytest.approx(5 / 7, rel=1e-4)  # tanh friction creeps: v_st is a thousandth of the speed
    assert velocity[4] * 0.1 == pytest.approx(velocity[0], rel=1e-4)
    sliding_until = 2 / 7 / (0.2 * 9.81)
    sample = result.times < 0.9 * sliding_until
    np.testing.assert_allclose(result.velocities[sample, 1, 0], 1 - 0.2 * 9.81 * result.times[sample], atol=1e-3)
    assert result.work[1] == pytest.approx(0.5 * (1 - 5 / 7), rel=5e-3)  # the energy that sliding takes
    assert result.energy_residual < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stabilisation", "settings", "error", "drift"),
    [
        ("none", {"projection": False}, 5e-6, 1e-8),
        ("Baumgarte, 500 1/s", {"projection": False, "baumgarte": 500.0}, 3e-7, 1e-9),
        ("Baumgarte, 0.1/h", {"projection": False, "baumgarte": 0.1 / 3e-5}, 3e-6, 5e-9),
        ("projection", {}, 1e-8, 1e-15),
    ],
)
def test_andrews_squeezer_with_every_stabilisation(stabilisation, settings, error, drift):
    """Published solution; measured q errors 2.2e-6, 1.1e-7, 9.5e-7, 2.9e-9 and drifts 2e-9, 3e-10, 1e-9, 1e-16 m."""
    result = _finished(andrews.andrews(), "rk4", andrews.END, step=3e-5, settings=Settings(**settings))
    q = andrews.angles(result.positions[-1], andrews.REFERENCE_ANGLES)
    v = andrews.rates(result.velocities[-1])
    np.testing.assert_allclose(q, andrews.REFERENCE_ANGLES, rtol=error)
    assert result.drift < drift
    if stabilisation == "projection":
        np.testing.assert_allclose(v, andrews.REFERENCE_RATES, rtol=1e-6)
