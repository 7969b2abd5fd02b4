"""Derivatives of a needle bearing's forces by the motion of its bore against its trunnion, for the block matrix."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import add, load_vector, subtract
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.forces.bearing import rolling_torque
from tripod_doe.mechanics.forces.bearing_load_zone import (
    in_world,
    place_bore,
    press_slice,
    slice_damping,
    slice_offset,
    slice_turning,
)
from tripod_doe.mechanics.forces.body_pairs import add_pair
from tripod_doe.mechanics.laws.friction import secant_slope, tangent_slope


@inlined_kernel
def _slope(secant, chord, magnitude, transition):
    """Slope of a friction law: the tangent, but not below a share of the secant (its chord)."""
    return chord if secant == 1.0 else max(tangent_slope(magnitude, transition), secant * chord)


@inlined_kernel
def _add_stations(block, across, along, n_1, n_2, station):
    """Add a slice at its station, resisting motion of the bore's axis along n and across it, upper half."""
    rise = along - across
    xx, xy, yy = across + rise * n_1 * n_1, rise * n_1 * n_2, across + rise * n_2 * n_2
    block[0, 0] += xx
    block[0, 1] += xy
    block[1, 1] += yy
    block[0, 3] -= station * xy
    block[0, 4] += station * xx
    block[1, 3] -= station * yy
    block[1, 4] += station * xy
    block[3, 3] += station * station * yy
    block[3, 4] -= station * station * xy
    block[4, 4] += station * station * xx


@inlined_kernel
def _add_drag(block, slope, cosine, arm_1, arm_2, twist):
    """Add slope times z z^T, upper half: z is the slip for each component of the motion."""
    z_3, z_4 = cosine * arm_2, -cosine * arm_1
    block[2, 2] += slope * cosine * cosine
    block[2, 3] += slope * cosine * z_3
    block[2, 4] += slope * cosine * z_4
    block[2, 5] -= slope * cosine * twist
    block[3, 3] += slope * z_3 * z_3
    block[3, 4] += slope * z_3 * z_4
    block[3, 5] -= slope * z_3 * twist
    block[4, 4] += slope * z_4 * z_4
    block[4, 5] -= slope * z_4 * twist
    block[5, 5] += slope * twist * twist


@inlined_kernel
def _mirror(block):
    """Fill the lower half of a symmetric block."""
    for i in range(6):
        for j in range(i):
            block[i, j] = block[j, i]


@inlined_kernel
def _turn_to_world(fit, block):
    """Turn a 6 x 6 block from the trunnion's frame to world axes, in place."""
    for i in range(6):
        for half in range(2):
            v = in_world(fit, block[i, 3 * half], block[i, 3 * half + 1], block[i, 3 * half + 2])
            block[i, 3 * half], block[i, 3 * half + 1], block[i, 3 * half + 2] = v
    for j in range(6):
        for half in range(2):
            v = in_world(fit, block[3 * half, j], block[3 * half + 1, j], block[3 * half + 2, j])
            block[3 * half, j], block[3 * half + 1, j], block[3 * half + 2, j] = v


@kernel
def _linearise(bearing, fit, secant, damping, stiffness):
    """Fill the derivatives of the force on the bore by its motion against the trunnion, about A + o_0, in its frame.

    With the bore's axis as reference, a spinning roller does not move against its trunnion.

    Returns:
        Whether anything touches.
    """
    for i in range(6):
        for j in range(8):  # the last two columns only fill the lanes
            damping[i, j], stiffness[i, j] = 0.0, 0.0
    carried, drags, spread_1, spread_2, tilt_1, tilt_2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(bearing.slices):
        station, clearance, x, y, reach = slice_offset(bearing, fit, k)
        if not reach > clearance:
            continue
        s = press_slice(bearing, fit, station, clearance, x, y, reach)
        _add_stations(stiffness, slice_turning(s.zone, reach), s.zone.along_slope, s.n_1, s.n_2, station)
        along, across = slice_damping(bearing, s, reach)
        _add_stations(damping, across, along, s.n_1, s.n_2, station)
        spread_1, spread_2 = spread_1 - s.zone.total_slope * s.n_1, spread_2 - s.zone.total_slope * s.n_2
        tilt_1, tilt_2 = tilt_1 - station * s.zone.total_slope * s.n_1, tilt_2 - station * s.zone.total_slope * s.n_2
        chord = secant_slope(abs(s.slip), 2.0 * bearing.sliding_transition)
        slope = bearing.sliding * s.load * _slope(secant, chord, abs(s.slip), 2.0 * bearing.sliding_transition)
        arm_1, arm_2 = s.lever * s.n_1 - fit.offset_1, s.lever * s.n_2 - fit.offset_2
        _add_drag(damping, slope, bearing.cosine, arm_1, arm_2, bearing.skew_lever)
        carried, drags = carried + s.load, drags + bearing.sliding * s.load * chord * s.slip
    _mirror(damping)
    _mirror(stiffness)
    if not carried > 0.0:
        return False
    pitch = 0.5 * (bearing.trunnion_radius + bearing.bore_radius)
    chord = secant_slope(abs(fit.spin), bearing.rolling_transition)
    slope = _slope(secant, chord, abs(fit.spin), bearing.rolling_transition)
    damping[5, 5] += bearing.rolling * carried * pitch * slope
    # a change of the loads changes the friction: the mean of the slices' drags is exact but for tilting speeds
    share = drags / carried
    axial = bearing.cosine * share
    torque = rolling_torque(bearing, fit, 1.0) - bearing.skew_lever * share
    for row, factor in ((2, axial), (5, torque)):
        stiffness[row, 0] += factor * spread_1
        stiffness[row, 1] += factor * spread_2
        stiffness[row, 3] -= factor * tilt_2
        stiffness[row, 4] += factor * tilt_1
    for j in range(6):
        stiffness[3, j] -= axial * pitch * stiffness[1, j]
        stiffness[4, j] += axial * pitch * stiffness[0, j]
    return True


@kernel
def bearing_matrices(tables, work, positions, velocities, slopes, matrix):
    """Add the derivatives of all needle bearings to the block matrix.

    Args:
        tables, work: The scene, and the memory of its run.
        positions, velocities: Shapes (body, 7) and (body, 6).
        slopes: Which derivatives are wanted (`tables.Slopes`).
        matrix: Receives by_velocity D + by_position K, shape (block, 6, 8).

    Included: rotation of the load zone. Not included: rotation of all forces with the trunnion, lean of the bore,
    effect of damping on stiffness and friction, and changes of the load distribution around the trunnion.
    """
    block, stiffness = work.pair[0], work.pair[1]
    for n in range(tables.bearings.size):
        bearing = tables.bearings[n]
        fit = place_bore(bearing, positions, velocities)
        if _linearise(bearing, fit, slopes.secant, block, stiffness):
            place = add(fit.place, in_world(fit, fit.offset_1, fit.offset_2, 0.0))
            for i in range(6):
                for j in range(6):
                    block[i, j] = slopes.by_velocity * block[i, j] + slopes.by_position * stiffness[i, j]
            _turn_to_world(fit, block)
            arm_a = subtract(place, load_vector(positions[bearing.body_a], 0))
            arm_b = subtract(place, load_vector(positions[bearing.body_b], 0))
            add_pair(matrix, bearing.pair, block, arm_a, arm_b)
