"""Effects of mass, and of motion between samples, on the forces of a roller: derived in `kinetostatic`.

All formulas take eight samples at a time (`simd_lanes`).
"""

from __future__ import annotations

from tripod_doe.joint.force_balance.point_constants import flank
from tripod_doe.joint.force_balance.roller_forces import AddedMotion, groove_forces, leaning_contact
from tripod_doe.mechanics.arithmetic.simd_lanes import load
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel_part
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent

_NEWTON = 60
"""Iterations of a yaw, at most; four are usual."""


@inlined_kernel
def inertial_force(p, cos_phi):
    """Inertial force of a roller in N, radially outward and along the groove."""
    centrifugal = p.roller_mass * p.pitch_radius * p.omega * p.omega
    return centrifugal, -centrifugal * p.sin_theta / p.cos_theta * cos_phi


@inlined_kernel
def added_motion(p, m, contact, cos_phi, root, past_tilt, past_spin, given):
    """Effects of mass and motion; `past_tilt`, `past_spin`: parts of backward differences from earlier samples.

    `given` stays constant during the solution: terms from moving needles (`needle_correction`), and yaw.
    As its contact wanders round the groove the roller swings, and so slides on its trunnion, and tilts on it.
    """
    over = 1.0 / (contact.cos_a * contact.t_tau)
    over_cos, over_tau = contact.t_tau * over, contact.cos_a * over
    leaning = -flank(p) * p.pace * (1.5 * contact.sin_a + past_tilt) * over_cos
    reach = p.play + p.tilt * p.roller_radius
    radius = root * (1.0 / p.axis_factor)
    over_load = 1.0 / (radius * (radius * radius))
    outward, along_groove = inertial_force(p, cos_phi)
    needle_force, needle_moment, needle_swing, steering = given
    tilting = p.tilt * (p.roller_radius * leaning + m.along_trunnion) + needle_swing
    return AddedMotion(
        p.play * leaning * over_tau,
        p.bearing_radius / p.roller_radius * tilting,
        p.play * leaning + tilting,
        reach * p.pace * over_tau,
        p.roller_inertia * p.pace * over_load,
        past_spin,
        (outward * m.t_r + along_groove * m.t_z) * over_load,
        needle_force,
        needle_moment,
        steering,
    )


@kernel_part
def moving_forces(p, m, e, skew, newton):
    """Forces of a roller at eight samples, with mass and motion effects; slopes as for `groove_forces`."""
    root, contact = load(e.root, 0), leaning_contact(p, m, load(e.lean, 0))
    given = load(e.needle_force, 0), load(e.needle_moment, 0), load(e.needle_swing, 0), load(e.steering, 0)
    added = added_motion(p, m, contact, load(e.cosine, 0), root, load(e.past_tilt, 0), load(e.past_spin, 0), given)
    return groove_forces(p, m, skew, contact, load(e.slip, 0), root, added, newton)


@kernel_part
def upright_spin(p, m):
    """Angular velocity about the normal, and steering direction from yaw, of an upright roller without slip."""
    upright = leaning_contact(p, m, 0.0)
    w_tau = upright.cos_a * m.w_r - upright.sin_a * m.w_t
    w_n = upright.sin_a * m.w_r + upright.cos_a * m.w_t
    rolled = (flank(p) * m.along_groove / p.roller_radius - w_tau) / upright.t_tau
    return w_n + rolled * upright.t_n, -flank(p) * upright.t_tau


@kernel_part
def yawed(p, before, most, w_n):
    """Yaw at the next sample of a roller that spins about its normal with `w_n`; `most`: under the full moment."""
    low, high = -most, most
    yaw = before
    for _ in range(_NEWTON):
        turning = hyperbolic_tangent((w_n + (yaw - before) * p.pace) / p.normal_spin_transition)
        wrong = yaw + most * turning
        if abs(wrong) <= 1e-9 * most:
            break
        if wrong > 0.0:
            high = yaw
        else:
            low = yaw
        yaw -= wrong / (1.0 + most * p.pace * (1.0 - turning * turning) / p.normal_spin_transition)
        if not low < yaw < high:
            yaw = 0.5 * (low + high)
    return yaw


@kernel_part
def spider_load(p, m, cos_phi, sin_phi):
    """Load on the spider from the inertia of one roller and a third of the shaft.

    Two forces across the shaft in N, and the moment about the shaft in N mm.
    """
    outward, along = inertial_force(p, cos_phi)
    about_r = m.distance * m.t_t * along
    about_t = m.distance * (m.t_z * outward - m.t_r * along)
    about_z = -m.distance * m.t_t * outward
    eccentricity = 0.5 * p.pitch_radius * (1.0 - p.cos_theta) / p.cos_theta
    orbit = -3.0 * p.shaft_mass * p.omega * p.omega * eccentricity
    cos_three_phi = (4.0 * (cos_phi * cos_phi) - 3.0) * cos_phi
    sin_three_phi = (3.0 - 4.0 * (sin_phi * sin_phi)) * sin_phi
    return (
        outward * cos_phi * p.cos_theta - along * p.sin_theta + orbit * cos_three_phi,
        outward * sin_phi + orbit * sin_three_phi,
        (about_r * cos_phi - about_t * sin_phi) * p.sin_theta + about_z * p.cos_theta,
    )
