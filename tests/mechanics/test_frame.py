"""Scenes described in axes that turn: exact physics, the same motion as in axes at rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.run import run
from tripod_doe.mechanics.scene import GROUND, Body, Scene, Spherical

RATE, DURATION = 7.0, 0.4
BODY = Body(
    "top",
    2.0,
    (1.0, 2.0, 3.0),
    position=(0.3, -0.4, 0.2),
    velocity=(1.0, 0.5, -0.7),
    angular_velocity=(2.0, -3.0, 1.0),
    moment=(0.0, 0.0, 1.5),
)


def _turned(body: Body) -> Body:
    """The same body seen from axes that turn about z at `RATE`, at the moment when both systems coincide."""
    velocity = np.array(body.velocity) - np.cross((0, 0, RATE), body.position)
    rotation = np.array(body.angular_velocity) - (0, 0, RATE)
    return Body(**{**vars(body), "velocity": tuple(velocity), "angular_velocity": tuple(rotation)})


@pytest.mark.parametrize("method", ["rk4", "bdf2"])
def test_a_free_body_moves_as_in_axes_at_rest(method: str) -> None:
    """A moment about the axis of the frame looks the same in both; 1e-5 is the error of bdf2 at this step."""
    at_rest = run(assemble(Scene((BODY,))), method, DURATION, step=1e-4)
    turning = run(assemble(Scene((_turned(BODY),), frame=(0.0, 0.0, RATE))), method, DURATION, step=1e-4)
    assert turning.outcome == 0
    back = Rotation.from_rotvec((0, 0, RATE * DURATION))
    tolerance = 1e-9 if method == "rk4" else 1e-5
    np.testing.assert_allclose(back.apply(turning.positions[-1, 1, :3]), at_rest.positions[-1, 1, :3], atol=tolerance)
    seen = back * Rotation.from_quat(turning.positions[-1, 1, 3:], scalar_first=True)
    true = Rotation.from_quat(at_rest.positions[-1, 1, 3:], scalar_first=True)
    assert (seen * true.inv()).magnitude() < tolerance
    assert turning.energy_residual < 1e-4


def test_a_body_at_rest_in_the_turning_axes_pulls_outward() -> None:
    """A whirling body on a pivot keeps its place in the frame if it starts there; its reaction is m r Omega^2."""
    radius = 0.5
    body = Body("bob", 2.0, (1.0, 1.0, 1.0), position=(radius, 0.0, 0.0))
    scene = Scene((body,), constraints=(Spherical(GROUND, "bob", point_b=(-radius, 0.0, 0.0)),), frame=(0.0, 0.0, RATE))
    result = run(assemble(scene), "rk4", DURATION, step=1e-3)
    np.testing.assert_allclose(result.positions[-1, 1, :3], (radius, 0.0, 0.0), atol=1e-12)
