"""Constants of the needles of one trunnion as the kernels of `needle_motion` read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.geometry.transition_velocities import transition_velocities
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.compilation.kernels import inlined_kernel


class NeedleConstants(NamedTuple):
    """Constants of one point in mm, N, s, t, rad: the columns of the table that the kernels read."""

    # needles, spheres: needles of a trunnion, and spheres that stand for one
    needles: float
    spheres: float
    # length, reach: of a needle, l, and how far it may move from the middle to either stop
    length: float
    reach: float
    # pitch_radius, bore_radius, lever: r_p, r_b, and r_e = r_b r_t / r_p, at which a skewed needle's sliding friction
    # turns the roller
    pitch_radius: float
    bore_radius: float
    lever: float
    # clearance, stiffness, drop: radial clearance, C of a whole needle against one part, and the crown's drop over the
    # square of the station
    clearance: float
    stiffness: float
    drop: float
    # sliding, transition: mu_n and v_sn
    sliding: float
    transition: float
    # speed, cycles: of the housing in rad/s, and revolutions that are followed; and whether until needles repeat
    speed: float
    cycles: float
    settles: float
    thrown: float  # centrifugal force of a needle along its trunnion, N


_COUNT = len(NeedleConstants._fields)


@inlined_kernel
def needle_constants_of(row):
    """The constants in a row of their table."""
    return NeedleConstants(*to_fixed_tuple(row, _COUNT))


def needle_constants(points: JointValues[FloatArray]) -> FloatArray:
    """The table of a block of points, shape (point, constant)."""
    columns = {
        "needles": points.needle_count,
        "spheres": points.spheres_per_needle,
        "length": points.needle_length,
        "reach": points.needle_axial_clearance / 2,
        "pitch_radius": points.bearing_radius,
        "bore_radius": points.bore_radius,
        "lever": points.bore_radius * points.trunnion_radius / points.bearing_radius,
        "clearance": points.bearing_radial_clearance,
        "stiffness": points.needle_stiffness,
        "drop": 4 * points.needle_crown / points.needle_length**2,
        "sliding": points.needle_sliding_friction,
        "transition": transition_velocities(points).needle_slip,
        "speed": points.speed,
        "cycles": points.cycles,
        "settles": points.settled_needles,
        "thrown": points.needle_mass * points.pitch_radius * points.speed**2,
    }
    return np.stack([columns[name] for name in NeedleConstants._fields], axis=1)
