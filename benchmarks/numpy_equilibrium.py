"""The equilibrium model as one would write it in plain NumPy: all angles of one point at once, bisection in the spin.

The peer of benchmarks/throughput.py. Same equations as tripod_doe.joint.force_balance.equilibrium, none of its code.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.joint.derived_constants.load_zone import bearing_load_zone


def third_order(p, samples=360):
    """Amplitude of the third order in N; `p` holds one point in internal units, derived constants included."""
    theta, omega, sigma = p.joint_angle, p.speed, np.sign(p.torque)
    pitch, radius = p.pitch_radius, p.roller_radius
    phi = 2 * np.pi * (np.arange(samples) / samples + np.arange(3)[:, None] / 3)
    c, s = np.cos(phi), np.sin(phi)
    e = pitch * (1 / np.cos(theta) - 1) / 2
    v_z, plunge, r = (
        pitch * omega * np.tan(theta) * s,
        -4 * e * omega * np.sin(2 * phi),
        pitch + e + 2 * e * np.cos(2 * phi),
    )
    versine = 1 - np.cos(theta)
    t = np.stack([1 - versine * c**2, versine * s * c, -np.sin(theta) * c])
    w_0 = omega * np.stack([np.sin(theta) * c, -np.sin(theta) * s, np.full_like(c, -versine)])
    travel = pitch * omega * np.tan(theta)
    ratio = p.transition_ratio
    v_groove = ratio * travel * np.sin(theta) / 2 * np.hypot(1, radius / pitch)
    v_needle, w_roll = ratio * 2 * e * omega, ratio * travel / radius
    w_bearing, w_normal = ratio * omega * np.hypot(travel / radius / omega, np.sin(theta)), ratio * theta * omega
    lever = p.bore_radius * p.trunnion_radius / p.bearing_radius
    kappa = bearing_load_zone(p.groove_load, p.bearing_radial_clearance, p.needle_stiffness, p.needle_count)[0]
    psi = np.array(p.initial_skews)[:, None]
    grip_n, grip_r = p.needle_sliding_friction * kappa, p.needle_rolling_friction * kappa

    def state(spin, lean, normal):
        length = np.hypot(t[0], t[1])
        sine = -sigma * lean / length
        cosine = np.sqrt(1 - sine**2)
        sin_a, cos_a = (sine * t[0] - cosine * t[1]) / length, (cosine * t[0] + sine * t[1]) / length
        t_tau, t_n = cos_a * t[0] - sin_a * t[1], sin_a * t[0] + cos_a * t[1]
        w_tau = cos_a * w_0[0] - sin_a * w_0[1] + spin * t_tau
        w_n, w_z = sin_a * w_0[0] + cos_a * w_0[1] + spin * t_n, w_0[2] + spin * t[2]
        v_tau, v_along = sigma * radius * w_z, v_z - sigma * radius * w_tau
        speed, roll = np.hypot(v_tau, v_along) + 1e-300, np.hypot(w_tau, w_z) + 1e-300
        drag = p.groove_sliding_friction * np.tanh(speed / v_groove) / speed
        rolling = p.groove_rolling_friction * p.groove_rolling_lever * np.tanh(roll / w_roll) / roll
        axis = p.groove_axis_factor * np.cbrt(normal)
        spinning = 0.375 * p.groove_spin_friction * axis * np.tanh(w_n / w_normal)
        slide = np.tanh((plunge * np.cos(psi) - spin * lever * np.sin(psi)) / (2 * v_needle))
        f_tau, f_z = -drag * v_tau, -drag * v_along
        about = grip_n * lever * np.sin(psi) * slide - grip_r * p.bearing_radius * np.tanh(spin / w_bearing)
        moment = -sigma * radius * (f_z * t_tau - f_tau * t[2]) - spinning * t_n + about
        moment = moment - rolling * (w_tau * t_tau + w_z * t[2])
        along = f_tau * t_tau + f_z * t[2] - grip_n * np.cos(psi) * slide
        return moment, along, (sin_a, cos_a, f_tau, f_z, spinning, rolling * w_tau, rolling * w_z)

    lean, normal = np.zeros_like(c), np.full_like(c, p.groove_load)
    for _ in range(12):
        low, high = np.full_like(c, -2 * omega), np.full_like(c, 2 * omega)
        for _ in range(45):
            middle = (low + high) / 2
            up = state(middle, lean, normal)[0] > 0
            low, high = np.where(up, middle, low), np.where(up, high, middle)
        _, along, (sin_a, cos_a, f_tau, f_z, m_n, m_tau, m_z) = state((low + high) / 2, lean, normal)
        lean = along
        force = np.stack([sigma * sin_a + f_tau * cos_a, sigma * cos_a - f_tau * sin_a, f_z])
        moment = np.stack([-m_n * sin_a - m_tau * cos_a, -m_n * cos_a + m_tau * sin_a, -m_z])
        arm = r * t - sigma * radius * np.stack([sin_a, cos_a, np.zeros_like(c)])
        turn = np.cross(arm, force, axis=0) + moment
        across_1 = (force[0] * c - force[1] * s) * np.cos(theta) - force[2] * np.sin(theta)
        across_2 = force[0] * s + force[1] * c
        about = (turn[0] * c - turn[1] * s) * np.sin(theta) + turn[2] * np.cos(theta)
        matrix = np.moveaxis(np.stack([across_1, across_2, about]), 2, 0)
        rhs = np.broadcast_to([[0.0], [0.0], [p.torque]], (samples, 3, 1))
        normal = np.linalg.solve(matrix, rhs)[..., 0].T
    thrust = (-normal * f_z).sum(axis=0)
    return 2 * abs(np.fft.rfft(thrust)[3]) / samples
