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
across its axis and transmits friction only along it. It rolls between trunnion (radius r_t) and bore (r_b) with the
skew psi and slips equally on both, in sum w cos psi - s r_e sin psi; virtual power gives the lever r_e = r_b r_t / r_p
with the pitch radius r_p = (r_b + r_t) / 2. The loads of all needles add up to kappa N (`load_zone.bearing_load_zone`),
so on the roller act along and about its trunnion

    P   = -mu_n kappa N cos psi tanh((w cos psi - s r_e sin psi) / (2 v_sn))
    M_t = -mu_rn kappa N r_p tanh(s / s_st) + mu_n kappa N r_e sin psi tanh(the same)

(the rolling resistance mu_r f d_n/2 of every contact adds up to the pitch radius). Two equations a groove and angle:
forces along the trunnion, n t + (f t + P) / N = 0, give a; moments about it give s. The spider's balance (no force
across the shaft, moment T about it, the wrench of all three grooves, friction included) gives the three N. All terms
are proportional to N, except a_H ~ N^(1/3) and kappa, which depends on the mean load |T| / (3 R_p). The thrust on the
housing is the sum of -f_z. The model checks input power = output power + friction power, which holds to rounding.

The usual estimate mu N tanh(v_z sin b / v_st) sin b misses two effects: slip across the groove (sigma R_s w_z) turns
the phase of the third order by 3 atan(R_s / R_p) / 2; the roller's spin on its trunnion, s = v_z / R_s + omega sin b,
is out of phase with its rolling in the groove.

Left out: inertia, the roller's swinging in its groove and its tilt on its trunnion, which `kinetostatic` adds; the
shaft's finite length (the spider's orbit tilts it by e / L, lateral forces turn by R_p / L); how the needles' skew
changes; end stops and contacts between needles. `equilibrium_relaxation` solves the equations; if it does not converge,
`coupled_newton` and `free_rollers` do. If no friction holds a roller's spin, the result is the limit of small friction;
without sliding friction in the grooves there is no thrust.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.derived_constants import load_zone
from tripod_doe.joint.force_balance.contact_results import ContactReader
from tripod_doe.joint.force_balance.coupled_newton import loads_at_rest, settle_together
from tripod_doe.joint.force_balance.equilibrium_relaxation import settle_still
from tripod_doe.joint.force_balance.free_rollers import settle_free
from tripod_doe.joint.force_balance.kinetostatic_relaxation import FRESH, NEAR, settle_moving
from tripod_doe.joint.force_balance.needle_correction import Followers
from tripod_doe.joint.force_balance.point_constants import TILT, YAW, PointConstants
from tripod_doe.joint.force_balance.revolutions import Revolutions
from tripod_doe.joint.force_balance.samples import Memory, repeat_first, start
from tripod_doe.joint.force_balance.thrust_and_power import Solution, account
from tripod_doe.joint.geometry.transition_velocities import transition_velocities
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH
from tripod_doe.mechanics.compilation.first_compilation import first_compilation
from tripod_doe.mechanics.compilation.kernels import kernel

_LITTLE = 1e-6
"""Friction coefficient in place of zero."""
_FOLLOWED = 100.0
"""Factor on the tolerance of the balance before needles move: it is solved again with their motion."""


@dataclass(frozen=True)
class Equilibrium:
    """Solution of a block of points."""

    # axial force on the housing at each groove over one revolution in N, shape (point, groove, sample)
    groove_thrust: FloatArray
    # contribution of each mechanism to their sum in N, shape (point, part, sample); see `thrust_parts`
    thrust_parts: FloatArray
    friction_power: FloatArray  # mean power lost to each mechanism in N mm/s, shape (point, mechanism)
    # input less output less friction power, over the friction power (or a thousandth of the transmitted power, where
    # that is larger), shape (point,)
    energy_residual: FloatArray
    unexplained_power: FloatArray  # input less output less friction power, over the transmitted power, shape (point,)
    # largest_normal_force, smallest_normal_force: of all grooves and angles in N, shape (point,); without slip where no
    # balance settled
    largest_normal_force: FloatArray
    smallest_normal_force: FloatArray
    needle_penetration: FloatArray  # of the most loaded needle into each partner in mm, shape (point,)
    sweeps: IntArray  # relaxation sweeps, and force evaluations of all grooves, shape (point,)
    settled: NDArray[np.bool_]  # whether every sample is balanced within the tolerance, shape (point,)
    # whether the balance converged only without yaw of the rollers, shape (point,)
    upright: NDArray[np.bool_]
    # of the most loaded needle, rad, shape (point, trunnion, cycles sample); None if needles never move
    needle_skew: FloatArray | None = None
    # whether the balance converged with moving needles, shape (point,); else needles keep their skew
    needles_settled: NDArray[np.bool_] | None = None
    revolutions: Revolutions | None = None  # single ones; None if needles never move


