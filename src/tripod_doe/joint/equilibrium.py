"""The equilibrium model: closed-form kinematics and the balance of forces at every rotation angle.

Derivation (paper's symbols; frame e_r, e_theta, e_z of one groove, see `kinematics`)
------------------------------------------------------------------------------------
A roller turns with the spider and about its trunnion t with the unknown spin s, so against the housing with
w = w_0 + s t. It touches the groove at -R_s n, where the normal n = sigma (cos a e_theta + sin a e_r) leans by the
unknown contact angle a; sigma is the sign of the torque. With tau = cos a e_r - sin a e_theta the slip at the contact

    v = sigma R_s w_z tau + (v_z - sigma R_s w_tau) e_z

is the whole relative velocity. At the groove act, for a normal force N,

    sliding friction     f   = -mu_s N tanh(|v| / v_st) v / |v|                              (Eq. 3, one vector)
    spinning moment      M_s = -(3/8) mu_s N a_H tanh(w_n / w_st) along the normal           (Eq. 6, 7)
    rolling resistance   M_r = -mu_r N (D/2) tanh(|w_t| / w_rt) w_t / |w_t|                  (Eq. 4)

with a_H the semi-major axis of the contact ellipse and w_t the part of w in the tangent plane. A needle rolls freely
across its axis and transmits friction only along it. Rolling between trunnion (radius r_t) and bore (r_b), skewed by
psi, it slips on both alike, together by w cos psi - s r_e sin psi; by virtual power the lever is r_e = r_b r_t / r_p
with the pitch radius r_p = (r_b + r_t) / 2. The needles carry kappa N in sum (`contact.bearing_load_zone`), so on the
roller act along and about its trunnion

    P   = -mu_n kappa N cos psi tanh((w cos psi - s r_e sin psi) / (2 v_sn))
    M_t = -mu_rn kappa N r_p tanh(s / s_st) + mu_n kappa N r_e sin psi tanh(the same)

(the rolling resistance mu_r f d_n/2 of every contact adds up to the pitch radius). Two equations a groove and angle:
forces along the trunnion, n t + (f t + P) / N = 0, give a; moments about it give s. The spider's balance (no force
across the shaft, moment T about it, the wrench of all three grooves, friction included) gives the three N. Everything
is proportional to N but a_H ~ N^(1/3) and kappa, which follows the mean load |T| / (3 R_p). The thrust on the housing
is the sum of -f_z. Input power = output power + friction power holds to rounding and is the model's own check.

Of the two effects that the usual estimate mu N tanh(v_z sin b / v_st) sin b misses, the slip across the groove
(sigma R_s w_z) turns the phase of the third order by 3 atan(R_s / R_p) / 2, and the roller's spin on its trunnion,
s = v_z / R_s + omega sin b, is out of phase with its rolling in the groove.

Left out: inertia; the shaft's finite length (the spider's orbit tilts it by e / L, lateral forces turn by R_p / L);
the roller's swinging in the groove's clearance, which turns the phase at small joint angles; the roller's tilt on its
trunnion; how the needles' skew changes; end stops and contacts between needles.

Solution: all samples of a point are relaxed together, Newton's method in the slip along the rolling direction and an
accelerated iteration in the contact angle, in loops that vectorise. Samples that do not settle (nearly sharp friction
has jumps) are solved one by one by nested bisection.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint import contact
from tripod_doe.joint.roller_balance import PointConstants, groove_forces, spider_wrench, thrust_of_each
from tripod_doe.joint.transition import transition_velocities
from tripod_doe.mechanics.compilation import kernel

__all__ = ["Equilibrium", "solve_equilibrium"]

FloatArray = NDArray[np.float64]

_SWEEPS = 30
_BISECTIONS = 60
_OUTER = 20
_LEAST_LOSS = 1e-3  # of the transmitted power; a joint with less friction is measured against that


@dataclass(frozen=True)
class Equilibrium:
    """Solution of a block of points.

    Attributes
    ----------
    groove_thrust
        Axial force on the housing at each groove over one revolution in N, shape (point, groove, sample).
    thrust_parts
        What each mechanism adds to their sum in N, shape (point, part, sample); see `thrust_parts`.
    friction_power
        Mean power lost to each mechanism in N mm/s, shape (point, mechanism).
    energy_residual
        Input less output less friction power, over the friction power (or a thousandth of the transmitted power, where
        that is larger), shape (point,).
    largest_normal_force, smallest_normal_force
        Of all grooves and angles in N, shape (point,).
    needle_penetration
        Of the most loaded needle into each partner in mm, shape (point,).
    sweeps
        Relaxation sweeps, and evaluations of all grooves' forces, shape (point,).
    settled
        Whether every balance was met within the tolerance, shape (point,).
    """

    groove_thrust: FloatArray
    thrust_parts: FloatArray
    friction_power: FloatArray
    energy_residual: FloatArray
    largest_normal_force: FloatArray
    smallest_normal_force: FloatArray
    needle_penetration: FloatArray
    sweeps: NDArray[np.int64]
    settled: NDArray[np.bool_]


@kernel
def _relax(p, cosines, sines, psi, frozen, slip, lean, root, wrench):
    """One sweep over all grooves and samples, each by itself; `frozen` samples only refresh their wrench."""
    for k in range(3):
        cos_psi, sin_psi = np.cos(psi[k]), np.sin(psi[k])
        for j in range(cosines.shape[1]):
            g = groove_forces(p, cosines[k, j], sines[k, j], cos_psi, sin_psi, slip[k, j], lean[k, j], root[k, j])
            # where nothing resists, any spin will do and the slip stays zero
            free = 1.0 - frozen[k, j]
            slip[k, j] -= free * g.moment / min(g.moment_slope, -1e-30)
            lean[k, j] += free * (g.trunnion_force - lean[k, j]) / max(1.0 - g.feedback, 0.5)
            across_1, across_2, about_shaft, _ = spider_wrench(p, g, cosines[k, j], sines[k, j])
            wrench[0, k, j] = across_1
            wrench[1, k, j] = across_2
            wrench[2, k, j] = about_shaft


@kernel
def _balance_spider(p, wrench, axis_factor, normal, root):
    """Normal forces from the spider's balance, and with them the contact ellipse, one Newton step a call."""
    for j in range(normal.shape[1]):
        n_0 = wrench[0, 1, j] * wrench[1, 2, j] - wrench[0, 2, j] * wrench[1, 1, j]
        n_1 = wrench[0, 2, j] * wrench[1, 0, j] - wrench[0, 0, j] * wrench[1, 2, j]
        n_2 = wrench[0, 0, j] * wrench[1, 1, j] - wrench[0, 1, j] * wrench[1, 0, j]
        factor = p.torque / (n_0 * wrench[2, 0, j] + n_1 * wrench[2, 1, j] + n_2 * wrench[2, 2, j])
        normal[0, j] = n_0 * factor
        normal[1, j] = n_1 * factor
        normal[2, j] = n_2 * factor
    floor = 1e-3 * abs(p.torque) / p.pitch_radius
    for k in range(3):
        for j in range(normal.shape[1]):
            radius = root[k, j] / axis_factor
            root[k, j] = axis_factor / 3.0 * (2.0 * radius + max(normal[k, j], floor) / (radius * radius))


