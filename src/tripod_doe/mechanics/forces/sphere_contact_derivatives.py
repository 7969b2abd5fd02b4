"""Derivatives of the forces of a row of spheres by its motion, eight spheres at a time."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import add, cross, scale, subtract
from tripod_doe.mechanics.arithmetic.simd_lanes import load, row_of_sums, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel
from tripod_doe.mechanics.forces.sphere_contact_geometry import six, wrench_of
from tripod_doe.mechanics.laws.friction import tangent_slope
from tripod_doe.mechanics.laws.rolling import rolling_moment, spinning_lever


@inlined_kernel
def _slopes(coefficient, secant, chord, speed, transition, x, y):
    """Symmetric slopes of a friction law by two components x, y: its chord across them, along them `_slope`."""
    if secant >= 1.0:
        return chord, 0.0 * chord, chord
    extra = (_slope(coefficient, secant, chord, speed, transition) - chord) / max(speed * speed, 1e-300)
    return chord + extra * x * x, extra * x * y, chord + extra * y * y


@inlined_kernel
def _slope(coefficient, secant, chord, speed, transition):
    """Slope of a friction law along the motion: the tangent, but not below a share of the chord, which is steeper."""
    if secant >= 1.0:
        return chord
    return max(coefficient * tangent_slope(speed, transition), secant * chord)


@inlined_kernel
def _twist(spheres, d, twists):
    """Row d of the derivative of the moment of rolling or spinning friction for the angular velocity."""
    of_t, of_b = scale(spheres.tangent[d], twists[0]), scale(spheres.binormal[d], twists[1])
    return add(add(of_t, of_b), scale(spheres.normal[d], twists[2]))


@inlined_kernel
def _twists(contact, s, m, acting, secant, damped):
    """Derivative of the moments of rolling and spinning friction for the angular velocity, three rows."""
    nothing = 0.0 * damped
    if contact.rolling == 0.0 and contact.spinning == 0.0:
        still = (nothing, nothing, nothing)
        return still, still, still
    resistance = rolling_moment(contact.rolling, 1.0, contact.lever)
    tt, tb, bb = _slopes(
        resistance, secant, acting.roll, acting.roll_speed, contact.rolling_transition, m.roll_t, m.roll_b
    )
    lever = spinning_lever(contact.spinning, acting.normal)
    nn = damped * _slope(lever, secant, acting.spin, abs(m.spin), contact.spinning_transition)
    tt, tb, bb = damped * tt, damped * tb, damped * bb
    twists = (
        add(scale(tt, s.tangent), scale(tb, s.binormal)),
        add(scale(tb, s.tangent), scale(bb, s.binormal)),
        scale(nn, s.normal),
    )
    return _twist(s, 0, twists), _twist(s, 1, twists), _twist(s, 2, twists)


@inlined_kernel
def _mix(p, a, q, b):
    """Two multiples of six lanes each, p a + q b."""
    return (
        p * a[0] + q * b[0],
        p * a[1] + q * b[1],
        p * a[2] + q * b[2],
        p * a[3] + q * b[3],
        p * a[4] + q * b[4],
        p * a[5] + q * b[5],
    )


@inlined_kernel
def _row(a, b, c, x, y, z):
    """One row of a x + b y + c z."""
    return (
        a * x[0] + b * y[0] + c * z[0],
        a * x[1] + b * y[1] + c * z[1],
        a * x[2] + b * y[2] + c * z[2],
        a * x[3] + b * y[3] + c * z[3],
        a * x[4] + b * y[4] + c * z[4],
        a * x[5] + b * y[5] + c * z[5],
    )


@inlined_kernel
def _moment_row(row, lift, around, twist):
    """Sums over the spheres of a row of moments, with those by motion around a cylinder and by rotation."""
    return row_of_sums(*_mix(1.0, _mix(1.0, row, lift, around), 1.0, six((0.0, 0.0, 0.0), twist)))


@inlined_kernel
def add_derivatives(contact, spheres, motion, acting, slopes, block):
    """Add by_velocity times -dQ/dv and by_position times -dQ/dq about the row's centre.

    Every sphere gives three dyads of a change of force by a change of motion: by penetration and its rate, and by the
    motion along the two tangents. As a sphere moves around a cylinder, the normal force turns about the sphere's
    centre, and the slip changes by the turn of the tangents. Without these two, steps in which a loaded roller could
    swing across its groove diverge (measured: 297 N m, 424 rpm, beyond a quarter of a degree; with them not at 1 deg).
    Rows of several spheres, needles that knock, leave them out: with them steps fail more often (437 for 297).
    """
    s, m, n = spheres, motion, acting.normal
    secant, by_velocity, by_position = slopes.secant, slopes.by_velocity, slopes.by_position
    # a change dN of the normal force changes the whole wrench by dN times `pull`
    pull = wrench_of(
        s,
        1.0,
        -acting.slide * m.slip_t,
        -acting.slide * m.slip_b,
        (-4.0 / 3.0) * acting.spin * m.spin,
        -acting.roll * m.roll_t,
        -acting.roll * m.roll_b,
    )
    inward, turned, shifted = cross(s.arm, s.normal), cross(s.arm, s.tangent), cross(s.arm, s.binormal)
    across = six(s.tangent, subtract(turned, scale(s.radius, s.binormal)))
    along = six(s.binormal, add(shifted, scale(s.radius, s.tangent)))
    tt, tb, bb = _slopes(
        contact.sliding, secant, acting.slide, acting.slip_speed, contact.sliding_transition, m.slip_t, m.slip_b
    )
    around, turn = six(s.tangent, turned), by_position * n * s.curvature
    single = turn if contact.count == 1 else 0.0 * turn
    sideways = s.radius * m.spin
    push_t, push_b = single * (tt * m.rate - tb * sideways) - turn, single * (tb * m.rate - bb * sideways)
    # at the point of contact acts the friction, the normal force at the centre
    lever = -single * s.radius
    lift = add(scale(lever, s.binormal), scale(lever * acting.slide * m.slip_b, s.normal))
    damped = by_velocity * n
    tt, tb, bb = damped * tt, damped * tb, damped * bb
    x = _mix(1.0, _mix(tt, across, tb, along), push_t, around)
    y = _mix(1.0, _mix(tb, across, bb, along), push_b, around)
    press = by_velocity * acting.by_rate + by_position * acting.by_depth
    z = six(scale(press, s.normal), scale(press, inward))
    store(block, 0, load(block, 0) + row_of_sums(*_row(across[0], along[0], pull[0], x, y, z)))
    store(block, 1, load(block, 1) + row_of_sums(*_row(across[1], along[1], pull[1], x, y, z)))
    store(block, 2, load(block, 2) + row_of_sums(*_row(across[2], along[2], pull[2], x, y, z)))
    twists = _twists(contact, s, m, acting, secant, damped)
    rows = (
        _row(across[3], along[3], pull[3], x, y, z),
        _row(across[4], along[4], pull[4], x, y, z),
        _row(across[5], along[5], pull[5], x, y, z),
    )
    store(block, 3, load(block, 3) + _moment_row(rows[0], lift[0], around, twists[0]))
    store(block, 4, load(block, 4) + _moment_row(rows[1], lift[1], around, twists[1]))
    store(block, 5, load(block, 5) + _moment_row(rows[2], lift[2], around, twists[2]))
