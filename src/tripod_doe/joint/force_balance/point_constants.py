"""Constants of one point as the kernels of both balances read them."""

from __future__ import annotations

from typing import NamedTuple

from numba.np.unsafe.ndarray import to_fixed_tuple

from tripod_doe.mechanics.compilation.kernels import inlined_kernel


class PointConstants(NamedTuple):
    """Constants of one point in internal units; the columns of the table that the kernel reads."""

    # torque, omega: load torque in N mm, speed in rad/s
    torque: float
    omega: float
    # cos_theta, sin_theta: of the joint angle
    cos_theta: float
    sin_theta: float
    # pitch_radius, roller_radius, rolling_lever: R_p, R_s and D/2 of the rolling resistance in the groove, mm
    pitch_radius: float
    roller_radius: float
    rolling_lever: float
    # bearing_radius, needle_lever: pitch radius r_p of the needles and lever r_e of their sliding friction, mm
    bearing_radius: float
    needle_lever: float
    # groove_friction, spinning_friction, groove_resistance: mu_s, (3/8) mu_s of the spinning moment, mu_r
    groove_friction: float
    spinning_friction: float
    groove_resistance: float
    # needle_friction, needle_resistance: kappa mu_n and kappa mu_rn
    needle_friction: float
    needle_resistance: float
    # slip_transition, needle_transition: v_st in mm/s
    slip_transition: float
    needle_transition: float
    # roll_transition, spin_transition, normal_spin_transition: transition angular velocities of rolling in the groove,
    # turning on the trunnion and spinning, rad/s
    roll_transition: float
    spin_transition: float
    normal_spin_transition: float
    axis_factor: float  # a_H over the cube root of N, mm / N^(1/3)
    # roller_mass, roller_inertia, shaft_mass: m_r and I_t of a roller, m_s of the shaft as felt at the spider, t and t
    # mm2; zero in a massless joint
    roller_mass: float
    roller_inertia: float
    shaft_mass: float
    # play, tilt, yaw: rho in mm, R_s k_t and k_y in rad/mm of `kinetostatic`; zero if rollers neither swing nor tilt
    # nor yaw
    play: float
    tilt: float
    yaw: float
    lag: float  # angle in rad by which the trunnions stay behind their grooves
    pace: float  # samples a second; zero if samples are independent
    tolerance: float  # relative tolerance of all iterations


_COUNT = len(PointConstants._fields)
TRANSITIONS = tuple(at for at, name in enumerate(PointConstants._fields) if name.endswith("_transition"))
"""Columns of the transition velocities."""
TILT, YAW = (PointConstants._fields.index(name) for name in ("tilt", "yaw"))
"""Columns that change with the motion."""


@inlined_kernel
def point_constants_of(row):
    """The constants in a row of their table."""
    return PointConstants(*to_fixed_tuple(row, _COUNT))


@inlined_kernel
def flank(p):
    """Sign of the torque: which flank of the grooves is loaded."""
    return 1.0 if p.torque >= 0.0 else -1.0


@inlined_kernel
def mean_load(p):
    """Mean normal force at a groove, |T| / (3 R_p)."""
    return abs(p.torque) / (3.0 * p.pitch_radius)
