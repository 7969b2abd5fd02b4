"""A needle bearing whose load is off the middle of its needles, and turns its roller."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tripod_doe.joint.derived_constants.load_zone import needle_loads
from tripod_doe.mechanics.compilation.kernels import kernel, kernel_part

_NEWTON = 100
"""Most iterations; ten to twenty are usual."""
_WITHIN = 0.98
"""Largest distance of a load from the middle, divided by the distance of the outermost spheres."""
_LEAST = 1e-9
"""Stiffness against motions without resistance, over a needle's stiffness."""


class NeedleRow(NamedTuple):
    """The needles of a bearing, in mm and N; stiffness and clearance as for `bearing_load_zone`."""

    clearance: float
    stiffness: float  # of one needle against one part
    number: float
    length: float
    spheres: float  # spheres that stand for a needle
    crown: float  # of a needle


@kernel
def turned_bearing(load, offset, moment, needles):
    """Tilt and yaw of a roller under a load off the middle of its needles, which may be crowned, and a moment about it.

    Each ring of spheres is a bearing of its own: at the station x along the needles the roller has moved by D + b x
    along the load and by E + y x across it, in sum by d, against which the ring acts with F(d); its clearance is
    c + 8 h x^2 / l^2 with the crown h, which a needle has towards both partners. Shifts D and E, tilt b and yaw y
    follow from the balance of forces and of moments. Their energy is convex: Newton's method descends from anywhere.

    Args:
        load: In N.
        offset: Of the load from the middle of the needles, mm.
        moment: About the load, N mm.
        needles: `NeedleRow`.

    Returns:
        The sum of the needle loads over the bearing load, the shift D in mm, tilt b and yaw y in rad. With one sphere
        per needle nothing resists tilt: the roller is assumed upright.
    """
    clearance, stiffness, needle_count, length, spheres, crown = needles
    load, farthest = max(load, 1e-9), _WITHIN * 0.5 * length * (1.0 - 1.0 / spheres)
    offset, bow = min(max(offset, -farthest), farthest), 8.0 * crown
    twist = moment / length if spheres > 1.0 else 0.0
    vectors, system = np.zeros((3, 4)), np.zeros((4, 5))
    moved, step, pull = vectors[0], vectors[1], vectors[2]
    # rigid, it would touch the crown's parabola at the offset
    at = offset / length
    moved[0], moved[2] = max(clearance, 0.0) + 2.0 * (load / stiffness) ** 0.9 - bow * at * at, 2.0 * bow * at
    farther, total, descent = bow + 2.0 * (spheres * load / stiffness) ** 0.9, load, 0.0
    for _ in range(_NEWTON):
        total = _press(moved, clearance, bow, stiffness, needle_count, spheres, system)
        system[0, 4], system[2, 4], system[3, 4] = system[0, 4] - load, system[2, 4] - load * at, system[3, 4] - twist
        rise, left = 0.0, 0.0
        for i in range(4):
            rise, left = rise + system[i, 4] * step[i], max(left, abs(system[i, 4]))
        if rise > 0.5 * descent:  # too far: half of the way back
            for i in range(4):
                step[i] *= 0.5
                moved[i] -= step[i]
            descent *= 0.5
            continue
        if left <= 1e-9 * load:
            break
        for i in range(4):  # no slices: their error message for unequal shapes takes two seconds to compile
            pull[i] = system[i, 4]
        _solve(system)
        longest, descent = 1e-300, 0.0
        for i in range(4):
            longest = max(longest, abs(system[i, 4]))
        for i in range(4):
            step[i] = -min(1.0, farther / longest) * system[i, 4]
            moved[i] += step[i]
            descent -= pull[i] * step[i]
    return total / load, moved[0], moved[2] / length, moved[3] / length


@kernel_part
def _press(moved, clearance, bow, stiffness, needle_count, spheres, system):
    """Write what the rings act with, and its derivatives, for D, E, b l and y l; the plain sum of the needle loads."""
    total = 0.0
    for i in range(4):
        for j in range(5):
            system[i, j] = _LEAST * stiffness if i == j else 0.0
    for ring in range(int(spheres)):
        at = (ring + 0.5) / spheres - 0.5
        towards, aside = moved[0] + at * moved[2], moved[1] + at * moved[3]
        distance = max(math.hypot(towards, aside), 1e-12)
        along, pressed, slope = needle_loads(distance, clearance + bow * at * at, stiffness / spheres, needle_count)
        held, total = along / distance, total + pressed
        n_0, n_1 = towards / distance, aside / distance
        own = (held + (slope - held) * n_0 * n_0, (slope - held) * n_0 * n_1, held + (slope - held) * n_1 * n_1)
        for i in range(2):
            for j in range(2):
                lever = (at if i else 1.0) * (at if j else 1.0)
                system[2 * i, 2 * j] += lever * own[0]
                system[2 * i, 2 * j + 1] += lever * own[1]
                system[2 * i + 1, 2 * j] += lever * own[1]
                system[2 * i + 1, 2 * j + 1] += lever * own[2]
            system[2 * i, 4] += (at if i else 1.0) * along * n_0
            system[2 * i + 1, 4] += (at if i else 1.0) * along * n_1
    return total


@kernel_part
def _solve(system):
    """Solve for the last column in place; the energy is convex, so that no pivots are looked for."""
    for i in range(4):
        for row in range(i + 1, 4):
            weight = system[row, i] / system[i, i]
            for column in range(i + 1, 5):
                system[row, column] -= weight * system[i, column]
    for i in range(3, -1, -1):
        for column in range(i + 1, 4):
            system[i, 4] -= system[i, column] * system[column, 4]
        system[i, 4] /= system[i, i]
