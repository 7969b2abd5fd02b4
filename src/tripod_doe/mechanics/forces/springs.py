"""Springs with dampers between points of two bodies: forces, energies and derivatives."""

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
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.forces.body_pairs import add_pair


@inlined_kernel
def _spring_state(spring, positions, velocities):
    """Arms, unit vector from a to b, velocity of b's end against a's, and length."""
    a, b = spring.body_a, spring.body_b
    arm_a = rotate(load_attitude(positions[a]), load_vector(spring.point_a, 0))
    arm_b = rotate(load_attitude(positions[b]), load_vector(spring.point_b, 0))
    between = subtract(add(load_vector(positions[b], 0), arm_b), add(load_vector(positions[a], 0), arm_a))
    closing = subtract(
        add(load_vector(velocities[b], 0), cross(load_vector(velocities[b], 3), arm_b)),
        add(load_vector(velocities[a], 0), cross(load_vector(velocities[a], 3), arm_a)),
    )
    length = math.sqrt(dot(between, between)) + 1e-300
    return arm_a, arm_b, scale(1.0 / length, between), closing, length


@kernel
def add_springs(tables, work, positions, velocities, slopes, matrix):
    """Add the forces of springs and dampers, their energies and, unless both factors are zero, their derivatives."""
    force, ledger = work.force, work.ledger
    for i in range(tables.springs.size):
        spring = tables.springs[i]
        arm_a, arm_b, along, closing, length = _spring_state(spring, positions, velocities)
        rate, stretch = dot(along, closing), length - spring.free_length
        tension = spring.stiffness * stretch + spring.damping * rate
        ledger[0] += 0.5 * spring.stiffness * stretch * stretch
        ledger[5] += spring.damping * rate * rate
        _apply_between(force, spring, arm_a, arm_b, scale(tension, along))
        if slopes.by_velocity != 0.0 or slopes.by_position != 0.0:
            across = spring.stiffness * stretch / length
            axial = spring.stiffness - across
            block = work.pair[0]
            clear(block)
            for d in range(3):
                block[d, d] = slopes.by_position * across
                for e in range(3):
                    along_both = slopes.by_velocity * spring.damping + slopes.by_position * axial
                    block[d, e] += along_both * along[d] * along[e]
            add_pair(matrix, spring.pair, block, arm_a, arm_b)


@inlined_kernel
def _apply_between(force, spring, arm_a, arm_b, pull):
    """Add a force that pulls body a, and its opposite on body b."""
    moment_a, moment_b = cross(arm_a, pull), cross(arm_b, pull)
    for d in range(3):
        force[spring.body_a, d] += pull[d]
        force[spring.body_a, 3 + d] += moment_a[d]
        force[spring.body_b, d] -= pull[d]
        force[spring.body_b, 3 + d] -= moment_b[d]