@kernel
def _unsettled(p, slip, lean, root, before, frozen):
    """Count the samples that moved by more than the tolerance since the last call, and mark them."""
    slip_limit = p.tolerance * p.slip_transition
    lean_limit = p.tolerance * (p.groove_sliding + p.needle_sliding + 1e-12)
    count = 0
    for k in range(3):
        for j in range(slip.shape[1]):
            moved = abs(slip[k, j] - before[0, k, j]) > slip_limit
            moved |= abs(lean[k, j] - before[1, k, j]) > lean_limit
            moved |= abs(root[k, j] - before[2, k, j]) > p.tolerance * root[k, j]
            moved |= not np.isfinite(slip[k, j] + lean[k, j])
            frozen[k, j] = 1.0 if moved else 0.0
            count += moved
            before[0, k, j] = slip[k, j]
            before[1, k, j] = lean[k, j]
            before[2, k, j] = root[k, j]
    return count


@kernel
def _bisect_slip(p, cos_phi, sin_phi, cos_psi, sin_psi, lean, root):
    """Slip at which the moment about the trunnion vanishes; the moment falls with the slip."""
    reach = 1e4 * p.roller_radius * (p.omega + 1e-3)  # skewed needles alone may spin a free roller fast
    low, high = -reach, reach
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if groove_forces(p, cos_phi, sin_phi, cos_psi, sin_psi, middle, lean, root).moment > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _bisect(p, cos_phi, sin_phi, cos_psi, sin_psi, root):
    """Slip and force along the trunnion of one sample, by nested bisection."""
    reach = p.groove_sliding + p.needle_sliding
    low, high = -reach, reach
    for _ in range(_BISECTIONS):
        lean = 0.5 * (low + high)
        slip = _bisect_slip(p, cos_phi, sin_phi, cos_psi, sin_psi, lean, root)
        if groove_forces(p, cos_phi, sin_phi, cos_psi, sin_psi, slip, lean, root).trunnion_force > lean:
            low = lean
        else:
            high = lean
    lean = 0.5 * (low + high)
    return _bisect_slip(p, cos_phi, sin_phi, cos_psi, sin_psi, lean, root), lean


