"""Vectors of three and unit quaternions as tuples: compiled, always inlined, without allocation.

Attitude is a unit quaternion (scalar first) from body to world axes; angular velocity is in world axes. Within a step
rotation is a vector theta from the attitude at its start, R = exp(theta) R_0 (the chart of Munthe-Kaas methods).
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel


@inlined_kernel
def add(a, b):
    """Sum of two vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inlined_kernel
def subtract(a, b):
    """Difference of two vectors."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined_kernel
def scale(factor, a):
    """Multiple of a vector."""
    return (factor * a[0], factor * a[1], factor * a[2])


@inlined_kernel
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined_kernel
def cross(a, b):
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined_kernel
def load_vector(array, start):
    """Three consecutive entries of a flat array."""
    return (array[start], array[start + 1], array[start + 2])


@inlined_kernel
def load_attitude(position):
    """Quaternion of a body's seven position coordinates."""
    return (position[3], position[4], position[5], position[6])


@inlined_kernel
def rotate(q, v):
    """Vector v of body axes in world axes."""
    axis = (q[1], q[2], q[3])
    t = scale(2.0, cross(axis, v))
    return add(add(v, scale(q[0], t)), cross(axis, t))


@inlined_kernel
def rotate_back(q, v):
    """Vector v of world axes in body axes."""
    return rotate((q[0], -q[1], -q[2], -q[3]), v)


@kernel
def move(position, displacement, moved):
    """Displace a body: translation, and rotation by a vector in world axes.

    Args:
        position: Shape (7,): centre of mass and quaternion.
        displacement: Shape (6,): translation and rotation vector.
        moved: Receives the new position, with the quaternion normalised; may be `position` itself.
    """
    theta = load_vector(displacement, 3)
    square = dot(theta, theta)
    if square < 1e-4:  # series to 1e-16, free of cancellation
        cosine = 1.0 - square / 8.0 * (1.0 - square / 48.0 * (1.0 - square / 120.0))
        factor = 0.5 * (1.0 - square / 24.0 * (1.0 - square / 80.0))
    else:
        angle = math.sqrt(square)
        cosine = math.cos(0.5 * angle)
        factor = math.sin(0.5 * angle) / angle
    a0, a1, a2, a3 = cosine, factor * theta[0], factor * theta[1], factor * theta[2]
    b0, b1, b2, b3 = position[3], position[4], position[5], position[6]
    w = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3
    x = a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2
    y = a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1
    z = a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0
    norm = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    for d in range(3):
        moved[d] = position[d] + displacement[d]
    moved[3], moved[4], moved[5], moved[6] = w * norm, x * norm, y * norm, z * norm


@inlined_kernel
def rotation_by(theta):
    """Unit quaternion of the rotation by a vector."""
    angle = math.sqrt(dot(theta, theta))
    factor = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    return (math.cos(0.5 * angle), factor * theta[0], factor * theta[1], factor * theta[2])


@inlined_kernel
def rotation_vector(to, start):
    """Vector theta of the rotation that takes the attitude `start` to the attitude `to`, |theta| below pi."""
    w = to[0] * start[0] + to[1] * start[1] + to[2] * start[2] + to[3] * start[3]
    x = -to[0] * start[1] + to[1] * start[0] - to[2] * start[3] + to[3] * start[2]
    y = -to[0] * start[2] + to[1] * start[3] + to[2] * start[0] - to[3] * start[1]
    z = -to[0] * start[3] - to[1] * start[2] + to[2] * start[1] + to[3] * start[0]
    sine = math.sqrt(x * x + y * y + z * z)
    sign = 1.0 if w >= 0.0 else -1.0  # q and -q are the same attitude
    factor = 2.0 * sign if sine < 1e-9 else 2.0 * sign * math.atan2(sine, sign * w) / sine
    return (factor * x, factor * y, factor * z)


@inlined_kernel
def tangent_rate(theta, omega):
    """Rate of the rotation vector theta at angular velocity omega: the inverse derivative of exp (Bortz's equation)."""
    square = dot(theta, theta)
    if square < 1e-4:
        factor = 1.0 / 12.0 + square / 720.0 + square * square / 30240.0
    else:
        half = 0.5 * math.sqrt(square)
        factor = (1.0 - half / math.tan(half)) / square
    turn = cross(theta, omega)
    return add(subtract(omega, scale(0.5, turn)), scale(factor, cross(theta, turn)))
