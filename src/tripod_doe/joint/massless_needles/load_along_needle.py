"""Load distribution along needles on trunnion and bore: eight needles of each trunnion at a time (`simd_lanes`).

A needle's sphere at the station x is pressed by d + (b - h x) x, with its depth d, lean b, and the drop h of its crown
and of its skew; depth and lean balance the load and its moment about the middle. One Newton step per time step follows
them. It fails where spheres come and go, as under strongly skewed needles, which touch with their middle or with their
ends: they jump from end to end, nothing holds their skew meanwhile, and where they go hangs on rounding. So needles
whose load is at the wrong place are balanced anew. The balance is the minimum of a convex energy: for each lean there
is one depth, and the moment rises with the lean.
"""

from __future__ import annotations

import math

from tripod_doe.joint.massless_needles.load_sharing import EXPONENT, station
from tripod_doe.mechanics.arithmetic.simd_lanes import (
    WIDTH,
    everywhere,
    load_three,
    pick,
    ramp,
    row_of_sums,
    select,
    spread,
    store,
)
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, inner_kernel
from tripod_doe.mechanics.laws.contact import contact_secant

FARTHEST, _WITHIN = 0.35, 0.98
"""Place of a load along a needle over its length, at most; where spheres are few, `_WITHIN` the outermost ones."""
PLACE, SKEW, TRUNNION, BORE, STOP, SIDE = 0, 1, 2, 5, 8, 9
"""Rows of the state of eight needles of each trunnion: along the trunnion from the middle in mm, psi in rad, contacts,
the force of the outer stop in N, negative at the inner one, and 1 at the outer stop, -1 at the inner one, 0 between."""
DEPTH, LEAN, VARIANCE = range(3)
"""Rows of a contact: compression in the middle and its slope, and <(x - x_f)^2> of the stations, or `UNKNOWN`."""
UNKNOWN = -1.0
"""Variance of a contact that must be balanced anew."""
ROWS = 10
_ONE = 1e-9
"""Limit of the determinant over its largest value; below it one sphere carries all load."""
_OFF, _FAR = 0.05, 4.0
"""A Newton step is repeated, then replaced, where it began farther off the load's place, over the length, and not taken
where it would move an end by more, over the mean compression."""
_BALANCED, _MOST_LEANS, _MOST_DEPTHS = 1e-3, 60, 20
"""Largest error of a balance, over the load; most iterations, of which five and three are usual."""


@inlined_kernel
def load_centre(c, offset, place):
    """Place of the load along needles, from their middle."""
    farthest = min(FARTHEST, _WITHIN * (0.5 - 0.5 / c.spheres)) * c.length
    return min(max(offset - place, -farthest), farthest)


@inner_kernel
def _follow(c, state, first, carried, centre, drop):
    """One step towards the spread of the loads `carried` in the contacts from row `first` on; see `follow_spread`."""
    depth, lean = load_three(state, first + DEPTH), load_three(state, first + LEAN)
    total = 0.0 * depth
    first_moment, second, rise, rise_1, rise_2 = total, total, total, total, total
    for i in range(int(c.spheres)):
        at = station(c, i)
        compressed = depth + (lean - drop * at) * at
        secant = select(compressed > 0.0, contact_secant(c.stiffness / c.spheres, EXPONENT, compressed), 0.0)
        force, by_lean = secant * compressed, secant * at
        total, first_moment, second = total + force, first_moment + force * at, second + force * (at * at)
        rise, rise_1, rise_2 = rise + secant, rise_1 + by_lean, rise_2 + by_lean * at
    determinant = EXPONENT * (rise * rise_2 - rise_1 * rise_1)
    several = determinant > _ONE * c.length * c.length * (rise * rise)
    missing, moment, mean = carried - total, carried * centre - first_moment, first_moment / total
    scale = 1.0 / select(several, determinant, EXPONENT * rise)
    deeper = select(several, rise_2 * missing - rise_1 * moment, missing) * scale
    leaning = select(several, (rise * moment - rise_1 * missing) * scale, 0.0)  # one sphere gives no lean
    moved = (abs(deeper) + 0.5 * c.length * abs(leaning)) * rise
    near, there = moved <= _FAR * total, abs(mean - centre) <= _OFF * c.length
    store(state, first + DEPTH, select(near, depth + deeper, depth))
    store(state, first + LEAN, select(near, lean + leaning, lean))
    variance = select(near, select(there, max(second / total - mean * mean, 0.0), UNKNOWN), UNKNOWN)
    variance = select(carried > 0.0, variance, 0.0)
    store(state, first + VARIANCE, variance)
    return everywhere(variance > UNKNOWN)