@kernel
def _solve_stubborn(p, cosines, sines, psi, axis_factor, frozen, slip, lean, root, normal, wrench):
    """Solve the samples that relaxation left unsettled, with the spider's balance around them."""
    largest = 0.0
    for _ in range(_OUTER):
        for k in range(3):
            cos_psi, sin_psi = np.cos(psi[k]), np.sin(psi[k])
            for j in range(slip.shape[1]):
                if frozen[k, j] == 1.0:
                    slip[k, j], lean[k, j] = _bisect(p, cosines[k, j], sines[k, j], cos_psi, sin_psi, root[k, j])
        largest = 0.0
        for _ in range(3):
            before = normal.copy()
            _relax(p, cosines, sines, psi, frozen, slip, lean, root, wrench)
            _balance_spider(p, wrench, axis_factor, normal, root)
            largest = np.abs(normal - before).max()
        if largest <= 1e3 * p.tolerance * abs(p.torque) / p.pitch_radius:
            return True
    return False


@kernel
def _account(p, cosines, sines, psi, slip, lean, root, normal, thrust, parts, powers):
    """Thrust of each groove, and at each sample its parts and the power of the five mechanisms and the input shaft."""
    parts[:] = 0.0
    powers[:] = 0.0
    for k in range(3):
        cos_psi, sin_psi = np.cos(psi[k]), np.sin(psi[k])
        for j in range(slip.shape[1]):
            load = normal[k, j]
            g = groove_forces(p, cosines[k, j], sines[k, j], cos_psi, sin_psi, slip[k, j], lean[k, j], root[k, j])
            thrust[k, j] = -load * g.friction_z
            of_each = thrust_of_each(p, g, cosines[k, j], sines[k, j])
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
            powers[5, j] += load * spider_wrench(p, g, cosines[k, j], sines[k, j])[3] * p.omega


@kernel
def _solve_block(table, skews, axis_factors, cosines, sines, thrust, parts, power, residual, extremes, sweeps, settled):
    """Solve every point of a block by itself; arrays as in `Equilibrium`, `table` rows of `PointConstants`."""
    shape = cosines.shape
    slip, lean, root, normal = np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape)
    frozen, before, wrench = np.zeros(shape), np.empty((3, *shape)), np.empty((3, *shape))
    powers = np.empty((6, shape[1]))
    for i in range(table.shape[0]):
        c = table[i]
        p = PointConstants(
            c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9],
            c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17], c[18], c[19],
        )  # fmt: skip
        mean_load = abs(p.torque) / (3.0 * p.pitch_radius)
        if mean_load == 0.0:
            thrust[i] = 0.0
            parts[i] = 0.0
            power[i] = 0.0
            extremes[i, 0], extremes[i, 1], settled[i] = 0.0, 0.0, True
            continue
        slip[:], lean[:], frozen[:], before[:] = 0.0, 0.0, 0.0, np.inf
        root[:] = axis_factors[i] * mean_load ** (1.0 / 3.0)
        normal[:] = mean_load
        count = 1
        while count > 0 and sweeps[i] < _SWEEPS:
            frozen[:] = 0.0
            _relax(p, cosines, sines, skews[i], frozen, slip, lean, root, wrench)
            _balance_spider(p, wrench, axis_factors[i], normal, root)
            count = _unsettled(p, slip, lean, root, before, frozen)
            sweeps[i] += 1
        settled[i] = count == 0 or _solve_stubborn(
            p, cosines, sines, skews[i], axis_factors[i], frozen, slip, lean, root, normal, wrench
        )
        _account(p, cosines, sines, skews[i], slip, lean, root, normal, thrust[i], parts[i], powers)
        for mechanism in range(5):
            power[i, mechanism] = powers[mechanism].mean()
        lost, transmitted = power[i].sum(), abs(p.torque * p.omega)
        if transmitted > 0.0:
            imbalance = powers[5].mean() - p.torque * p.omega - lost
            residual[i] = imbalance / max(lost, _LEAST_LOSS * transmitted)
        extremes[i, 0], extremes[i, 1] = normal.max(), normal.min()


