"""Forces of one roller between its groove and its trunnion, over the normal force.

Derived in `equilibrium`, and in `kinetostatic` what mass and motion between samples add.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tripod_doe.joint.kinematics import ideal_motion
from tripod_doe.mechanics.compilation import inlined_kernel
from tripod_doe.mechanics.laws import hyperbolic_tangent

__all__ = [
    "GrooveForces",
    "PointConstants",
    "groove_forces",
    "inertial_force",
    "spider_load",
    "spider_wrench",
    "thrust_of_each",
]


class PointConstants(NamedTuple):
    """Constants of one point in internal units; the columns of the table that the kernel reads.

    Attributes
    ----------
    torque, omega
        Load torque in N mm, speed in rad/s.
    cos_theta, sin_theta
        Of the joint angle.
    pitch_radius, roller_radius, rolling_lever
        R_p, R_s and D/2 of the rolling resistance in the groove, mm.
    bearing_radius, needle_lever
        Pitch radius r_p of the needles and lever r_e of their sliding friction, mm.
    groove_sliding, groove_spinning, groove_rolling
        mu_s, (3/8) mu_s of the spinning moment, mu_r.
    needle_sliding, needle_rolling
        kappa mu_n and kappa mu_rn.
    slip_transition, needle_transition
        v_st in mm/s.
    roll_transition, spin_transition, normal_spin_transition
        Transition angular velocities of rolling in the groove, turning on the trunnion and spinning, rad/s.
    axis_factor
        a_H over the cube root of N, mm / N^(1/3).
    roller_mass, roller_inertia, shaft_mass
        m_r and I_t of a roller, m_s of the shaft as felt at the spider, t and t mm2; zero in a massless joint.
    play, tilt
        rho in mm and R_s k_t of `kinetostatic`; zero if rollers neither swing nor tilt.
    lag
        Angle in rad by which the trunnions stay behind their grooves.
    pace
        Samples a second; zero if nothing that changes between samples matters.
    tolerance
        Relative tolerance of all iterations.
    """

    torque: float
    omega: float
    cos_theta: float
    sin_theta: float
    pitch_radius: float
    roller_radius: float
    rolling_lever: float
    bearing_radius: float
    needle_lever: float
    groove_sliding: float
    groove_spinning: float
    groove_rolling: float
    needle_sliding: float
    needle_rolling: float
    slip_transition: float
    needle_transition: float
    roll_transition: float
    spin_transition: float
    normal_spin_transition: float
    axis_factor: float
    roller_mass: float
    roller_inertia: float
    shaft_mass: float
    play: float
    tilt: float
    lag: float
    pace: float
    tolerance: float


class GrooveForces(NamedTuple):
    """One roller in its groove at one rotation angle; forces, moments (mm) and powers (mm/s) over the normal force N.

    Attributes
    ----------
    moment, moment_slope
        About the trunnion, and its derivative for the slip.
    trunnion_force
        (f t + P) / N, which the leaning normal must balance.
    feedback
        Derivative of the trunnion force for the force that the contact angle was made from.
    sin_a, cos_a
        Of the contact angle.
    friction_tau, friction_z
        Sliding friction across and along the groove.
    moment_n, moment_tau, moment_z
        Spinning moment, and rolling resistance across and along the groove.
    sliding_power, spinning_power, rolling_power, needle_sliding_power, needle_rolling_power
        Lost to each mechanism.
    needle_sliding_moment, needle_rolling_moment
        Of the needles about the trunnion.
    spin, spin_gain
        Of the roller on its trunnion in rad/s, and its derivative for the slip.
    inertia_gain
        Derivative of the moment for the spin of earlier samples.
    tilt_gain
        Derivative of sin_a for the force that the contact angle was made from.
    swing_gain
        Derivative of the trunnion force for those of earlier samples.
    """

    moment: float
    moment_slope: float
    trunnion_force: float
    feedback: float
    sin_a: float
    cos_a: float
    friction_tau: float
    friction_z: float
    moment_n: float
    moment_tau: float
    moment_z: float
    sliding_power: float
    spinning_power: float
    rolling_power: float
    needle_sliding_power: float
    needle_rolling_power: float
    needle_sliding_moment: float
    needle_rolling_moment: float
    spin: float
    spin_gain: float
    inertia_gain: float
    tilt_gain: float
    swing_gain: float


@inlined_kernel
def inertial_force(p, cos_phi):
    """Inertial force of a roller in N, radially outward and along the groove."""
    centrifugal = p.roller_mass * p.pitch_radius * p.omega * p.omega
    return centrifugal, -centrifugal * p.sin_theta / p.cos_theta * cos_phi


@inlined_kernel
def spider_load(p, cos_phi, sin_phi):
    """What the inertia of one roller and a third of the shaft does to the spider.

    Two forces across the shaft in N, and the moment about the shaft in N mm.
    """
    m = ideal_motion(cos_phi, sin_phi, p.cos_theta, p.sin_theta, p.pitch_radius, p.omega)
    outward, along = inertial_force(p, cos_phi)
    about_r = m.distance * m.t_t * along
    about_t = m.distance * (m.t_z * outward - m.t_r * along)
    about_z = -m.distance * m.t_t * outward
    eccentricity = 0.5 * p.pitch_radius * (1.0 - p.cos_theta) / p.cos_theta
    orbit = -3.0 * p.shaft_mass * p.omega * p.omega * eccentricity
    cos_three_phi, sin_three_phi = (4.0 * cos_phi**2 - 3.0) * cos_phi, (3.0 - 4.0 * sin_phi**2) * sin_phi
    return (
        outward * cos_phi * p.cos_theta - along * p.sin_theta + orbit * cos_three_phi,
        outward * sin_phi + orbit * sin_three_phi,
        (about_r * cos_phi - about_t * sin_phi) * p.sin_theta + about_z * p.cos_theta,
    )


@inlined_kernel
def groove_forces(p, cos_phi, sin_phi, cos_psi, sin_psi, slip, lean, load_root, past_tilt, past_spin, newton):
    """Forces of one roller for a trial slip along the rolling direction and a trial force along the trunnion.

    `slip` is v along dv/ds in mm/s, `lean` the trial of (f t + P) / N, `load_root` the a_H that goes with N.
    `past_tilt` and `past_spin` are what earlier samples add to the backward differences of sin a and of the spin.
    Slopes of friction are tangents with `newton` = 1, secants with 0.
    """
    m = ideal_motion(cos_phi, sin_phi, p.cos_theta, p.sin_theta, p.pitch_radius, p.omega)
    sigma = 1.0 if p.torque >= 0.0 else -1.0
    arm = sigma * p.roller_radius
    # contact angle: the normal carries what friction leaves along the trunnion
    length = np.sqrt(m.t_r * m.t_r + m.t_t * m.t_t)
    sin_sum = min(max(-sigma * lean / length, -0.999), 0.999)
    cos_sum = np.sqrt(1.0 - sin_sum * sin_sum)
    sin_a = (sin_sum * m.t_r - cos_sum * m.t_t) / length
    cos_a = (cos_sum * m.t_r + sin_sum * m.t_t) / length
    t_tau = cos_a * m.t_r - sin_a * m.t_t
    t_n = sin_a * m.t_r + cos_a * m.t_t
    # as its contact wanders round the groove the roller swings, and so slides on its trunnion, and tilts on it
    leaning = -sigma * p.pace * (1.5 * sin_a + past_tilt) / cos_a
    plunge = p.play * leaning / t_tau
    swing = (p.play + p.tilt * p.roller_radius) * leaning + p.tilt * m.along_trunnion
    swinging = (p.play + p.tilt * p.roller_radius) * p.pace / (cos_sum * length)
    # slip is linear in the roller's spin s: v = v_0 + s v_1
    tau_0 = arm * m.w_z + swing
    z_0 = m.along_groove - arm * (cos_a * m.w_r - sin_a * m.w_t) + plunge * m.t_z
    tau_1, z_1 = arm * m.t_z, -arm * t_tau
    rate = np.sqrt(tau_1 * tau_1 + z_1 * z_1)
    spin = (slip - (tau_0 * tau_1 + z_0 * z_1) / rate) / rate
    v_tau, v_z = tau_0 + spin * tau_1, z_0 + spin * z_1
    speed = np.sqrt(v_tau * v_tau + v_z * v_z) + 1e-290
    sliding = hyperbolic_tangent(speed / p.slip_transition)
    drag = p.groove_sliding * sliding / speed
    drag_slope = p.groove_sliding * (1.0 - sliding * sliding) / p.slip_transition - drag
    f_tau, f_z = -drag * v_tau, -drag * v_z
    # relative angular velocity: rolling in the tangent plane, spinning about the normal
    w_tau = cos_a * m.w_r - sin_a * m.w_t + spin * t_tau
    w_n = sin_a * m.w_r + cos_a * m.w_t + spin * t_n
    w_z = m.w_z + spin * m.t_z
    roll = np.sqrt(w_tau * w_tau + w_z * w_z) + 1e-290
    rolling = p.groove_rolling * p.rolling_lever * hyperbolic_tangent(roll / p.roll_transition) / roll
    spinning = p.groove_spinning * load_root * hyperbolic_tangent(w_n / p.normal_spin_transition)
    # needles: friction along their axes, rolling resistance about the trunnion
    needle_slip = (m.along_trunnion + plunge) * cos_psi - spin * p.needle_lever * sin_psi
    needle_sliding = hyperbolic_tangent(0.5 * needle_slip / p.needle_transition)
    needle_rolling = hyperbolic_tangent(spin / p.spin_transition)
    needle_moment = p.needle_sliding * p.needle_lever * sin_psi * needle_sliding
    bearing_moment = p.needle_rolling * p.bearing_radius * needle_rolling
    along = w_tau * t_tau + w_z * m.t_z
    load = (load_root / p.axis_factor) ** 3
    inertia = p.roller_inertia * p.pace / load
    moment = -drag * slip * rate - spinning * t_n - rolling * along + needle_moment - bearing_moment
    moment -= inertia * (1.5 * spin + past_spin)
    slope = -drag * rate * rate - newton * drag_slope * (slip * rate / speed) ** 2
    slope -= rolling * (t_tau * t_tau + m.t_z * m.t_z)
    slope -= p.needle_rolling * p.bearing_radius * (1.0 - needle_rolling * needle_rolling) / p.spin_transition
    needle_slope = 0.5 * p.needle_sliding * (1.0 - needle_sliding * needle_sliding) / p.needle_transition
    slope -= needle_slope * (p.needle_lever * sin_psi) ** 2 + 1.5 * inertia
    # the contact angle shifts the spin, and with it the slip across the groove
    stiffness = drag + drag_slope * (v_tau / speed) ** 2
    gripping = (drag + newton * (stiffness - drag)) * (t_tau * t_tau + m.t_z * m.t_z)
    swing_gain = -(gripping + needle_slope * cos_psi * cos_psi) * swinging
    outward, along_groove = inertial_force(p, cos_phi)
    along_trunnion = f_tau * t_tau + f_z * m.t_z - p.needle_sliding * cos_psi * needle_sliding
    return GrooveForces(
        moment,
        slope / rate,
        along_trunnion + (outward * m.t_r + along_groove * m.t_z) / load,
        stiffness * p.roller_radius * m.t_z * m.w_t / m.t_r + 1.5 * swing_gain,
        sin_a,
        cos_a,
        f_tau,
        f_z,
        -spinning,
        -rolling * w_tau,
        -rolling * w_z,
        drag * speed * speed,
        spinning * w_n,
        rolling * roll * roll,
        p.needle_sliding * needle_sliding * needle_slip,
        bearing_moment * spin,
        needle_moment,
        -bearing_moment,
        spin,
        1.0 / rate,
        inertia,
        -sigma * cos_a / (cos_sum * length),
        swing_gain,
    )


@inlined_kernel
def thrust_of_each(p, g, cos_phi, sin_phi):
    """Parts of the thrust of one groove over N, in the order of `outputs.PARTS`, defined in `thrust_parts`."""
    m = ideal_motion(cos_phi, sin_phi, p.cos_theta, p.sin_theta, p.pitch_radius, p.omega)
    arm = (1.0 if p.torque >= 0.0 else -1.0) * p.roller_radius
    t_tau = g.cos_a * m.t_r - g.sin_a * m.t_t
    t_n = g.sin_a * m.t_r + g.cos_a * m.t_t
    # the point of contact moves by (lever_tau, lever_z) while the roller turns on its trunnion at unit rate
    lever_tau, lever_z = arm * m.t_z, -arm * t_tau
    gain = lever_z / (lever_tau * lever_tau + lever_z * lever_z)
    along = -gain * (g.friction_tau * lever_tau + g.friction_z * lever_z)
    spinning, rolling = gain * g.moment_n * t_n, gain * (g.moment_tau * t_tau + g.moment_z * m.t_z)
    needle_sliding, needle_rolling = gain * g.needle_sliding_moment, gain * g.needle_rolling_moment
    rest = along - spinning - rolling - needle_sliding - needle_rolling
    return -g.friction_z - along, spinning, rolling, needle_sliding, needle_rolling, rest


@inlined_kernel
def spider_wrench(p, g, cos_phi, sin_phi):
    """What one groove does to the spider over N: two forces across the shaft, moments about shaft and input axis."""
    m = ideal_motion(cos_phi, sin_phi, p.cos_theta, p.sin_theta, p.pitch_radius, p.omega)
    sigma = 1.0 if p.torque >= 0.0 else -1.0
    arm = sigma * p.roller_radius
    force_r = sigma * g.sin_a + g.friction_tau * g.cos_a
    force_t = sigma * g.cos_a - g.friction_tau * g.sin_a
    moment_r = g.moment_n * g.sin_a + g.moment_tau * g.cos_a
    moment_t = g.moment_n * g.cos_a - g.moment_tau * g.sin_a
    x_r = m.distance * m.t_r - arm * g.sin_a
    x_t = m.distance * m.t_t - arm * g.cos_a
    x_z = m.distance * m.t_z
    about_r = x_t * g.friction_z - x_z * force_t + moment_r
    about_t = x_z * force_r - x_r * g.friction_z + moment_t
    about_z = x_r * force_t - x_t * force_r + g.moment_z
    across_1 = (force_r * cos_phi - force_t * sin_phi) * p.cos_theta - g.friction_z * p.sin_theta
    across_2 = force_r * sin_phi + force_t * cos_phi
    about_shaft = (about_r * cos_phi - about_t * sin_phi) * p.sin_theta + about_z * p.cos_theta
    about_input = (p.pitch_radius - arm * g.sin_a) * force_t + arm * g.cos_a * force_r + g.moment_z
    return across_1, across_2, about_shaft, about_input
