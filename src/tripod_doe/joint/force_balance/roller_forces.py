"""Forces of one roller between its groove and its trunnion, over the normal force: derived in `equilibrium`.

Mass and motion between samples are in `added_motion`. All formulas take eight samples at a time (`simd_lanes`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tripod_doe.joint.force_balance.point_constants import flank
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel_part
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent, relative_tangents
from tripod_doe.mechanics.laws.needles import needle_slip


class GrooveForces(NamedTuple):
    """One roller in its groove at one rotation angle; forces, moments (mm), powers (mm/s) per normal force N."""

    # moment, moment_slope: about the trunnion, and its derivative for the slip
    moment: float
    moment_slope: float
    trunnion_force: float  # (f t + P) / N, which the leaning normal must balance
    feedback: float  # derivative of the trunnion force for the force that sets the contact angle
    # sin_a, cos_a: of the contact angle
    sin_a: float
    cos_a: float
    # friction_tau, friction_z: sliding friction across and along the groove
    friction_tau: float
    friction_z: float
    # moment_n, moment_tau, moment_z: spinning moment, and rolling resistance across and along the groove
    moment_n: float
    moment_tau: float
    moment_z: float
    # sliding_power, spinning_power, rolling_power, needle_sliding_power, needle_rolling_power: lost to each mechanism
    sliding_power: float
    spinning_power: float
    rolling_power: float
    needle_sliding_power: float
    needle_rolling_power: float
    # needle_sliding_moment, needle_rolling_moment: of the needles about the trunnion
    needle_sliding_moment: float
    needle_rolling_moment: float
    # spin, spin_gain: of the roller on its trunnion in rad/s, and its derivative for the slip
    spin: float
    spin_gain: float
    inertia_gain: float  # derivative of the moment for the spin of earlier samples
    tilt_gain: float  # derivative of sin_a for the force that sets the contact angle
    swing_gain: float  # derivative of the trunnion force for trunnion forces of earlier samples
    axis_z: float  # part of the roller's axis along the groove


class Skew(NamedTuple):
    """Skew of the needles of one trunnion: its cosine and sine."""

    cosine: float
    sine: float


class Contact(NamedTuple):
    """The contact of a roller with its groove."""

    # sin_a, cos_a: of the contact angle
    sin_a: float
    cos_a: float
    # t_tau, t_n: the trunnion's direction across the groove, also the magnitude of d t_n / d(contact angle), and along
    # the normal
    t_tau: float
    t_n: float


class AddedMotion(NamedTuple):
    """Terms of the balance from a roller's mass and its motion between samples; zero in `equilibrium`."""

    # plunge, rocking: velocity along the trunnion in mm/s of the roller's centre, and of its bore besides, where the
    # needles are
    plunge: float
    rocking: float
    # swing, swing_gain: slip across the groove in mm/s, and its derivative for the force that the contact angle was
    # made from
    swing: float
    swing_gain: float
    inertia: float  # moment about the trunnion over N and the change of the spin, mm s/rad
    past_spin: float  # part of the spin's backward difference from earlier samples, rad/s
    trunnion_force: float  # inertial force along the trunnion, over N
    # needle_force, needle_moment: what needles that move by themselves add along and about the trunnion, over N; the
    # moment in mm
    needle_force: float
    needle_moment: float
    steering: float  # axial component of a yawed roller's axis minus its trunnion's, rad


