"""Andrews' squeezing mechanism: seven bodies and ten joints in a plane, one degree of freedom, very fast.

Data and reference solution: test set for initial value problem solvers (Mazzia and Magherini 2008), problem "Andrews".
As spatial revolute joints its 50 equations leave 42 - 50 < 0 degrees of freedom on paper: nine are redundant. SI units.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.scene import GROUND, Body, Revolute, Scene, Spring, Vector

END = 0.03

REFERENCE_ANGLES = np.array(
    [
        15.81077119629904,
        -15.75637105984298,
        0.04082224013073101,
        -0.5347301163226948,
        0.5244099658805304,
        0.5347301163226948,
        1.048080741042263,
    ]
)
"""beta, Theta, gamma, Phi, delta, Omega, epsilon at 0.03 s."""

REFERENCE_RATES = np.array(
    [
        1139.920302151208,
        -1424.379294994111,
        11.03291221937134,
        19.29337464421385,
        0.5735699284790808,
        -19.29337464421385,
        0.3231791658026955,
    ]
)
"""Their rates."""

_MASS = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
_INERTIA = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
_D, _DA, _E, _EA, _RR, _RA, _SS, _SA, _SB = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092, 0.035, 0.01874, 0.01043
_SC, _SD, _TA, _TB, _U, _UA, _UB, _ZF, _ZT, _FA = (
    0.018,
    0.02,
    0.02308,
    0.00916,
    0.04,
    0.01228,
    0.00449,
    0.02,
    0.04,
    0.01421,
)
_A, _B, _C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
_DRIVE, _SPRING, _FREE_LENGTH = 0.033, 4530.0, 0.07785
_START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)

_COMBINED = np.array(
    [
        [1, 0, 0, 0, 0, 0, 0],
        [1, 1, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0, 0],
        [0, 0, 0, 1, 1, 0, 0],
        [0, 0, 0, 0, 1, 0, 0],
        [0, 0, 0, 0, 0, 1, 1],
        [0, 0, 0, 0, 0, 0, 1],
    ]
)
"""Rotation of each body as a sum of the relative angles."""


def _centres(q: tuple[float, ...]) -> FloatArray:
    """Centres of mass of the bodies 1 to 7 at the angles q."""
    beta, theta, gamma, phi, delta, omega, epsilon = q
    sin, cos = math.sin, math.cos
    return np.array(
        [
            [_RA * cos(beta), _RA * sin(beta)],
            [_RR * cos(beta) - _DA * cos(beta + theta), _RR * sin(beta) - _DA * sin(beta + theta)],
            [_B[0] + _SA * sin(gamma) + _SB * cos(gamma), _B[1] - _SA * cos(gamma) + _SB * sin(gamma)],
            [
                _A[0] + _ZT * cos(delta) + (_E - _EA) * sin(phi + delta),
                _A[1] + _ZT * sin(delta) - (_E - _EA) * cos(phi + delta),
            ],
            [_A[0] + _TA * cos(delta) - _TB * sin(delta), _A[1] + _TA * sin(delta) + _TB * cos(delta)],
            [
                _A[0] + _U * sin(epsilon) + (_ZF - _FA) * cos(omega + epsilon),
                _A[1] - _U * cos(epsilon) + (_ZF - _FA) * sin(omega + epsilon),
            ],
            [_A[0] + _UA * sin(epsilon) - _UB * cos(epsilon), _A[1] - _UA * cos(epsilon) - _UB * sin(epsilon)],
        ]
    )


def andrews() -> Scene:
    """The mechanism at rest at its start."""
    turns = _COMBINED @ np.array(_START)
    centres = _centres(_START)
    beta, theta, gamma, _, delta, _, epsilon = _START
    driven = np.array([_RR * math.cos(beta), _RR * math.sin(beta)])
    hub = driven - _D * np.array([math.cos(beta + theta), math.sin(beta + theta)])
    joint_45 = np.array(_A) + _ZT * np.array([math.cos(delta), math.sin(delta)])
    joint_67 = np.array(_A) + _U * np.array([math.sin(epsilon), -math.cos(epsilon)])
    hook = np.array(_B) + np.array(
        [_SD * math.cos(gamma) + _SC * math.sin(gamma), _SD * math.sin(gamma) - _SC * math.cos(gamma)]
    )

    def local(body: int, point: FloatArray | tuple[float, float]) -> Vector:
        """A point of the plane in the axes of body 1 to 7; those of the ground are the world's."""
        if body == 0:
            return (float(point[0]), float(point[1]), 0.0)
        x, y = np.asarray(point) - centres[body - 1]
        cosine, sine = math.cos(turns[body - 1]), math.sin(turns[body - 1])
        return (float(cosine * x + sine * y), float(cosine * y - sine * x), 0.0)

    def name(body: int) -> str:
        return f"K{body}" if body else GROUND

    bodies = tuple(
        Body(
            name(i + 1),
            _MASS[i],
            (_INERTIA[i],) * 3,
            position=(centres[i, 0], centres[i, 1], 0.0),
            attitude=(math.cos(turns[i] / 2), 0.0, 0.0, math.sin(turns[i] / 2)),
            moment=(0.0, 0.0, _DRIVE if i == 0 else 0.0),
        )
        for i in range(7)
    )
    places = (
        (0, 1, (0.0, 0.0)),
        (1, 2, driven),
        (2, 3, hub),
        (2, 4, hub),
        (2, 6, hub),
        (0, 3, _B),
        (4, 5, joint_45),
        (0, 5, _A),
        (6, 7, joint_67),
        (0, 7, _A),
    )
    joints = tuple(Revolute(name(a), name(b), local(a, place), local(b, place)) for a, b, place in places)
    spring = Spring(GROUND, "K3", _SPRING, _FREE_LENGTH, local(0, _C), local(3, hook))
    return Scene(bodies, springs=(spring,), constraints=joints, length_scale=0.01, speed_scale=10.0, rotation_scale=1e3)


def angles(positions: FloatArray, near: FloatArray) -> FloatArray:
    """Relative angles of the test set from positions of the bodies; full turns as in `near`."""
    turns = 2 * np.arctan2(positions[1:, 6], positions[1:, 3])
    wanted = _COMBINED @ near
    turns += 2 * math.pi * np.round((wanted - turns) / (2 * math.pi))
    return np.linalg.solve(_COMBINED, turns)


def rates(velocities: FloatArray) -> FloatArray:
    """Rates of the relative angles."""
    return np.linalg.solve(_COMBINED, velocities[1:, 5])