@inlined_kernel
def _bent(c, skew, contact):
    """Drop of a needle that its skew adds to the crown's: on the trunnion (contact 0), and on the bore."""
    return c.drop + (0.5 - contact) / c.pitch_radius * (skew * skew)


@inner_kernel
def follow_spread(c, state, carried, offset):
    """One step towards the spread of the loads `carried` on trunnion and bore; whether it is known then everywhere."""
    skew, centre = load_three(state, SKEW), load_centre(c, offset, load_three(state, PLACE))
    on_trunnion = _follow(c, state, TRUNNION, carried, centre, _bent(c, skew, 0.0))
    return _follow(c, state, BORE, carried, centre, _bent(c, skew, 1.0)) and on_trunnion


@inner_kernel
def _pressed(c, depth, lean, drop):
    """Sum of all forces of a contact, of forces times stations and their squares, and of slopes in the same way."""
    sums = spread(0.0)
    for group in range(0, int(c.spheres), WIDTH):
        number = ramp(float(group))
        at = station(c, number)
        compressed = select(number < c.spheres, depth + (lean - drop * at) * at, 0.0)
        secant = select(compressed > 0.0, contact_secant(c.stiffness / c.spheres, EXPONENT, compressed), 0.0)
        force, by_lean = secant * compressed, EXPONENT * secant
        sums = sums + row_of_sums(force, force * at, force * at * at, by_lean, by_lean * at, by_lean * at * at)
    return (pick(sums, 0), pick(sums, 1), pick(sums, 2)), (pick(sums, 3), pick(sums, 4), pick(sums, 5))


@inner_kernel
def _press(c, carried, lean, drop, most):
    """Depth at which a contact of this lean carries a load, with `_pressed`; `most` is the depth of one sphere alone.

    From too deep, Newton's method comes up without overshooting: forces are convex.
    """
    depth = math.inf
    for i in range(int(c.spheres)):
        depth = min(depth, most - (lean - drop * station(c, i)) * station(c, i))
    forces, slopes = _pressed(c, depth, lean, drop)
    for _ in range(_MOST_DEPTHS):
        if forces[0] - carried <= _BALANCED * carried:
            break
        depth -= (forces[0] - carried) / slopes[0]
        forces, slopes = _pressed(c, depth, lean, drop)
    return depth, forces, slopes


@inner_kernel
def _balance(c, carried, centre, drop, lean):
    """Depth, lean and variance of a contact from any lean: Newton's method for its moment, or bisection."""
    most = math.exp(0.9 * math.log(c.spheres * carried / c.stiffness))
    high = c.length * abs(drop) + 2.0 * most * c.spheres / c.length  # one end carries all
    low, lean = -high, min(max(lean, -high), high)
    depth, forces, slopes = _press(c, carried, lean, drop, most)
    for _ in range(_MOST_LEANS):
        moment = forces[0] * centre - forces[1]
        if abs(moment) <= _BALANCED * carried * c.length:
            break
        if moment > 0.0:
            low = lean
        else:
            high = lean
        lean += moment * slopes[0] / max(slopes[0] * slopes[2] - slopes[1] * slopes[1], 1e-300)
        if not low < lean < high:
            lean = 0.5 * (low + high)
        depth, forces, slopes = _press(c, carried, lean, drop, most)
    mean = forces[1] / forces[0]
    return depth, lean, max(forces[2] / forces[0] - mean * mean, 0.0)


@inner_kernel
def balance_unknown(c, state, loads, offsets):
    """Balance all loaded needles whose spread of loads is `UNKNOWN`; `offsets`: places of the bearings' loads."""
    for lane in range(loads.size):
        place, skew = state[PLACE, lane], state[SKEW, lane]
        for contact in range(2):
            first = TRUNNION + contact * (BORE - TRUNNION)
            if loads[lane] > 0.0 and state[first + VARIANCE, lane] == UNKNOWN:
                centre, drop = load_centre(c, offsets[lane // WIDTH], place), _bent(c, skew, contact)
                found = _balance(c, loads[lane], centre, drop, state[first + LEAN, lane])
                state[first + DEPTH, lane], state[first + LEAN, lane], state[first + VARIANCE, lane] = found
