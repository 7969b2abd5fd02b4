"""The balance of all grooves at all rotation angles of a point, by relaxation: the kernels behind `equilibrium`.

All samples of a point are relaxed together: Newton's method in the slip along the rolling direction and an accelerated
iteration in the contact angle, in loops that vectorise. Where time matters (`kinetostatic`) a sample follows the two
before it, by backward differences of second order around the whole revolution: what a sweep changes at one sample is
carried on to the next ones by a recursion, two laps of it. Without that, samples that do not settle (nearly sharp
friction has jumps) are solved one by one by nested bisection.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.roller_balance import (
    PointConstants,
    groove_forces,
    inertial_force,
    spider_load,
    spider_wrench,
    thrust_of_each,
)
from tripod_doe.mechanics.compilation import inlined_kernel, kernel

__all__ = ["solve_block"]

FloatArray = NDArray[np.float64]

_SWEEPS = 30
_MOVING_SWEEPS, _NEWTON_SWEEPS, _NEAR = 300, 60, 0.03
"""Where samples follow each other, tangent slopes overshoot far from the solution, and secant slopes crawl near it: the
tangent is taken once no sample changes by more than `_NEAR`, unless that still has not settled after so many sweeps."""

_BISECTIONS = 60
_OUTER = 20
_LEAST_LOSS = 1e-3  # of the transmitted power; a joint with less friction is measured against that


class _Revolution(NamedTuple):
    """What is known of one point, at every groove and sample; the next point writes over it.

    Attributes
    ----------
    cosines, sines
        Of the groove's angle ahead of the trunnions, shape (3, sample).
    psi
        Skew of each trunnion's needles in rad, shape (3,).
    slip, lean, root, normal
        Unknowns: slip along the rolling direction, force along the trunnion over N, a_H, N; shape (3, sample).
    tilt, spin
        Sine of the contact angle, and spin, behind those of the two samples before the first, shape (3, 2 + sample).
    frozen
        1 where an unknown is not to be changed, shape (3, sample).
    wrench
        What a groove does to the spider over N, see `spider_wrench`, shape (3, groove, sample).
    load
        What inertia does to the spider, shape (3, sample).
    step
        What a sweep wants to change, and how that goes over to the next samples, shape (8, sample).
    before
        The unknowns of the last sweep, shape (3, 3, sample).
    """

    cosines: FloatArray
    sines: FloatArray
    psi: FloatArray
    slip: FloatArray
    lean: FloatArray
    root: FloatArray
    normal: FloatArray
    tilt: FloatArray
    spin: FloatArray
    frozen: FloatArray
    wrench: FloatArray
    load: FloatArray
    step: FloatArray
    before: FloatArray


@inlined_kernel
def _past(values, j):
    """What the two samples before sample j add to its backward difference, of which 1.5 is its own weight."""
    return 0.5 * values[j] - 2.0 * values[j + 1]


@inlined_kernel
def _forces(p, r, k, j, cos_psi, sin_psi, newton):
    """Forces of roller k at sample j."""
    return groove_forces(
        p, r.cosines[k, j], r.sines[k, j], cos_psi, sin_psi, r.slip[k, j], r.lean[k, j], r.root[k, j],
        _past(r.tilt[k], j), _past(r.spin[k], j), newton,
    )  # fmt: skip


@kernel
def _relax(p, cosines, sines, psi, slip, lean, root, frozen, wrench):
    """One sweep over all samples, each by itself; `frozen` ones only refresh their wrench.

    The arrays come one by one: out of a tuple, their loop is not vectorised in the process that compiled it.
    """
    for k in range(3):
        cos_psi, sin_psi = np.cos(psi[k]), np.sin(psi[k])
        for j in range(slip.shape[1]):
            g = groove_forces(
                p, cosines[k, j], sines[k, j], cos_psi, sin_psi, slip[k, j], lean[k, j], root[k, j], 0.0, 0.0, 1.0
            )
            # where nothing resists, any spin will do and the slip stays zero
            free = 1.0 - frozen[k, j]
            slip[k, j] -= free * g.moment / min(g.moment_slope, -1e-30)
            lean[k, j] += free * (g.trunnion_force - lean[k, j]) / max(1.0 - g.feedback, 0.5)
            across_1, across_2, about_shaft, _ = spider_wrench(p, g, cosines[k, j], sines[k, j])
            wrench[0, k, j] = across_1
            wrench[1, k, j] = across_2
            wrench[2, k, j] = about_shaft


@kernel
def _relax_moving(p, r, newton):
    """One sweep over all samples, of which each follows those before it; slopes as for `groove_forces`."""
    for k in range(3):
        cos_psi, sin_psi = np.cos(r.psi[k]), np.sin(r.psi[k])
        for j in range(r.slip.shape[1]):
            g = _forces(p, r, k, j, cos_psi, sin_psi, newton)
            slip_slope, lean_slope = min(g.moment_slope, -1e-30), max(1.0 - g.feedback, 0.5)
            r.step[0, j], r.step[1, j] = -g.moment / slip_slope, g.inertia_gain * g.spin_gain / slip_slope
            r.step[2, j], r.step[3, j] = (g.trunnion_force - r.lean[k, j]) / lean_slope, g.swing_gain / lean_slope
            r.step[4, j], r.step[5, j] = g.sin_a, g.tilt_gain
            r.step[6, j], r.step[7, j] = g.spin, g.spin_gain
            r.wrench[0, k, j], r.wrench[1, k, j], r.wrench[2, k, j], _ = spider_wrench(
                p, g, r.cosines[k, j], r.sines[k, j]
            )
        _follow_on(r, k)


@kernel
def _follow_on(r, k):
    """Change the samples of a groove by what they want and what the changes before them ask for."""
    count = r.slip.shape[1]
    slip_1, slip_2, lean_1, lean_2 = 0.0, 0.0, 0.0, 0.0
    for j in range(2 * count):  # a lap to know what reaches the first samples
        i = j % count
        slip_1, slip_2 = r.step[0, i] + r.step[1, i] * (0.5 * slip_2 - 2.0 * slip_1), slip_1
        lean_1, lean_2 = r.step[2, i] + r.step[3, i] * (0.5 * lean_2 - 2.0 * lean_1), lean_1
        if j >= count:
            r.slip[k, i] += slip_1
            r.lean[k, i] += lean_1
            r.tilt[k, i + 2] = r.step[4, i] + r.step[5, i] * lean_1
            r.spin[k, i + 2] = r.step[6, i] + r.step[7, i] * slip_1
    for values in (r.tilt, r.spin):
        values[k, 0], values[k, 1] = values[k, count], values[k, count + 1]


@kernel
def _balance_spider(p, r):
    """Normal forces from the spider's balance, and with them the contact ellipse, one Newton step a call."""
    w, load = r.wrench, r.load
    for j in range(r.normal.shape[1]):
        b_0, b_1, b_2 = -load[0, j], -load[1, j], p.torque - load[2, j]
        # w N = b by cross products of the columns of w
        x_0, x_1, x_2 = _cross(w, 1, 2, j)
        y_0, y_1, y_2 = _cross(w, 2, 0, j)
        z_0, z_1, z_2 = _cross(w, 0, 1, j)
        factor = 1.0 / (x_0 * w[0, 0, j] + x_1 * w[1, 0, j] + x_2 * w[2, 0, j])
        r.normal[0, j] = (b_0 * x_0 + b_1 * x_1 + b_2 * x_2) * factor
        r.normal[1, j] = (b_0 * y_0 + b_1 * y_1 + b_2 * y_2) * factor
        r.normal[2, j] = (b_0 * z_0 + b_1 * z_1 + b_2 * z_2) * factor
    floor = 1e-3 * abs(p.torque) / p.pitch_radius
    for k in range(3):
        for j in range(r.normal.shape[1]):
            radius = r.root[k, j] / p.axis_factor
            r.root[k, j] = p.axis_factor / 3.0 * (2.0 * radius + max(r.normal[k, j], floor) / (radius * radius))


