"""Blocks of two bodies from a derivative about a common place: shared by all elements between two bodies."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import add, cross
from tripod_doe.mechanics.arithmetic.simd_lanes import load, pick, row, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel


@kernel
def add_pair(matrix, pair, block, arm_a, arm_b):
    """Add a pair's 6 x 6 block, taken about a common place, to the four blocks of its bodies.

    Args:
        matrix: Blocks of the scene, shape (block, 6, 8).
        pair: Block numbers aa, ab, ba, bb, or -1.
        block: Derivative by the relative motion at the place, shape (6, 8).
        arm_a, arm_b: The place from the centres of mass.
    """
    if pair[0] >= 0:
        _add_column(matrix, pair[0], pair[2], block, arm_a, arm_a, arm_b, 1.0)
    if pair[3] >= 0:
        _add_column(matrix, pair[1], pair[3], block, arm_b, arm_a, arm_b, -1.0)


@inlined_kernel
def _add_column(matrix, of_a, of_b, block, arm, arm_a, arm_b, sign):
    """Add the derivatives of both bodies' forces by the motion of the one whose centre is at -arm."""
    # a velocity v and an angular velocity w of the body move the place by v - arm x w
    x, y, z = arm
    by_x, by_y, by_z = (row(0.0, 0.0, 0.0, 0.0, z, -y), row(0.0, 0.0, 0.0, -z, 0.0, x), row(0.0, 0.0, 0.0, y, -x, 0.0))
    rows = (
        _shifted(load(block, 0), by_x, by_y, by_z),
        _shifted(load(block, 1), by_x, by_y, by_z),
        _shifted(load(block, 2), by_x, by_y, by_z),
        _shifted(load(block, 3), by_x, by_y, by_z),
        _shifted(load(block, 4), by_x, by_y, by_z),
        _shifted(load(block, 5), by_x, by_y, by_z),
    )
    if of_a >= 0:
        _add_rows(matrix[of_a], rows, arm_a, sign)
    if of_b >= 0:
        _add_rows(matrix[of_b], rows, arm_b, -sign)


@inlined_kernel
def _shifted(lanes, by_x, by_y, by_z):
    return lanes + (pick(lanes, 0) * by_x + pick(lanes, 1) * by_y + pick(lanes, 2) * by_z)


@inlined_kernel
def _add_rows(target, rows, arm, sign):
    """Add rows of forces and moments about a place, as seen from the centre at -arm."""
    moments = add((rows[3], rows[4], rows[5]), cross(arm, (rows[0], rows[1], rows[2])))
    store(target, 0, load(target, 0) + sign * rows[0])
    store(target, 1, load(target, 1) + sign * rows[1])
    store(target, 2, load(target, 2) + sign * rows[2])
    store(target, 3, load(target, 3) + sign * moments[0])
    store(target, 4, load(target, 4) + sign * moments[1])
    store(target, 5, load(target, 5) + sign * moments[2])
