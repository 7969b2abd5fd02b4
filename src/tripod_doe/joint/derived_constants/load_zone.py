"""Load zone of the needle bearing: loaded needles, and the sum of their loads over the bearing load."""

from __future__ import annotations

import numpy as np

from tripod_doe.mechanics.compilation.kernels import inner_kernel, kernel

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)


@kernel
def bearing_load_zone(load, clearance, stiffness, needle_count):
    """Load zone of a needle bearing with radial clearance: the sum of the needle loads over the bearing load.

    The roller moves by D across its trunnion; a needle at the angle g from the load is pressed by D cos g - c against
    trunnion and bore in series. D follows from the force balance along the load; needles are treated as a continuous
    ring.

    Args:
        load: Bearing load in N.
        clearance: Radial clearance c in mm; negative for preload.
        stiffness: Of one needle against one part, N / mm^(10/9).
        needle_count: Needles on the circumference.

    Returns:
        The sum of the needle loads over the bearing load, and the penetration in mm of the most loaded needle into each
        of its two partners. The first value is near 1.26 without clearance and tends to 1 for a wide clearance.
    """
    load = max(load, 1e-9)
    floor = max(clearance, 0.0)
    shift = floor + 2.0 * (load / stiffness) ** 0.9 + 1e-12
    along, total, slope = needle_loads(shift, clearance, stiffness, needle_count)
    while along < load:
        shift = floor + 2.0 * (shift - floor)
        along, total, slope = needle_loads(shift, clearance, stiffness, needle_count)
    for _ in range(60):  # the load is convex in the shift: Newton's method descends from above
        change = (along - load) / slope
        shift = max(shift - change, floor + 0.01 * (shift - floor))
        along, total, slope = needle_loads(shift, clearance, stiffness, needle_count)
        if abs(change) <= 1e-12 * shift:
            break
    return total / along, 0.5 * (shift - clearance)


@inner_kernel
def needle_loads(shift, clearance, stiffness, needle_count):
    """Load components along the load summed, loads summed, and d(first sum)/dD; Gauss quadrature on the load zone."""
    if shift <= clearance:
        return 0.0, 0.0, 0.0
    half_zone = np.arccos(min(max(clearance / shift, -1.0), 1.0))
    along, total, slope = 0.0, 0.0, 0.0
    for node in range(_NODES.size):
        cosine = np.cos(0.5 * half_zone * (1.0 + _NODES[node]))
        pressed = max(shift * cosine - clearance, 1e-300)
        needle_load = stiffness * (0.5 * pressed) ** (10.0 / 9.0) * _WEIGHTS[node]
        along += needle_load * cosine
        total += needle_load
        slope += 10.0 / 9.0 * needle_load * cosine * cosine / pressed
    scale = 0.5 * needle_count / np.pi * half_zone
    return along * scale, total * scale, slope * scale
