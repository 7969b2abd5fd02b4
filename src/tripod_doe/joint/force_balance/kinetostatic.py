"""The kinetostatic model: the balance of `equilibrium` with inertia along the ideal motion and compliant rollers.

Most effects that the equilibrium omits and the multibody models show need no time integration, because the motion is
almost known. With the symbols and the frame of `equilibrium`, and m_r, I_t of a roller:

Inertia (d'Alembert). A roller turns with the housing at the distance R_p and moves along its groove, so that

    m_r R_p omega^2 (e_r - tan theta cos phi e_z)

is added to its forces. About the trunnion its angular momentum is I_t s, since the spider itself does not turn about a
trunnion: the moment balance gets -I_t ds/dt. The intermediate shaft is a rod that hangs on its outboard end; at the
spider it acts as the mass m_s = m / 3, which orbits on the radius e at three times the speed: 9 m_s omega^2 c across
the shaft, at the spider's centre c = -e exp(3 i phi).

Swing. A roller's centre stays at the distance rho = R_g - R_s + d_g from its groove's axis (d_g: Hertz penetration at
the mean load). It is on the contact's side, at -rho n, so that it moves by -sigma rho da/dt tau while the contact angle
a changes. That is slip across the groove, and slides the roller on its trunnion. At small joint angles the whole slip
path is a few swings long: at 5 deg this turns the phase of the third order by 20 deg and takes some per cent off it, at
2 deg a third of it.

Tilt. Loads off the middle of the needles tilt the roller about e_z: friction across the groove at the lever R_s, and
the normal force at the lever r - r_m of its plunging. A load at x from the middle of the needles tilts the roller by
k_t x (`turned_bearing`: under light load a crown makes that ten times as much), so that the slip across the
groove gets

    R_s k_t d(r - r_m + R_s f_t / N) / dt,

where the contact angle balances the friction f_t along the trunnion, needles included. k_t belongs to the largest x of
a revolution, at first e + R_s mu_s + r_p mu_n, then the motion's; at most 0.35 l. The bore slides
along its needles by r_p / R_s of that slip, too. Needles that move change x: their friction acts at their pitch circle,
since a needle between two frictions tilts itself, and their middle moves along (`needle_correction`).

Yaw. The spinning moment M_s turns the roller about its normal by y = k_y M_s / N, against its needles. So its axis of
rotation leaves the trunnion, and t_z of the trunnion becomes t_z - sigma t_tau y in all effects of the roller's spin:
yaw steers the roller. M_s is computed from w_n + dy/dt of a roller that rolls upright, without slip, under the mean
load. k_y belongs to the full moment (`turned_bearing`), since crowned needles stiffen with growing yaw, with the load
at its mean distance from the middle of the needles. Crowned needles let rollers yaw by some per cent of the joint
angle, straight ones by a thousandth.

Lag. Trunnions stay behind their grooves by the angle (rho + bearing clearance + needle penetrations) / R_p: everything
happens later in the rotation by this angle.

Needles. A needle follows half of the roller's plunging until flange or retainer stops it; there it rubs, and its skew
changes. `needle_motion` moves the needles with the motion of the balance; `needle_correction` adds their forces to the
balance, which is solved again.

ds/dt and da/dt are backward differences of second order around the revolution (`kinetostatic_relaxation`, and
`coupled_newton` where that does not settle). The balance of powers closes to about half a per cent of the friction
power only, to 10 % with much friction or little motion: the model omits the small motion of the spider under swinging
and tilting rollers, the mass of the needles, and all other effects that the equilibrium omits except the motion of the
needles.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.derived_constants.roller_inertia import roller_inertia
from tripod_doe.joint.force_balance.contact_results import ContactReader
from tripod_doe.joint.force_balance.equilibrium import Equilibrium, point_constants, solve_balance
from tripod_doe.joint.force_balance.needle_correction import Followers
from tripod_doe.joint.force_balance.revolutions import Revolutions
from tripod_doe.joint.massless_needles.bearing_tilt import NeedleRow, turned_bearing
from tripod_doe.joint.massless_needles.load_along_needle import FARTHEST
from tripod_doe.joint.massless_needles.needle_constants import needle_constants
from tripod_doe.joint.outputs import BY_CYCLE
from tripod_doe.joint.values import JointValues

_ON_AVERAGE = 2 / math.pi
"""Mean over largest distance of an oscillating load from the middle of the needles."""


def _turned_bearings(points: JointValues[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sum of the needle loads over the bearing load, shift in mm, k_t and k_y in rad/mm, each of shape (point,)."""
    eccentricity = points.pitch_radius * (1 / np.cos(points.joint_angle) - 1) / 2
    swung = (
        points.roller_radius * points.groove_sliding_friction + points.bearing_radius * points.needle_sliding_friction
    )
    farthest = FARTHEST * points.needle_length
    offset = np.clip(eccentricity + swung, 0.01 * farthest, farthest)
    spinning = 0.375 * points.groove_spin_friction * points.groove_axis_factor * points.groove_load ** (1 / 3)
    kappa, shift, tilt, _ = _turned(points, offset, 0.0 * spinning)
    yaw = _turned(points, _ON_AVERAGE * offset, spinning)[3]
    return kappa, shift, tilt / offset, yaw / np.maximum(spinning, 1e-300)


