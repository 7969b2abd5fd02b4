"""Constraint equations, their Jacobian and the right-hand side gamma of Eq. 1, and the solve for the multipliers.

Three kinds of equation make every joint: a point of b in a plane of a, n_a d = 0; two directions perpendicular,
a_a b_b = 0, where a_a may turn by a prescribed angle; and a distance, (d d - L^2) / (2 L) = 0. With d the vector
between the points, gamma = -(Phi_q q')_q q' - 2 Phi_qt q' - Phi_tt.

Multipliers follow from the Schur complement (Phi_q A^-1 Phi_q^T) lambda = r by Gaussian elimination with complete
pivoting, stopped at its rank: of redundant equations a largest independent set carries the load, the rest have
lambda = 0. Accelerations are unique although the multipliers are not.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.arithmetic.rotations import (
    add,
    cross,
    dot,
    load_attitude,
    load_vector,
    rotate,
    scale,
    subtract,
)
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.tables import DISTANCE, IN_PLANE

_RANK_TOLERANCE = 1e-10
"""Limit of a pivot over the first one: smaller pivots belong to redundant equations. In the tested scenes independent
equations are above 1e-6, redundant ones below 1e-14."""


@kernel
def evaluate_constraints(rows, positions, velocities, time, phi, phi_t, gamma, jacobian):
    """Evaluate all constraint equations.

    Args:
        positions, velocities, time: The state.
        phi, phi_t, gamma: Receive residuals, partial time derivatives and the right-hand side of Eq. 1, shape (row,).
        jacobian: Receives Phi_q for velocity and angular velocity of body a and of body b, shape (row, 12).
    """
    for k in range(rows.size):
        row = rows[k]
        at_a, at_b = positions[row.body_a], positions[row.body_b]
        turn_a, turn_b = load_vector(velocities[row.body_a], 3), load_vector(velocities[row.body_b], 3)
        arm_a = rotate(load_attitude(at_a), load_vector(row.point_a, 0))
        arm_b = rotate(load_attitude(at_b), load_vector(row.point_b, 0))
        speed_a = add(load_vector(velocities[row.body_a], 0), cross(turn_a, arm_a))
        speed_b = add(load_vector(velocities[row.body_b], 0), cross(turn_b, arm_b))
        between = subtract(add(load_vector(at_b, 0), arm_b), add(load_vector(at_a, 0), arm_a))
        closing = subtract(speed_b, speed_a)
        central = subtract(cross(turn_b, cross(turn_b, arm_b)), cross(turn_a, cross(turn_a, arm_a)))
        phi_t[k] = 0.0
        if row.kind == IN_PLANE or row.kind == DISTANCE:
            if row.kind == IN_PLANE:
                pull = rotate(load_attitude(at_a), load_vector(row.direction_a, 0))
                swing = cross(turn_a, pull)
                phi[k] = dot(pull, between)
                gamma[k] = -(2.0 * dot(swing, closing) + dot(cross(turn_a, swing), between) + dot(pull, central))
                # the plane turns with a: the lever on a reaches to the point of b
                lever_a = add(arm_a, between)
            else:
                pull = scale(1.0 / row.length, between)
                phi[k] = 0.5 * (dot(between, between) / row.length - row.length)
                gamma[k] = -(dot(closing, closing) / row.length + dot(pull, central))
                lever_a = arm_a
            moment_a, moment_b = cross(lever_a, pull), cross(arm_b, pull)
            for d in range(3):
                jacobian[k, d], jacobian[k, 6 + d] = -pull[d], pull[d]
                jacobian[k, 3 + d], jacobian[k, 9 + d] = -moment_a[d], moment_b[d]
            continue
        angle = row.motion[0] + time * (row.motion[1] + 0.5 * time * row.motion[2])
        rate = row.motion[1] + time * row.motion[2]
        cosine, sine = math.cos(angle), math.sin(angle)
        ahead = rotate(load_attitude(at_a), load_vector(row.direction_a, 0))
        turned = rotate(load_attitude(at_a), load_vector(row.turned_a, 0))
        first = add(scale(cosine, ahead), scale(sine, turned))
        second = rotate(load_attitude(at_b), load_vector(row.direction_b, 0))
        by_angle = subtract(scale(cosine, turned), scale(sine, ahead))
        driven = scale(rate, by_angle)
        driven_twice = subtract(scale(row.motion[2], by_angle), scale(rate * rate, first))
        swing_a, swing_b = cross(turn_a, first), cross(turn_b, second)
        phi[k], phi_t[k] = dot(first, second), dot(driven, second)
        moving = add(add(cross(turn_a, swing_a), scale(2.0, cross(turn_a, driven))), driven_twice)
        gamma[k] = -(
            dot(moving, second) + 2.0 * dot(add(swing_a, driven), swing_b) + dot(first, cross(turn_b, swing_b))
        )
        across = cross(first, second)
        for d in range(3):
            jacobian[k, d], jacobian[k, 6 + d] = 0.0, 0.0
            jacobian[k, 3 + d], jacobian[k, 9 + d] = across[d], -across[d]


@kernel
def factorise_schur(rows, jacobian, weighted, schur, pivots):
    """Form Phi_q A^-1 Phi_q^T and eliminate it with complete pivoting, stopping at its rank.

    Args:
        rows, jacobian: Table and Jacobian of the equations.
        weighted: A^-1 Phi_q^T of every row, shape (row, body, 6).
        schur: Receives the factors and, in its last column, the scale of every equation, shape (row, row + 1).
        pivots: Receives row order, column order and rank.
    """
    count = rows.size
    for i in range(count):
        a, b = rows[i].body_a, rows[i].body_b
        for j in range(count):
            total = 0.0
            for d in range(6):
                total += jacobian[i, d] * weighted[j, a, d] + jacobian[i, 6 + d] * weighted[j, b, d]
            schur[i, j] = total
        pivots[i], pivots[count + i] = i, i
    for i in range(count):  # scale equations of length and of angle: units must not decide redundancy
        schur[i, count] = 1.0 / math.sqrt(max(abs(schur[i, i]), 1e-300))
    for i in range(count):
        for j in range(count):
            schur[i, j] *= schur[i, count] * schur[j, count]
    first, rank = 0.0, 0
    for k in range(count):
        best, best_row, best_column = 0.0, k, k
        for i in range(k, count):
            for j in range(k, count):
                if abs(schur[i, j]) > best:
                    best, best_row, best_column = abs(schur[i, j]), i, j
        if k == 0:
            first = best
        if not best > _RANK_TOLERANCE * first:
            break
        rank = k + 1
        if best_row != k:
            pivots[k], pivots[best_row] = pivots[best_row], pivots[k]
            for j in range(count):
                schur[k, j], schur[best_row, j] = schur[best_row, j], schur[k, j]
        if best_column != k:
            pivots[count + k], pivots[count + best_column] = pivots[count + best_column], pivots[count + k]
            for i in range(count):
                schur[i, k], schur[i, best_column] = schur[i, best_column], schur[i, k]
        for i in range(k + 1, count):
            schur[i, k] /= schur[k, k]
            factor = schur[i, k]
            if factor != 0.0:
                for j in range(k + 1, count):
                    schur[i, j] -= factor * schur[k, j]
    pivots[2 * count] = rank


@kernel
def solve_schur(schur, pivots, right, multipliers):
    """Multipliers of one right-hand side; redundant equations get zero. `right` is overwritten."""
    count = right.size
    rank = pivots[2 * count]
    for i in range(count):
        multipliers[i] = right[pivots[i]] * schur[pivots[i], count]
    for i in range(rank):
        for j in range(i):
            multipliers[i] -= schur[i, j] * multipliers[j]
    for i in range(rank - 1, -1, -1):
        for j in range(i + 1, rank):
            multipliers[i] -= schur[i, j] * multipliers[j]
        multipliers[i] /= schur[i, i]
    for i in range(count):
        right[pivots[count + i]] = multipliers[i] if i < rank else 0.0
    for i in range(count):
        multipliers[i] = right[i] * schur[i, count]
