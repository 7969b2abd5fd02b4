"""A needle bearing as one element: load zone with clearance, and the friction of needles at a prescribed skew.

The frame, the offset D of the bore's axis and the moments J_j of a slice's load zone are those of `bearing_load_zone`.
Per slice, with D' and o' the rates of the offset,

    bore pushed along n = -o / D by J_1 + c_n D', across it by c_t o'_tau, the needles' loads in sum L = J_0 + c_L D',
    c_n = (d / 2) J_2 + tau dJ_1/dD,  c_t = (d / 2) (J_0 - J_2) + tau J_1/D,  c_L = (d / 2) J_1 + tau dJ_0/dD,
    stored energy (D J_1 - c J_0) / (m + 1)    (Eq. 2; factor d and time tau of the contacts' damping, whose parts
    along n are limited as in `laws.contact`).

The force follows from the stored energy: it acts in the bore's axis at right angles to it, n - (n h) t, on both bodies.

Friction. A needle skewed by psi rolls freely across its axis e = cos psi t + sin psi (normal x t) and transmits
friction along it. With w the axial velocity of the bore against the trunnion at the pitch radius r_p in the middle of
the slice's load, and s the roller's spin about t, it slips on bore and trunnion alike, together by

    v = w cos psi - s r_e sin psi,    r_e = r_b r_t / r_p:

half the difference of speeds carries the needles round (planetary rolling); virtual power gives this lever. The
friction of a slice's needles is F = mu_s L tanh(v / (2 v_st)): an axial force -F cos psi on the bore where w is taken,
and a torque F r_e sin psi about t. Their rolling resistance mu_r f d_n / 2 at both contacts, whose relative angular
velocities are s r_b / d_n and s r_t / d_n, brakes the spin; by virtual power its levers add up to the pitch radius,

    T = mu_r L r_p tanh(s / s_st),

with the spin s_st at which both contacts reach their transition (each has the ratio's share of its own largest speed).

Left out: friction against the yaw of needles (tilting and yawing the roller is resisted by the slices' loads and by the
axial friction at the pitch radius); the side force F sin psi, which turns the load zone by psi mu; the friction of
needles on opposite sides of an evenly preloaded bearing against tilting.
"""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import add, cross, load_vector, subtract
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.forces.bearing_load_zone import in_world, place_bore, press_slice, slice_damping, slice_offset
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent
from tripod_doe.mechanics.laws.needles import needle_grip


@kernel
def bearing_forces(bearings, positions, velocities, force, ledger):
    """Add the forces and moments of all needle bearings, and their energies.

    Args:
        positions, velocities: Shapes (body, 7) and (body, 6).
        force: Receives forces and moments about the centres of mass, shape (body, 6).
        ledger: Receives stored energy and lost powers (`tables.LEDGER`).
    """
    for i in range(bearings.size):
        bearing = bearings[i]
        fit = place_bore(bearing, positions, velocities)
        push_1, push_2, axial, carried = 0.0, 0.0, 0.0, 0.0
        moment_1, moment_2, torque = 0.0, 0.0, 0.0
        for k in range(bearing.slices):
            station, clearance, x, y, reach = slice_offset(bearing, fit, k)
            if not reach > clearance:
                continue
            s = press_slice(bearing, fit, station, clearance, x, y, reach)
            held = slice_damping(bearing, s, reach)[1] * s.passing
            ledger[0] += (reach * s.zone.along - clearance * s.zone.total) / (bearing.exponent + 1.0)
            ledger[5] += (s.pressed - s.zone.along) * s.closing + held * s.passing
            load_1 = s.pressed * s.n_1 + held * s.n_2
            load_2 = s.pressed * s.n_2 - held * s.n_1
            along_axis = load_1 * fit.lean_1 + load_2 * fit.lean_2
            push_1, push_2, carried = push_1 + load_1, push_2 + load_2, carried + s.load
            drag = bearing.sliding * s.load * needle_grip(s.slip, bearing.sliding_transition)
            ledger[2] += drag * s.slip
            axial -= along_axis + bearing.cosine * drag
            # the load acts in the bore's axis: only the damping is left of its moment about the trunnion
            moment_1 -= station * load_2 + y * along_axis + bearing.cosine * drag * s.lever * s.n_2
            moment_2 += station * load_1 + x * along_axis + bearing.cosine * drag * s.lever * s.n_1
            torque += reach * held + bearing.skew_lever * drag
        if carried > 0.0:
            brake = rolling_torque(bearing, fit, carried)
            ledger[4] += brake * fit.spin
            pull = in_world(fit, push_1, push_2, axial)
            moment = in_world(fit, moment_1, moment_2, torque - brake)
            _apply_to_body(force, positions, bearing.body_b, fit.place, pull, moment, 1.0)
            _apply_to_body(force, positions, bearing.body_a, fit.place, pull, moment, -1.0)


@inlined_kernel
def rolling_torque(bearing, fit, carried):
    """Torque of the needles' rolling resistance about the trunnion, against the spin."""
    pitch = 0.5 * (bearing.trunnion_radius + bearing.bore_radius)
    return bearing.rolling * carried * pitch * hyperbolic_tangent(fit.spin / bearing.rolling_transition)


@inlined_kernel
def _apply_to_body(force, positions, body, place, pull, moment, sign):
    """Add a force at a place, and a moment, to a body."""
    turned = add(moment, cross(subtract(place, load_vector(positions[body], 0)), pull))
    for d in range(3):
        force[body, d] += sign * pull[d]
        force[body, 3 + d] += sign * turned[d]


@kernel
def bearing_compression(bearings, positions, velocities):
    """Deepest compression of a contact of all bearings in some states, and the largest share of its needle's radius.

    Args:
        positions, velocities: Shapes (state, body, 7) and (state, body, 6).

    Returns:
        The deepest compression; the largest share, its compression, the body of its bore, and the state; zeros where
        nothing touches.
    """
    deepest, worst, depth_there, body, state = 0.0, 0.0, 0.0, 0, 0
    for n in range(positions.shape[0]):
        for i in range(bearings.size):
            bearing = bearings[i]
            fit = place_bore(bearing, positions[n], velocities[n])
            for k in range(bearing.slices):
                _, clearance, _, _, reach = slice_offset(bearing, fit, k)
                depth = 0.5 * (reach - clearance)
                deepest = max(deepest, depth)
                if depth > worst * 0.5 * bearing.diameter:
                    worst, depth_there, body, state = depth / (0.5 * bearing.diameter), depth, bearing.body_b, n
    return deepest, worst, depth_there, body, state