def _turned(points: JointValues[FloatArray], offset: FloatArray, lever: FloatArray) -> FloatArray:
    """`turned_bearing` for every point, shape (4, point); the moment is the load's at a lever."""
    load = points.groove_load
    needles = (
        points.bearing_radial_clearance,
        points.needle_stiffness,
        points.needle_count,
        points.needle_length,
        points.spheres_per_needle,
        points.needle_crown,
    )
    loads = np.column_stack([load, offset, load * lever])
    rows = map(NeedleRow._make, np.column_stack(needles))
    return np.array([turned_bearing(*each, row) for each, row in zip(loads, rows, strict=True)]).reshape(-1, 4).T


def _moving_constants(
    points: JointValues[FloatArray], shift: FloatArray, tilt: FloatArray, yaw: FloatArray, samples: int
) -> dict[str, FloatArray]:
    """Columns of `PointConstants` that are zero in the equilibrium model."""
    radius = points.roller_radius
    mass, polar, _ = roller_inertia(radius, points.roller_width, points.bore_radius, points.density)
    play = points.groove_play + (points.groove_load / points.groove_stiffness) ** (2 / 3)
    return {
        "roller_mass": mass,
        "roller_inertia": polar,
        "shaft_mass": points.shaft_mass / 3,
        "play": play,
        "tilt": radius * tilt,
        "yaw": yaw,
        "lag": np.sign(points.torque) * (play + shift) / points.pitch_radius,
        "pace": points.speed * samples / (2 * np.pi),
    }


def solve_kinetostatic(
    points: JointValues[FloatArray],
    samples: int,
    needles_move: bool = True,
    reader: ContactReader | None = None,
    names: Collection[str] = (),
) -> Equilibrium:
    """Solve the kinetostatic model for a block of points.

    Parameters
    ----------
    points
        As for `equilibrium.solve_equilibrium`.
    samples
        Samples of one revolution; they are its time steps, too: 90 cost 0.1 % of the third order, 360 a hundredth.
    needles_move
        Whether needles follow their rollers; if not, they keep their initial skew and touch no stop, as in the model
        `rollers`.
    reader
        Reads the contacts of every point that settles.
    names
        Outputs of `CYCLE_OUTPUTS` that are wanted.

    Returns
    -------
    Equilibrium
        Of the mean of the last two revolutions, over which the needles' skew still changes.
    """
    kappa, shift, tilt, yaw = _turned_bearings(points)
    columns = point_constants(points, kappa) | _moving_constants(points, shift, tilt, yaw, samples)
    penetration = (shift - points.bearing_radial_clearance) / 2
    skews = np.stack(points.initial_skews, axis=1)
    record = reader is not None and reader.of_needles
    count = int(points.cycles[0]) if BY_CYCLE in names else 2
    followers = Followers.of(points, needle_constants(points), skews, samples, needles_move, count, record)
    revolutions = Revolutions.of(points.torque.size, count, samples, names)
    return solve_balance(points, columns, penetration, samples, followers, reader, revolutions)
