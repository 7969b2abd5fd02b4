"""The balance of all grooves at all rotation angles of a point, by relaxation: the kernels behind `equilibrium`.

Every sample is relaxed by itself: Newton's method in the slip along the rolling direction and an accelerated iteration
in the contact angle, until no sample of the point changes any more. Samples that do not settle (nearly sharp friction
has jumps) are solved by nested bisection.
"""

from __future__ import annotations

from tripod_doe.joint.balance_constants import point_constants_of
from tripod_doe.joint.revolution import (
    account,
    balance_spider,
    changed,
    follow_root,
    force_scale,
    motion_at,
    skew_of,
    start,
    store_wrench,
    sum_of,
    summarise,
)
from tripod_doe.joint.roller_balance import AddedMotion, groove_forces, leaning_contact
from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.lanes import WIDTH, load, select, spread, store

__all__ = ["solve_still"]

_SWEEPS = 30
_BISECTIONS = 60
_OUTER = 20


@inlined_kernel
def _forces(p, m, skew, slip, lean, root):
    """Forces of a roller without mass that stays where it is between samples."""
    return groove_forces(
        p, m, skew, leaning_contact(p, m, lean), slip, root, AddedMotion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0
    )


@inlined_kernel
def _relax(p, e, skew, kept):
    """Change the unknowns of eight samples, but with `kept` = 1 not those of stubborn ones."""
    cos_phi, sin_phi = load(e.cosine, 0), load(e.sine, 0)
    m = motion_at(p, cos_phi, sin_phi)
    slip, lean = load(e.slip, 0), load(e.lean, 0)
    g = _forces(p, m, skew, slip, lean, load(e.root, 0))
    free = 1.0 - kept * load(e.stubborn, 0)
    # where nothing resists, any spin will do and the slip stays zero
    new_slip = slip - free * g.moment / min(g.moment_slope, -1e-30)
    new_lean = lean + free * (g.trunnion_force - lean) / max(1.0 - g.feedback, 0.5)
    store(e.slip, 0, new_slip)
    store(e.lean, 0, new_lean)
    store_wrench(p, m, g, e, cos_phi, sin_phi)
    by_slip = changed(abs(new_slip - slip), p.tolerance * p.slip_transition)
    store(e.moved, 0, by_slip + changed(abs(new_lean - lean), p.tolerance * (force_scale(p) + 1e-12)))


@kernel
def _sweep(p, eights, turns, kept):
    """Relax all samples once; how many changed by more than the tolerance, and of how many the normal force did.

    With `kept` = 1 the unknowns of stubborn samples stay as they are, and so does which these are.
    """
    moved, loaded = spread(0.0), spread(0.0)
    limit = 1e3 * p.tolerance * abs(p.torque) / p.pitch_radius
    for b in range(eights.shape[1]):
        for k in range(3):
            _relax(p, eights[k, b], skew_of(turns, k), kept)
            store(eights[k, b].normal_before, 0, load(eights[k, b].normal, 0))
        balance_spider(p, eights[0, b], eights[1, b], eights[2, b])
        for k in range(3):
            e = eights[k, b]
            of_root, root = follow_root(p, e)
            stubborn = min(load(e.moved, 0) + changed(of_root, p.tolerance * root), 1.0)
            store(e.stubborn, 0, kept * load(e.stubborn, 0) + (1.0 - kept) * stubborn)
            moved = moved + stubborn
            loaded = loaded + changed(abs(load(e.normal, 0) - load(e.normal_before, 0)), limit)
    return sum_of(moved), sum_of(loaded)


@inlined_kernel
def _bisect_slip(p, m, skew, lean, root):
    """Find the slip at which the moment about the trunnion vanishes; the moment falls with the slip."""
    reach = 1e4 * p.roller_radius * (p.omega + 1e-3)  # skewed needles alone may spin a free roller fast
    low, high = spread(-reach), spread(reach)
    for _ in range(_BISECTIONS):
        slip = 0.5 * (low + high)
        rises = _forces(p, m, skew, slip, lean, root).moment > 0.0
        low, high = select(rises, slip, low), select(rises, high, slip)
    return 0.5 * (low + high)


