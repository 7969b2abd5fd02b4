"""Load distribution along needles on trunnion and bore: eight needles of each trunnion at a time (`simd_lanes`).

A needle's sphere at the station x is pressed by d + (b - h x) x, with its depth d, lean b, and the drop h of its crown
and of its skew; depth and lean balance the load and its moment about the middle. One Newton step per time step updates
them.
"""

from __future__ import annotations

from tripod_doe.joint.massless_needles.load_sharing import EXPONENT, station
from tripod_doe.mechanics.arithmetic.elementary_functions import exponential, logarithm
from tripod_doe.mechanics.arithmetic.simd_lanes import load_three, select, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, inner_kernel
from tripod_doe.mechanics.laws.contact import contact_secant

FARTHEST = 0.35
"""Place of a load along a needle over its length, at most."""
PLACE, SKEW, TRUNNION, BORE, STOP, SIDE = 0, 1, 2, 5, 8, 9
"""Rows of the state of eight needles of each trunnion: along the trunnion from the middle in mm, psi in rad, contacts,
the force of the outer stop in N, negative at the inner one, and 1 at the outer stop, -1 at the inner one, 0 between."""
DEPTH, LEAN, VARIANCE = range(3)
"""Rows of a contact: compression in the middle and its slope, and <(x - x_f)^2> of the stations."""
ROWS = 10
_ONE = 1e-9
"""Limit of the determinant over its largest value; below it one sphere carries all load."""


@inlined_kernel
def deepest(c, carried):
    """Depth of needles whose load rests on all spheres alike."""
    return exponential(0.9 * logarithm(max(carried, 1e-30) / c.stiffness))


@inlined_kernel
def load_centre(c, offset, place):
    """Place of the load along needles, from their middle."""
    return min(max(offset - place, -FARTHEST * c.length), FARTHEST * c.length)


@inner_kernel
def _follow(c, state, first, carried, centre, drop, most, changes):
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
    rise, rise_1, rise_2 = EXPONENT * rise, EXPONENT * rise_1, EXPONENT * rise_2
    missing, moment = carried - total, carried * centre - first_moment
    determinant = rise * rise_2 - rise_1 * rise_1
    several = determinant > _ONE * c.length * c.length * (rise * rise)
    scale = 1.0 / select(several, determinant, rise)
    deeper = select(several, rise_2 * missing - rise_1 * moment, missing) * scale
    leaning = select(several, (rise * moment - rise_1 * missing) * scale, 0.0)  # one sphere gives no lean
    some = total > 0.0
    steepest = 2.0 / c.length * most
    mean, before = first_moment / total, load_three(state, first + VARIANCE)
    deeper = select(some, depth + min(max(deeper, -most), most), most)
    leaning = select(some, lean + min(max(leaning, -steepest), steepest), 0.0)
    variance = select(some, second / total - mean * mean, before)
    change = changes > 0.0
    store(state, first + DEPTH, select(change, deeper, depth))
    store(state, first + LEAN, select(change, leaning, lean))
    store(state, first + VARIANCE, select(change, variance, before))


@inner_kernel
def follow_spread(c, state, carried, offset, deep, changes):
    """One step towards the spread of the loads `carried` on trunnion and bore; `deep` is their depth by `deepest`.

    `changes` is positive for needles that take the step; others stay as they are.
    """
    skew = load_three(state, SKEW)
    bend = 0.5 / c.pitch_radius * (skew * skew)
    centre = load_centre(c, offset, load_three(state, PLACE))
    most = c.spheres**0.9 * deep  # depth of a sphere that carries all
    for contact in range(2):
        first, bent = TRUNNION + contact * (BORE - TRUNNION), (1.0 - 2.0 * contact) * bend
        _follow(c, state, first, carried, centre, c.drop + bent, most, changes)