@inlined_kernel
def _cross(w, a, b, j):
    """Cross product of what grooves a and b do to the spider at sample j."""
    return (
        w[1, a, j] * w[2, b, j] - w[2, a, j] * w[1, b, j],
        w[2, a, j] * w[0, b, j] - w[0, a, j] * w[2, b, j],
        w[0, a, j] * w[1, b, j] - w[1, a, j] * w[0, b, j],
    )


@inlined_kernel
def _reach(p):
    """How large the force along a trunnion may be, over the mean normal force."""
    return p.groove_sliding + p.needle_sliding + 3.0 * p.pitch_radius * inertial_force(p, 1.0)[0] / abs(p.torque)


@kernel
def _unsettled(p, r):
    """Count the samples that moved by more than the tolerance since the last call, and mark them."""
    reach = _reach(p) + 1e-12
    count, largest = 0, 0.0
    for k in range(3):
        for j in range(r.slip.shape[1]):
            change = max(
                abs(r.slip[k, j] - r.before[0, k, j]) / p.slip_transition,
                abs(r.lean[k, j] - r.before[1, k, j]) / reach,
                abs(r.root[k, j] - r.before[2, k, j]) / r.root[k, j],
            )
            moved = not change <= p.tolerance
            largest = max(largest, change)
            r.frozen[k, j] = 1.0 if moved else 0.0
            count += moved
            r.before[0, k, j] = r.slip[k, j]
            r.before[1, k, j] = r.lean[k, j]
            r.before[2, k, j] = r.root[k, j]
    return count, largest