STILL = AddedMotion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Added motion of a massless roller at rest between samples: zero."""


@inlined_kernel
def leaning_contact(p, m, lean):
    """Contact of the roller with its groove if the normal must carry the force `lean` (over N) along the trunnion."""
    length = math.sqrt(m.t_r * m.t_r + m.t_t * m.t_t)
    over_length = 1.0 / length
    sin_sum = min(max(-flank(p) * lean * over_length, -0.999), 0.999)
    cos_sum = math.sqrt(1.0 - sin_sum * sin_sum)
    sin_a = (sin_sum * m.t_r - cos_sum * m.t_t) * over_length
    cos_a = (cos_sum * m.t_r + sin_sum * m.t_t) * over_length
    return Contact(sin_a, cos_a, cos_sum * length, sin_sum * length)


@inlined_kernel
def groove_forces(p, m, skew, contact, slip, root, added, newton):
    """Forces of one roller for a trial slip along the rolling direction and a trial contact.

    Args:
        p, m, skew, contact, added: `PointConstants`, `IdealMotion`, `Skew`, `Contact`, `AddedMotion`.
        slip: v along dv/ds in mm/s.
        root: The semi-major axis a_H of the contact ellipse that goes with N, in mm.
        newton: Slopes of friction are tangents with 1, secants with 0.
    """
    arm = flank(p) * p.roller_radius
    sin_a, cos_a, t_tau, t_n = contact
    # slip is linear in the roller's spin s: v = v_0 + s v_1
    tau_0 = arm * m.w_z + added.swing
    z_0 = m.along_groove - arm * (cos_a * m.w_r - sin_a * m.w_t) + added.plunge * m.t_z
    axis_z = m.t_z + added.steering
    tau_1, z_1 = arm * axis_z, -arm * t_tau
    rate = math.sqrt(tau_1 * tau_1 + z_1 * z_1)
    over_rate = 1.0 / rate
    spin = (slip - (tau_0 * tau_1 + z_0 * z_1) * over_rate) * over_rate
    v_tau, v_z = tau_0 + spin * tau_1, z_0 + spin * z_1
    speed = math.sqrt(v_tau * v_tau + v_z * v_z + 1e-300)
    # relative angular velocity: rolling in the tangent plane, spinning about the normal
    w_tau = cos_a * m.w_r - sin_a * m.w_t + spin * t_tau
    w_n = sin_a * m.w_r + cos_a * m.w_t + spin * t_n
    w_z = m.w_z + spin * axis_z
    roll = math.sqrt(w_tau * w_tau + w_z * w_z + 1e-300)
    over_slip, over_roll = 1.0 / p.slip_transition, 1.0 / p.roll_transition
    held, rolled = relative_tangents(over_slip * speed, over_roll * roll)
    drag, sliding = p.groove_friction * over_slip * held, over_slip * speed * held
    drag_slope = p.groove_friction * over_slip * (1.0 - sliding * sliding) - drag
    f_tau, f_z = -drag * v_tau, -drag * v_z
    rolling = p.groove_resistance * p.rolling_lever * over_roll * rolled
    # needles: friction along their axes, rolling resistance about the trunnion
    plunge = m.along_trunnion + added.plunge + added.rocking
    slipping = needle_slip(plunge, spin, p.needle_lever, skew) * (0.5 / p.needle_transition)
    spun = w_n * (1.0 / p.normal_spin_transition)
    grip, turned = relative_tangents(abs(slipping), abs(spun))
    grip, spinning = slipping * grip, p.spinning_friction * root * (spun * turned)
    needle_rolling = hyperbolic_tangent(spin * (1.0 / p.spin_transition))
    needle_moment = p.needle_friction * p.needle_lever * skew.sine * grip + added.needle_moment
    bearing_moment = p.needle_resistance * p.bearing_radius * needle_rolling
    along = w_tau * t_tau + w_z * axis_z
    moment = -drag * slip * rate - spinning * t_n - rolling * along + needle_moment - bearing_moment
    moment = moment - added.inertia * (1.5 * spin + added.past_spin)
    over_speed = 1.0 / speed
    across = slip * rate * over_speed
    slope = -drag * rate * rate - newton * drag_slope * (across * across)
    slope = slope - rolling * (t_tau * t_tau + axis_z * axis_z)
    bearing_slope = p.needle_resistance * p.bearing_radius / p.spin_transition
    slope = slope - bearing_slope * (1.0 - needle_rolling * needle_rolling)
    needle_slope = 0.5 * p.needle_friction / p.needle_transition * (1.0 - grip * grip)
    lever = p.needle_lever * skew.sine
    slope = slope - (needle_slope * (lever * lever) + 1.5 * added.inertia)
    # the contact angle shifts the spin, and with it the slip across the groove
    share = v_tau * over_speed
    stiffness = drag + drag_slope * (share * share)
    gripping = (drag + newton * (stiffness - drag)) * (t_tau * t_tau + m.t_z * m.t_z)
    swing_gain = -(gripping + needle_slope * skew.cosine * skew.cosine) * added.swing_gain
    needle_force = added.needle_force - p.needle_friction * skew.cosine * grip
    along_trunnion = f_tau * t_tau + f_z * m.t_z + needle_force
    return GrooveForces(
        moment,
        slope * over_rate,
        along_trunnion + added.trunnion_force,
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
        -needle_force * plunge - needle_moment * spin,
        bearing_moment * spin,
        needle_moment,
        -bearing_moment,
        spin,
        over_rate,
        added.inertia,
        -flank(p) * cos_a / t_tau,
        swing_gain,
        axis_z,
    )


@kernel_part
def thrust_of_each(p, m, g):
    """Parts of the thrust of one groove over N, in the order of `outputs.PARTS`, defined in `thrust_parts`."""
    arm = flank(p) * p.roller_radius
    t_tau = g.cos_a * m.t_r - g.sin_a * m.t_t
    t_n = g.sin_a * m.t_r + g.cos_a * m.t_t
    # the point of contact moves by (lever_tau, lever_z) while the roller turns on its trunnion at unit rate
    lever_tau, lever_z = arm * g.axis_z, -arm * t_tau
    gain = lever_z / (lever_tau * lever_tau + lever_z * lever_z)
    along = -gain * (g.friction_tau * lever_tau + g.friction_z * lever_z)
    spinning, rolling = gain * g.moment_n * t_n, gain * (g.moment_tau * t_tau + g.moment_z * g.axis_z)
    needle_sliding, needle_rolling = gain * g.needle_sliding_moment, gain * g.needle_rolling_moment
    rest = along - spinning - rolling - needle_sliding - needle_rolling
    return -g.friction_z - along, spinning, rolling, needle_sliding, needle_rolling, rest


@inlined_kernel
def spider_wrench(p, m, g, cos_phi, sin_phi):
    """Load of one groove on the spider over N: two forces across the shaft, moments about shaft and input axis."""
    sigma = flank(p)
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
