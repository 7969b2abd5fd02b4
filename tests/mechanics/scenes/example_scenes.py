"""Scenes with closed forms or published solutions that hold the engine to physics; SI units or none."""

from __future__ import annotations

import math

from tripod_doe.mechanics.scene import (
    GROUND,
    Body,
    Cylinder,
    Distance,
    Friction,
    Plane,
    PointInPlane,
    Revolute,
    Scene,
    SphereRow,
    Spring,
    Vector,
)

_GRAVITY = (0.0, -9.81, 0.0)


def pendulum() -> Scene:
    """A mass point on a rod of length 1 that starts horizontally: benchmark A01 of the IFToMM library."""
    bob = Body("bob", 1.0, (1.0, 1.0, 1.0), position=(-1.0, 0.0, 0.0))
    joints = (Distance(GROUND, "bob", 1.0), PointInPlane(GROUND, "bob"))
    return Scene((bob,), constraints=joints, gravity=_GRAVITY)


def four_bars(loops: int = 2) -> Scene:
    """N joined four-bar linkages of bars of mass and length 1: benchmark A02 of the IFToMM library.

    The bars B_i stand on the x axis at i and turn together at 1 m/s at their upper ends.
    """
    inertia: Vector = (1 / 12, 1 / 12, 1 / 12)  # only that about z matters in a plane
    bodies, joints = [], []
    for i in range(loops + 1):
        bodies.append(
            Body(
                f"crank {i}",
                1.0,
                inertia,
                position=(i, 0.5, 0.0),
                velocity=(0.5, 0.0, 0.0),
                angular_velocity=(0.0, 0.0, -1.0),
            )
        )
        joints.append(Revolute(GROUND, f"crank {i}", point_a=(i, 0.0, 0.0), point_b=(0.0, -0.5, 0.0)))
    for i in range(loops):
        bodies.append(Body(f"coupler {i}", 1.0, inertia, position=(i + 0.5, 1.0, 0.0), velocity=(1.0, 0.0, 0.0)))
        joints.append(Revolute(f"crank {i}", f"coupler {i}", point_a=(0.0, 0.5, 0.0), point_b=(-0.5, 0.0, 0.0)))
        joints.append(Revolute(f"coupler {i}", f"crank {i + 1}", point_a=(0.5, 0.0, 0.0), point_b=(0.0, 0.5, 0.0)))
    return Scene(tuple(bodies), constraints=tuple(joints), gravity=_GRAVITY)


def free_body() -> Scene:
    """A body that spins freely about an axis near its middle, unstable one: the gyroscopic terms decide its motion."""
    body = Body("body", 1.0, (1.0, 2.0, 3.0), velocity=(0.3, -0.1, 0.2), angular_velocity=(0.1, 2 * math.pi, 0.05))
    return Scene((body,), rotation_scale=2 * math.pi)


def rolling_sphere(friction: float = 0.2, transition: float = 1e-3) -> Scene:
    """A ball that is thrown onto a plane without spin: it slides, then rolls at 5/7 of its speed. SI units."""
    radius, mass = 0.1, 1.0
    stiffness = 1e6
    depth = (mass * 9.81 / stiffness) ** (2 / 3)
    ball = Body("ball", mass, (0.4 * mass * radius**2,) * 3, position=(0.0, 0.0, radius - depth), velocity=(1.0, 0, 0))
    touch = SphereRow("ball", Plane(GROUND), radius, stiffness, damping=1.0, friction=Friction(friction, transition))
    return Scene((ball,), contacts=(touch,), gravity=(0.0, 0.0, -9.81), length_scale=0.1, rotation_scale=10.0)


def dropped_ball(height: float = 0.05, stiffness: float = 1e6) -> tuple[Scene, float, float]:
    """A ball of 1 kg that falls onto an elastic plane and comes back to its height. SI units.

    Returns
    -------
    tuple
        The scene, when the ball is at its height again, and how long it touches the plane (Hertz: 2.943 delta / v).
    """
    gravity, radius = 9.81, 0.1
    speed = math.sqrt(2 * gravity * height)
    touching = 2.943 * (5 * speed**2 / (4 * stiffness)) ** 0.4 / speed
    ball = Body("ball", 1.0, (0.4 * radius**2,) * 3, position=(0.0, 0.0, radius + height))
    touch = SphereRow("ball", Plane(GROUND), radius, stiffness)
    scene = Scene((ball,), contacts=(touch,), gravity=(0.0, 0.0, -gravity), length_scale=height, speed_scale=speed)
    return scene, 2 * speed / gravity + touching, touching


def smooth_groove() -> Scene:
    """A ball that stays in contact with a groove while it rolls, slides and swings, tied to another body."""
    ball = Body(
        "ball",
        1e-3,
        (0.1, 0.12, 0.14),
        position=(0.0, 0.03, -0.138),
        velocity=(20.0, 10.0, 0.0),
        angular_velocity=(3.0, 1.0, 2.0),
        force=(0.0, 0.0, -100.0),
    )
    other = Body("other", 5e-4, (0.03, 0.05, 0.04), position=(12.0, 1.0, 2.0), angular_velocity=(50.0, 20.0, 80.0))
    friction = Friction(0.05, 25.0, 0.002, 16.0, 1.0, 0.002, 1.0)
    groove = SphereRow("ball", Cylinder(GROUND, 16.137, concave=True), 16.0, 1e5, damping=1e-3, friction=friction)
    spring = Spring("ball", "other", 50.0, 11.0, point_a=(1.0, 0.5, 0.0), point_b=(0.0, 0.3, 0.4), damping=0.02)
    return Scene((ball, other), contacts=(groove,), springs=(spring,), speed_scale=20.0, rotation_scale=50.0)