@kernel
def _load_zones(loads, clearances, stiffnesses, counts, kappa, penetration):
    """`contact.bearing_load_zone` for every point."""
    for i in range(loads.size):
        kappa[i], penetration[i] = contact.bearing_load_zone(loads[i], clearances[i], stiffnesses[i], counts[i])


def _groove_angles(samples: int) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine of the rotation angle of every groove, shape (groove, sample)."""
    angle = 2 * np.pi * (np.arange(samples) / samples + np.arange(3)[:, None] / 3)
    return np.cos(angle), np.sin(angle)


def _point_table(points: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Columns of `PointConstants`, and the penetration of the most loaded needle into each of its partners."""
    theta = points["joint_angle_deg"]
    pitch = points["needle_pitch_diameter_mm"] / 2
    bore = pitch + points["needle_diameter_mm"] / 2 + points["bearing_radial_clearance_mm"]
    trunnion = pitch - points["needle_diameter_mm"] / 2
    load = np.abs(points["torque_n_m"]) / (3 * points["pitch_radius_mm"])
    kappa, penetration = np.empty_like(load), np.empty_like(load)
    _load_zones(
        load,
        points["bearing_radial_clearance_mm"],
        points["needle_stiffness"],
        points["needle_count"],
        kappa,
        penetration,
    )
    transition = transition_velocities(points)
    columns = {
        "torque": points["torque_n_m"],
        "omega": points["speed_rpm"],
        "cos_theta": np.cos(theta),
        "sin_theta": np.sin(theta),
        "pitch_radius": points["pitch_radius_mm"],
        "roller_radius": points["roller_radius_mm"],
        "rolling_lever": points["groove_rolling_lever_mm"],
        "bearing_radius": pitch,
        "needle_lever": bore * trunnion / pitch,
        "groove_sliding": points["groove_sliding_friction"],
        "groove_spinning": 0.375 * points["groove_spin_friction"],
        "groove_rolling": points["groove_rolling_friction"],
        "needle_sliding": kappa * points["needle_sliding_friction"],
        "needle_rolling": kappa * points["needle_rolling_friction"],
        "slip_transition": transition.groove_sliding,
        "needle_transition": transition.needle_sliding,
        "roll_transition": transition.groove_rolling,
        "spin_transition": transition.roller_spin,
        "normal_spin_transition": transition.spinning,
        "tolerance": points["relative_tolerance"],
    }
    return np.stack([columns[name] for name in PointConstants._fields], axis=1), penetration


def solve_equilibrium(points: Mapping[str, FloatArray], samples: int) -> Equilibrium:
    """Solve the equilibrium model for a block of points.

    Parameters
    ----------
    points
        Joint parameters in internal units (`parameters.internal_units`) and the contact constants that follow from
        them (`contact.contact_constants`), each of shape (point,).
    samples
        Samples of one revolution.

    Returns
    -------
    Equilibrium

    Notes
    -----
    About 0.2 ms a point at 360 samples; every point is computed by itself, so that its values do not depend on the
    block it is in.
    """
    table, penetration = _point_table(points)
    skews = np.stack([points[f"initial_skew_{k}_deg"] for k in (1, 2, 3)], axis=1)
    cosines, sines = _groove_angles(samples)
    count = table.shape[0]
    thrust, parts = np.empty((count, 3, samples)), np.empty((count, 6, samples))
    power, residual = np.empty((count, 5)), np.zeros(count)
    extremes, sweeps, settled = np.empty((count, 2)), np.zeros(count, np.int64), np.zeros(count, np.bool_)
    axis_factor = points["groove_axis_factor"]
    _solve_block(table, skews, axis_factor, cosines, sines, thrust, parts, power, residual, extremes, sweeps, settled)
    return Equilibrium(thrust, parts, power, residual, extremes[:, 0], extremes[:, 1], penetration, sweeps, settled)