@kernel
def _bisect_slip(p, r, k, j, cos_psi, sin_psi):
    """Find the slip at which the moment about the trunnion vanishes; the moment falls with the slip."""
    reach = 1e4 * p.roller_radius * (p.omega + 1e-3)  # skewed needles alone may spin a free roller fast
    low, high = -reach, reach
    for _ in range(_BISECTIONS):
        r.slip[k, j] = 0.5 * (low + high)
        if _forces(p, r, k, j, cos_psi, sin_psi, 1.0).moment > 0.0:
            low = r.slip[k, j]
        else:
            high = r.slip[k, j]
    r.slip[k, j] = 0.5 * (low + high)


@kernel
def _bisect(p, r, k, j):
    """Find slip and force along the trunnion of one sample, by nested bisection."""
    cos_psi, sin_psi = np.cos(r.psi[k]), np.sin(r.psi[k])
    low, high = -_reach(p), _reach(p)
    for _ in range(_BISECTIONS):
        r.lean[k, j] = 0.5 * (low + high)
        _bisect_slip(p, r, k, j, cos_psi, sin_psi)
        if _forces(p, r, k, j, cos_psi, sin_psi, 1.0).trunnion_force > r.lean[k, j]:
            low = r.lean[k, j]
        else:
            high = r.lean[k, j]
    r.lean[k, j] = 0.5 * (low + high)
    _bisect_slip(p, r, k, j, cos_psi, sin_psi)


@kernel
def _solve_stubborn(p, r):
    """Solve the samples that relaxation left unsettled, with the spider's balance around them."""
    largest = 0.0
    for _ in range(_OUTER):
        for k in range(3):
            for j in range(r.slip.shape[1]):
                if r.frozen[k, j] == 1.0:
                    _bisect(p, r, k, j)
        largest = 0.0
        for _ in range(3):
            before = r.normal.copy()
            _relax(p, r.cosines, r.sines, r.psi, r.slip, r.lean, r.root, r.frozen, r.wrench)
            _balance_spider(p, r)
            largest = np.abs(r.normal - before).max()
        if largest <= 1e3 * p.tolerance * abs(p.torque) / p.pitch_radius:
            return True
    return False


@kernel
def _settle(p, r):
    """Solve a point in which every sample stands by itself; whether it settled, and sweeps."""
    for sweep in range(_SWEEPS):
        r.frozen[:] = 0.0
        _relax(p, r.cosines, r.sines, r.psi, r.slip, r.lean, r.root, r.frozen, r.wrench)
        _balance_spider(p, r)
        if _unsettled(p, r)[0] == 0:
            return True, sweep + 1
    return _solve_stubborn(p, r), _SWEEPS


@kernel
def _settle_moving(p, r):
    """Solve a point in which samples follow each other; whether it settled, and sweeps."""
    _start_moving(p, r)
    largest = np.inf
    for sweep in range(_MOVING_SWEEPS):
        newton = 1.0 if largest < _NEAR and sweep < _NEWTON_SWEEPS else 0.0
        _relax_moving(p, r, newton)
        _balance_spider(p, r)
        count, largest = _unsettled(p, r)
        if count == 0:
            return True, sweep + 1
    return False, _MOVING_SWEEPS


