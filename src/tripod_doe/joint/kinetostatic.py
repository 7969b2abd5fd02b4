"""The kinetostatic model: the balance of `equilibrium`, with inertia along the ideal motion and rollers that give way.

What the equilibrium leaves out and the multibody models show can mostly be had without integrating anything, because
the motion is all but known. With the symbols and the frame of `equilibrium`, and m_r, I_t of a roller:

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
the normal force at the lever r - r_m of its plunging. The needles, as lines of length l with the bearing's stiffness K
along the load, hold against it with K l^2 / 12, so that with k_t = 12 N / (K l^2) the slip across the groove gets

    R_s k_t d(r - r_m + R_s f_t / N) / dt,

where the friction f_t along the trunnion, needles included, is what the contact angle balances.

Lag. Trunnions stay behind their grooves by rho, the bearing's clearance and the needles' penetrations together, over
R_p: all happens that much later in the rotation.

ds/dt and da/dt are backward differences of second order around the revolution (`moving_relaxation`, and
`coupled_balance` where that does not settle). The balance of powers closes to about half a per cent of the friction
power only, to 10 % with much friction or little motion: that the spider gives way a little to swinging and tilting
rollers is left out, as is all else that the equilibrium leaves out; and the mass of the needles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint import contact
from tripod_doe.joint.equilibrium import Equilibrium, point_constants, solve_balance
from tripod_doe.joint.roller_inertia import roller_inertia
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.compilation import kernel

__all__ = ["solve_kinetostatic"]

FloatArray = NDArray[np.float64]


@kernel
def _bearing_stiffnesses(penetrations, clearances, stiffnesses, counts, out):
    """`contact.bearing_stiffness` for every point."""
    for i in range(out.size):
        out[i] = contact.bearing_stiffness(penetrations[i], clearances[i], stiffnesses[i], counts[i])


def _moving_constants(points: JointValues[FloatArray], penetration: FloatArray, samples: int) -> dict[str, FloatArray]:
    """The columns of `PointConstants` that are zero in the equilibrium."""
    radius, load, clearance = points.roller_radius, points.groove_load, points.bearing_radial_clearance
    mass, polar, _ = roller_inertia(radius, points.roller_width, points.bore_radius, points.density)
    stiffness = np.empty_like(load)
    _bearing_stiffnesses(penetration, clearance, points.needle_stiffness, points.needle_count, stiffness)
    play = points.groove_play + (load / points.groove_stiffness) ** (2 / 3)
    return {
        "roller_mass": mass,
        "roller_inertia": polar,
        "shaft_mass": points.shaft_mass / 3,
        "play": play,
        "tilt": 12 * radius * load / (stiffness * points.needle_length**2),
        "lag": np.sign(points.torque) * (play + clearance + 2 * penetration) / points.pitch_radius,
        "pace": points.speed * samples / (2 * np.pi),
    }


def solve_kinetostatic(points: JointValues[FloatArray], samples: int) -> Equilibrium:
    """Solve the kinetostatic model for a block of points.

    Parameters
    ----------
    points
        As for `equilibrium.solve_equilibrium`.
    samples
        Samples of one revolution; they are its time steps, too: 90 cost 0.1 % of the third order, 360 a hundredth.

    Returns
    -------
    Equilibrium
    """
    columns, penetration = point_constants(points)
    return solve_balance(points, columns | _moving_constants(points, penetration, samples), penetration, samples)