@kernel
def _bisect(p, e, skew):
    """Find slip and force along the trunnion of eight samples, by nested bisection."""
    m, root = motion_at(p, load(e.cosine, 0), load(e.sine, 0)), load(e.root, 0)
    low, high = spread(-force_scale(p)), spread(force_scale(p))
    for _ in range(_BISECTIONS + 1):
        lean = 0.5 * (low + high)
        slip = _bisect_slip(p, m, skew, lean, root)
        store(e.slip, 0, slip)
        store(e.lean, 0, lean)
        rises = _forces(p, m, skew, slip, lean, root).trunnion_force > lean
        low, high = select(rises, lean, low), select(rises, high, lean)


@kernel
def _bisect_stubborn(p, eights, turns, packed, places):
    """Bisect the stubborn samples of every groove, packed into eights."""
    for k in range(3):
        count = 0
        for j in range(WIDTH * eights.shape[1]):
            if eights[k, j // WIDTH].stubborn[0, j % WIDTH] == 1.0:
                e, place = eights[k, j // WIDTH], j % WIDTH
                packed.cosine[0, count], packed.sine[0, count] = e.cosine[0, place], e.sine[0, place]
                packed.root[0, count], places[count] = e.root[0, place], j
                count += 1
            if count == WIDTH or (count > 0 and j == WIDTH * eights.shape[1] - 1):
                _bisect(p, packed, skew_of(turns, k))
                for n in range(count):
                    e, place = eights[k, places[n] // WIDTH], places[n] % WIDTH
                    e.slip[0, place], e.lean[0, place] = packed.slip[0, n], packed.lean[0, n]
                count = 0


@kernel
def _solve_stubborn(p, eights, turns, packed, places):
    """Solve the samples that relaxation left unsettled, with the spider's balance around them; whether it settled."""
    for _ in range(_OUTER):
        _bisect_stubborn(p, eights, turns, packed, places)
        loaded = 0.0
        for _ in range(3):
            loaded = _sweep(p, eights, turns, 1.0)[1]
        if loaded == 0.0:
            return True
    return False


@kernel
def _settle(p, eights, turns, packed, places):
    """Solve a point; whether it settled, and sweeps."""
    for sweep in range(_SWEEPS):
        moved = _sweep(p, eights, turns, 0.0)[0]
        if sweep > 0 and moved == 0.0:
            return True, sweep + 1
    return _solve_stubborn(p, eights, turns, packed, places), _SWEEPS


@kernel
def _account(p, eights, turns, thrust, parts, powers):
    """Thrust of each groove, and at each sample its parts and the powers."""
    for b in range(eights.shape[1]):
        for k in range(3):
            e = eights[k, b]
            m = motion_at(p, load(e.cosine, 0), load(e.sine, 0))
            g = _forces(p, m, skew_of(turns, k), load(e.slip, 0), load(e.lean, 0), load(e.root, 0))
            account(p, m, g, e, k, b, thrust, parts, powers)


@kernel
def solve_still(rows, table, skews, cosines, sines, samples, memory, solution):
    """Solve points in which every sample stands by itself.

    Parameters
    ----------
    rows
        Which points to solve.
    table
        Rows of `PointConstants`.
    skews
        Of the needles of each trunnion in rad, shape (point, 3).
    cosines, sines
        Of the rotation angle of every groove, shape (3, eights, 8).
    samples
        Samples of a revolution.
    memory
        `Memory`.
    solution
        `Solution` to be filled.
    """
    eights, turns, powers = memory.eights, memory.turns, memory.powers
    for i in rows:
        p = point_constants_of(table[i])
        start(p, eights, turns, skews[i], cosines, sines)
        solution.settled[i], solution.sweeps[i] = _settle(p, eights, turns, memory.packed[0], memory.places)
        _account(p, eights, turns, solution.thrust[i], solution.parts[i], powers)
        summarise(p, eights, powers, samples, solution.power[i], solution.residual[i : i + 1], solution.extremes[i])