@kernel
def _account(p, r, thrust, parts, powers):
    """Thrust of each groove, and at each sample its parts and the power of the five mechanisms and the input shaft."""
    parts[:] = 0.0
    powers[:] = 0.0
    for k in range(3):
        cos_psi, sin_psi = np.cos(r.psi[k]), np.sin(r.psi[k])
        for j in range(r.slip.shape[1]):
            load = r.normal[k, j]
            g = _forces(p, r, k, j, cos_psi, sin_psi, 1.0)
            thrust[k, j] = -load * g.friction_z
            of_each = thrust_of_each(p, g, r.cosines[k, j], r.sines[k, j])
            parts[0, j] += load * of_each[0]
            parts[1, j] += load * of_each[1]
            parts[2, j] += load * of_each[2]
            parts[3, j] += load * of_each[3]
            parts[4, j] += load * of_each[4]
            parts[5, j] += load * of_each[5]
            powers[0, j] += load * g.sliding_power
            powers[1, j] += load * g.spinning_power
            powers[2, j] += load * g.rolling_power
            powers[3, j] += load * g.needle_sliding_power
            powers[4, j] += load * g.needle_rolling_power
            powers[5, j] += load * spider_wrench(p, g, r.cosines[k, j], r.sines[k, j])[3] * p.omega


@kernel
def _start(p, r, psi, cosines, sines):
    """Start without slip and with even loads."""
    r.psi[:] = psi
    r.slip[:], r.lean[:], r.load[:], r.tilt[:], r.spin[:], r.before[:] = 0.0, 0.0, 0.0, 0.0, 0.0, np.inf
    mean_load = abs(p.torque) / (3.0 * p.pitch_radius)
    r.root[:] = p.axis_factor * mean_load ** (1.0 / 3.0)
    r.normal[:] = mean_load
    cos_lag, sin_lag = np.cos(p.lag), np.sin(p.lag)
    r.cosines[:] = cosines * cos_lag + sines * sin_lag
    r.sines[:] = sines * cos_lag - cosines * sin_lag


@kernel
def _start_moving(p, r):
    """Find what inertia does to the spider, and what the start would leave behind for later samples."""
    for k in range(3):
        cos_psi, sin_psi = np.cos(r.psi[k]), np.sin(r.psi[k])
        for j in range(r.slip.shape[1]):
            across_1, across_2, about_shaft = spider_load(p, r.cosines[k, j], r.sines[k, j])
            r.load[0, j] += across_1
            r.load[1, j] += across_2
            r.load[2, j] += about_shaft
            g = _forces(p, r, k, j, cos_psi, sin_psi, 1.0)
            r.tilt[k, j + 2], r.spin[k, j + 2] = g.sin_a, g.spin


@kernel
def solve_block(table, skews, cosines, sines, thrust, parts, power, residual, extremes, sweeps, settled):
    """Solve every point of a block by itself.

    Parameters
    ----------
    table
        Rows of `PointConstants`.
    skews
        Of the needles of each trunnion in rad, shape (point, 3).
    cosines, sines
        Of the rotation angle of every groove, shape (3, sample).
    thrust, parts, power, residual, extremes, sweeps, settled
        Filled: see `equilibrium.Equilibrium`; `extremes` are the largest and smallest normal force.
    """
    shape = cosines.shape
    powers = np.empty((6, shape[1]))
    r = _Revolution(
        np.empty(shape), np.empty(shape), np.empty(3), np.empty(shape), np.empty(shape), np.empty(shape),
        np.empty(shape), np.empty((3, shape[1] + 2)), np.empty((3, shape[1] + 2)), np.empty(shape),
        np.empty((3, *shape)), np.empty((3, shape[1])), np.empty((8, shape[1])), np.empty((3, *shape)),
    )  # fmt: skip
    for i in range(table.shape[0]):
        c = table[i]
        p = PointConstants(
            c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12], c[13],
            c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21], c[22], c[23], c[24], c[25], c[26], c[27],
        )  # fmt: skip
        if p.torque == 0.0:
            thrust[i] = 0.0
            parts[i] = 0.0
            power[i] = 0.0
            extremes[i, 0], extremes[i, 1], settled[i] = 0.0, 0.0, True
            continue
        _start(p, r, skews[i], cosines, sines)
        settled[i], sweeps[i] = _settle_moving(p, r) if p.pace > 0.0 else _settle(p, r)
        _account(p, r, thrust[i], parts[i], powers)
        for mechanism in range(5):
            power[i, mechanism] = powers[mechanism].mean()
        lost, transmitted = power[i].sum(), abs(p.torque * p.omega)
        if transmitted > 0.0:
            imbalance = powers[5].mean() - p.torque * p.omega - lost
            residual[i] = imbalance / max(lost, _LEAST_LOSS * transmitted)
        extremes[i, 0], extremes[i, 1] = r.normal.max(), r.normal.min()
