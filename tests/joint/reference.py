"""A slow reference of the equilibrium model: 3-D vectors in the fixed frame, nine unknowns an angle, SciPy's root.

Written from the free bodies (three rollers, the spider) without the kernel's groove frame, closed-form kinematics or
elimination, so that it can be its oracle.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import root

TAN = np.tanh


def spider(phi, theta, pitch):
    """Spider centre and trunnion directions by solving that the three trunnion axes meet the groove axes."""
    d = np.array([np.sin(theta), 0, np.cos(theta)])
    e_1, e_2 = np.array([np.cos(theta), 0, -np.sin(theta)]), np.array([0.0, 1, 0])
    angles = phi + 2 * np.pi / 3 * np.arange(3)

    def directions(turn):
        return [np.cos(turn + a - phi) * e_1 + np.sin(turn + a - phi) * e_2 for a in angles]

    def miss(x):
        centre = x[0] * e_1 + x[1] * e_2
        gaps = []
        for a, t in zip(angles, directions(x[2]), strict=True):
            groove = np.array([pitch * np.cos(a), pitch * np.sin(a), 0])
            gaps.append((groove - centre) @ np.cross(t, [0, 0, 1]))
        return gaps

    x = root(miss, [0, 0, phi], tol=1e-14).x
    centre = x[0] * e_1 + x[1] * e_2
    t = directions(x[2])
    distance, height = [], []
    for a, direction in zip(angles, t, strict=True):
        groove = np.array([pitch * np.cos(a), pitch * np.sin(a), 0])
        r, z = np.linalg.lstsq(np.stack([direction, [0, 0, -1.0]], 1), groove - centre, rcond=None)[0]
        distance.append(r)
        height.append(z)
    return centre, d, t, distance, height


def groove_thrust(phi, p):
    """Axial force on the housing at the three grooves at one rotation angle; `p` is a dict in internal units."""
    theta, omega, pitch, radius = p["theta"], p["omega"], p["pitch"], p["radius"]
    step = 1e-5
    _, d, t, distance, _ = spider(phi, theta, pitch)
    _, _, _, distance_up, height_up = spider(phi + step, theta, pitch)
    _, _, _, distance_down, height_down = spider(phi - step, theta, pitch)
    plunge = (np.array(distance_up) - distance_down) / (2 * step) * omega
    travel = (np.array(height_up) - height_down) / (2 * step) * omega
    z = np.array([0, 0, 1.0])
    relative = omega * (d - z)  # the joint is homokinetic
    sigma = np.sign(p["torque"])
    mean_load = abs(p["torque"]) / (3 * pitch)
    angles = phi + 2 * np.pi / 3 * np.arange(3)

    def forces(k, spin, lean, load):
        outward = np.array([np.cos(angles[k]), np.sin(angles[k]), 0])
        around = np.cross(z, outward)
        normal = sigma * (np.cos(lean) * around + np.sin(lean) * outward)
        arm = -radius * normal
        turning = relative + spin * t[k]
        slip = travel[k] * z + np.cross(turning, arm)
        slip = slip - (slip @ normal) * normal
        speed = np.linalg.norm(slip) + 1e-300
        force = load * (normal - p["mu"] * TAN(speed / p["v_groove"]) * slip / speed)
        about_normal = (turning @ normal) * normal
        rolling = turning - about_normal
        roll = np.linalg.norm(rolling) + 1e-300
        moment = -p["mu_r"] * p["lever"] * load * TAN(roll / p["w_roll"]) * rolling / roll
        axis = p["axis_factor"] * max(load, 1e-9) ** (1 / 3)
        spinning = 0.375 * p["mu_spin"] * axis * load
        moment = moment - spinning * TAN(turning @ normal / p["w_normal"]) * normal
        psi = p["skew"][k]
        needle_slip = plunge[k] * np.cos(psi) - spin * p["needle_lever"] * np.sin(psi)
        grip = p["mu_n"] * p["kappa"] * load * TAN(needle_slip / (2 * p["v_needle"]))
        along = -grip * np.cos(psi)
        about = grip * p["needle_lever"] * np.sin(psi)
        about -= p["mu_rn"] * p["kappa"] * load * p["bearing_radius"] * TAN(spin / p["w_bearing"])
        return force, moment, arm, along, about

    def imbalance(x):
        spin, lean, load = x[:3] * omega, x[3:6], x[6:] * mean_load
        total, turn, rows = np.zeros(3), 0.0, []
        for k in range(3):
            force, moment, arm, along, about = forces(k, spin[k], lean[k], load[k])
            rows += [(force @ t[k] + along) / mean_load]
            rows += [((np.cross(arm, force) + moment) @ t[k] + about) / (mean_load * radius)]
            total += force
            turn += (np.cross(distance[k] * t[k] + arm, force) + moment) @ d
        across = total - (total @ d) * d
        return [*rows, across[1] / mean_load, across[0] / mean_load, turn / p["torque"] - 1]

    rolling = sigma * np.array(travel) / radius - omega * np.sin(theta) * np.cos(angles)
    guess = np.concatenate([rolling / omega, np.zeros(3), np.ones(3)])
    x = root(imbalance, guess, tol=1e-13).x
    if np.abs(imbalance(x)).max() > 1e-9:
        x = root(imbalance, x, method="lm", tol=1e-14).x
    assert np.abs(imbalance(x)).max() < 1e-9, imbalance(x)
    return np.array([-forces(k, x[k] * omega, x[3 + k], x[6 + k] * mean_load)[0][2] for k in range(3)])