@kernel
def _load_zones(loads, clearances, stiffnesses, counts, kappa, penetration):
    """`load_zone.bearing_load_zone` for every point."""
    for i in range(loads.size):
        kappa[i], penetration[i] = load_zone.bearing_load_zone(loads[i], clearances[i], stiffnesses[i], counts[i])


def load_zones(points: JointValues[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """`load_zone.bearing_load_zone` of straight needles for every point, each of shape (point,)."""
    load = points.groove_load
    kappa, penetration = np.empty_like(load), np.empty_like(load)
    _load_zones(load, points.bearing_radial_clearance, points.needle_stiffness, points.needle_count, kappa, penetration)
    return kappa, penetration


def _groove_angles(samples: int) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine of every groove's rotation angle, shape (groove, eights, 8), padded with the first samples."""
    sample = np.arange(-(-samples // WIDTH) * WIDTH) % samples
    angle = 2 * np.pi * (sample / samples + np.arange(3)[:, None] / 3)
    return np.cos(angle).reshape(3, -1, WIDTH), np.sin(angle).reshape(3, -1, WIDTH)


def _never_free(points: JointValues[FloatArray]) -> FloatArray:
    """Rolling friction of the needles, at least `_LITTLE` if the grooves have no sliding friction.

    Then nothing else may hold a roller's spin: the result is the limit of small friction.
    """
    free = points.groove_sliding_friction == 0.0
    return np.maximum(_passed_on(points), np.where(free, _LITTLE, 0.0))


def _passed_on(points: JointValues[FloatArray]) -> FloatArray:
    """Rolling friction that needles transmit: only sliding friction makes them roll; without it they slide."""
    passed: FloatArray = np.minimum(points.needle_rolling_friction, points.needle_sliding_friction)
    return passed


def point_constants(points: JointValues[FloatArray], kappa: FloatArray) -> dict[str, FloatArray]:
    """Columns of `PointConstants` for a massless joint with rollers on the axes of their grooves.

    Parameters
    ----------
    points
        As for `solve_equilibrium`.
    kappa
        Sum of the needle loads over the bearing load, shape (point,).

    Returns
    -------
    dict
        Each of shape (point,).
    """
    theta = points.joint_angle
    transition = transition_velocities(points)
    columns = {
        "torque": points.torque,
        "omega": points.speed,
        "cos_theta": np.cos(theta),
        "sin_theta": np.sin(theta),
        "pitch_radius": points.pitch_radius,
        "roller_radius": points.roller_radius,
        "rolling_lever": points.groove_rolling_lever,
        "bearing_radius": points.bearing_radius,
        "needle_lever": points.bore_radius * points.trunnion_radius / points.bearing_radius,
        "groove_friction": points.groove_sliding_friction,
        "spinning_friction": 0.375 * points.groove_spin_friction,
        "groove_resistance": points.groove_rolling_friction,
        "needle_friction": kappa * points.needle_sliding_friction,
        "needle_resistance": kappa * _never_free(points),
        "slip_transition": transition.groove_slip,
        "needle_transition": transition.needle_slip,
        "roll_transition": transition.groove_roll,
        "spin_transition": transition.roller_spin,
        "normal_spin_transition": transition.groove_spin,
        "axis_factor": points.groove_axis_factor,
        "tolerance": points.relative_tolerance,
    }
    return {name: np.zeros_like(theta) for name in PointConstants._fields} | columns


@cache
def _compile_other_ways() -> None:
    """Compile the solvers for points that do not relax, once per process: most studies do not need them."""
    row, memory = np.ones(len(PointConstants._fields)), Memory.for_samples(WIDTH)
    with first_compilation("joints that do not relax", seconds=12):
        for settle in (settle_together, settle_free):  # any point will do: only number types matter
            start(row, np.zeros(3), *_groove_angles(WIDTH), memory)
            settle(row, memory)
        repeat_first(memory)  # which only a converged point reaches


def solve_equilibrium(
    points: JointValues[FloatArray], samples: int, reader: ContactReader | None = None
) -> Equilibrium:
    """Solve the equilibrium model for a block of points.

    Parameters
    ----------
    points
        The points.
    samples
        Samples of one revolution.
    reader
        Reads the contacts of every point that settles.

    Returns
    -------
    Equilibrium

    Notes
    -----
    Every point is computed alone, so that its values do not depend on its block.
    """
    kappa, penetration = load_zones(points)
    return solve_balance(points, point_constants(points, kappa), penetration, samples, reader=reader)


def _settle(
    row: FloatArray, skews: FloatArray, cosines: FloatArray, sines: FloatArray, memory: Memory, tolerance: float
) -> tuple[bool, int, tuple[float, float]]:
    """Solve a balance from its start; returns convergence, iterations, and extreme normal forces over their mean.

    The extremes hold without slip; they are zero if the balance converges at once.
    """
    p = PointConstants(*row)
    start(row, skews, cosines, sines, memory)
    settled, work = settle_still(row, memory) if p.pace == 0.0 else settle_moving(row, memory, tolerance, FRESH)
    if settled:
        return settled, work, (0.0, 0.0)
    _compile_other_ways()
    start(row, skews, cosines, sines, memory)
    loads = loads_at_rest(row, memory)
    if loads.min() >= -p.groove_friction:  # friction moves loads, but not by more
        start(row, skews, cosines, sines, memory)
        free = p.pace == 0.0 and p.groove_friction == 0.0
        settled, iterations = (settle_free if free else settle_together)(row, memory)
        work += iterations
    return settled, work, (loads.max(), loads.min())


def _settle_with_needles(row: FloatArray, memory: Memory, followers: Followers, i: int) -> int:
    """Let the needles of point i follow its rollers, and solve the balance with them; returns iterations.

    If this does not converge, restore the balance in which needles keep their skew.
    """
    memory.kept[:] = memory.state
    turns, tilt = memory.turns.copy(), row[TILT]
    followers.follow(row, memory, i)
    tolerance = PointConstants(*row).tolerance
    if PointConstants(*row).groove_friction == 0.0:  # nothing passes the grooves
        memory.state[:], memory.turns[:], row[TILT] = memory.kept, turns, tilt
        return 0
    settled, work = settle_moving(row, memory, tolerance, NEAR)
    if not settled:
        _compile_other_ways()
        settled, iterations = settle_together(row, memory)
        work += iterations
    if not settled:
        memory.state[:], memory.turns[:], row[TILT] = memory.kept, turns, tilt
        followers.keep(i)
        if not settle_moving(row, memory, tolerance, NEAR)[0]:
            memory.state[:] = memory.kept
    return int(work)


def solve_balance(
    points: JointValues[FloatArray],
    columns: Mapping[str, FloatArray],
    penetration: FloatArray,
    samples: int,
    followers: Followers | None = None,
    reader: ContactReader | None = None,
    revolutions: Revolutions | None = None,
) -> Equilibrium:
    """Solve the balance of a block of points with given constants; other parameters as for `solve_equilibrium`.

    `followers` are the needles of a balance in which rollers tilt and needles may move, `revolutions` receives the
    thrust of single ones.
    """
    table = np.stack([columns[name] for name in PointConstants._fields], axis=1)
    skews, mean_loads = np.stack(points.initial_skews, axis=1), points.groove_load
    cosines, sines = _groove_angles(samples)
    memory, solution = Memory.for_samples(samples), Solution.of_nothing(table.shape[0], samples)
    upright = np.zeros(table.shape[0], bool)
    for i in np.flatnonzero(columns["torque"] != 0.0).tolist():
        slides = followers is not None and followers.slide[i]
        follows = slides and points.groove_sliding_friction[i] > 0.0  # else nothing passes the grooves
        settle = partial(
            _settle,
            skews=skews[i],
            cosines=cosines,
            sines=sines,
            memory=memory,
            tolerance=points.relative_tolerance[i] * (_FOLLOWED if follows else 1.0),
        )
        solution.settled[i], solution.sweeps[i], (most, least) = settle(table[i])
        lifts_off = least < -points.groove_sliding_friction[i]
        yaws = columns["yaw"][i] * columns["spinning_friction"][i] * columns["groove_friction"][i] > 0.0
        if not (solution.settled[i] or lifts_off) and yaws:
            table[i, YAW] = 0.0
            solution.settled[i], iterations, (most, least) = settle(table[i])
            solution.sweeps[i], upright[i] = solution.sweeps[i] + iterations, solution.settled[i]
        solution.extremes[i] = most * mean_loads[i], least * mean_loads[i]
        if solution.settled[i] and followers is not None and slides:
            solution.sweeps[i] += _settle_with_needles(table[i], memory, followers, i)
        if solution.settled[i]:
            account(table[i], memory, solution, i)
            if reader is not None:
                reader.read(i, table[i], memory, followers)
            if followers is not None and revolutions is not None:
                mean = solution.thrust[i].reshape(3, -1)[:, :samples]
                if followers.moves(i):
                    revolutions.follow(i, table[i], memory, followers, mean)
                else:
                    revolutions.all_alike(i, mean)
    solution.settled[columns["torque"] == 0.0] = True
    solution.power[_passed_on(points) == 0.0, 4] = 0.0  # friction in place of zero takes no power
    thrust, parts = (sums.reshape(*sums.shape[:2], -1)[..., :samples] for sums in (solution.thrust, solution.parts))
    largest, smallest = solution.extremes.T
    return Equilibrium(
        thrust,
        parts,
        solution.power,
        solution.residual,
        solution.unexplained,
        largest,
        smallest,
        penetration,
        solution.sweeps,
        solution.settled,
        upright,
        *((followers.skews, followers.settled, revolutions) if followers else ()),
    )
