"""Ideal kinematics of the tripod joint: three trunnion axes through three groove axes, exactly and in closed form.

The input axis is Z and points to the intermediate shaft, whose axis d = (sin theta, 0, cos theta) keeps its direction
(the shaft is long against the spider's orbit). Groove k is at phi_k = phi + (k - 1) 120 deg about Z; at phi_k = 0
its roller lies in the plane of both axes, between them. In the spider's plane, with the base e_1 = (cos theta, 0,
-sin theta), e_2 = Y and complex numbers, the groove axes pierce the plane at

    p_k = (R_p + e) exp(i phi_k) + e exp(-i phi_k),    e = R_p (1 / cos theta - 1) / 2.

The three trunnions meet in one point at 120 deg from each other if the spider turns exactly with phi (the joint is
homokinetic in this limit) and its centre is at -e exp(3 i phi): it orbits at three times the shaft's speed. Hence

    roller on its trunnion    r   = R_p + e + 2 e cos 2 phi_k,   plunging with w = -4 e omega sin 2 phi_k
    roller along its groove   z   = -R_p tan theta cos phi_k,    moving with v_z = R_p omega tan theta sin phi_k
    trunnion axis             t   = (1 - (1 - cos theta) cos^2 phi_k, (1 - cos theta) sin phi_k cos phi_k,
                                     -sin theta cos phi_k)
    spider against housing    w_0 = omega (sin theta cos phi_k, -sin theta sin phi_k, -(1 - cos theta))

in the groove's frame (e_r, e_theta, e_z): radially outward, along the rotation, along the input axis.
"""

from __future__ import annotations

from typing import NamedTuple

from tripod_doe.mechanics.compilation.kernels import inlined_kernel


class IdealMotion(NamedTuple):
    """Ideal motion of one roller in its groove's frame; lengths in mm, velocities in mm/s and rad/s."""

    along_groove: float  # velocity of the roller's centre along the groove, v_z
    along_trunnion: float  # velocity of the roller on its trunnion, w, positive outward
    distance: float  # distance r of the roller's centre from the spider's centre
    # t_r, t_t, t_z: direction of the trunnion axis, outward
    t_r: float
    t_t: float
    t_z: float
    # w_r, w_t, w_z: angular velocity of the spider relative to the housing
    w_r: float
    w_t: float
    w_z: float


@inlined_kernel
def ideal_motion(cos_phi, sin_phi, cos_theta, sin_theta, pitch_radius, omega):
    """Ideal motion of the roller whose groove is at the rotation angle phi_k.

    Args:
        cos_phi, sin_phi: Of the groove's rotation angle.
        cos_theta, sin_theta: Of the joint angle.
        pitch_radius: R_p in mm.
        omega: Speed of the housing in rad/s.

    Returns:
        See the module's documentation for the formulas.
    """
    versine = 1.0 - cos_theta
    eccentricity = 0.5 * pitch_radius * versine / cos_theta
    sin_two_phi = 2.0 * sin_phi * cos_phi
    return IdealMotion(
        pitch_radius * omega * sin_theta / cos_theta * sin_phi,
        -4.0 * eccentricity * omega * sin_two_phi,
        pitch_radius + eccentricity + 2.0 * eccentricity * (2.0 * cos_phi * cos_phi - 1.0),
        1.0 - versine * cos_phi * cos_phi,
        versine * sin_phi * cos_phi,
        -sin_theta * cos_phi,
        omega * sin_theta * cos_phi,
        -omega * sin_theta * sin_phi,
        -omega * versine,
    )
