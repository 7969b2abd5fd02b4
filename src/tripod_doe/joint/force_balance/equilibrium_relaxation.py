"""The balance of all grooves at all rotation angles of a point, by relaxation: the kernels behind `equilibrium`.

Every sample is relaxed alone: Newton's method for the slip along the rolling direction and an accelerated iteration for
the contact angle, until no sample of the point changes. Points that do not converge (nearly discontinuous friction,
rollers that slide freely) are left to `coupled_newton`.
"""

from __future__ import annotations

from tripod_doe.joint.force_balance.point_constants import point_constants_of
from tripod_doe.joint.force_balance.roller_forces import STILL, groove_forces, leaning_contact
from tripod_doe.joint.force_balance.samples import (
    balance_spider,
    changed,
    follow_root,
    force_scale,
    motion_at,
    skew_of,
    store_wrench,
    sum_of,
)
from tripod_doe.mechanics.arithmetic.simd_lanes import load, spread, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part

_SWEEPS = 30


@inlined_kernel
def _forces(p, m, skew, slip, lean, root):
    """Forces of a roller without mass that stays where it is between samples."""
    return groove_forces(p, m, skew, leaning_contact(p, m, lean), slip, root, STILL, 1.0)


@kernel_part
def _relax(p, e, skew):
    """Change the unknowns of eight samples."""
    cos_phi, sin_phi = load(e.cosine, 0), load(e.sine, 0)
    m = motion_at(p, cos_phi, sin_phi)
    slip, lean = load(e.slip, 0), load(e.lean, 0)
    g = _forces(p, m, skew, slip, lean, load(e.root, 0))
    new_slip = slip - g.moment / min(g.moment_slope, -1e-30)
    new_lean = lean + (g.trunnion_force - lean) / max(1.0 - g.feedback, 0.5)
    store(e.slip, 0, new_slip)
    store(e.lean, 0, new_lean)
    store_wrench(p, m, g, e, cos_phi, sin_phi)
    by_slip = changed(abs(new_slip - slip), p.tolerance * p.slip_transition)
    store(e.moved, 0, by_slip + changed(abs(new_lean - lean), p.tolerance * (force_scale(p) + 1e-12)))


@kernel_part
def _sweep(p, eights, turns):
    """Relax all samples once; returns the number of samples that changed more than the tolerance."""
    moved = spread(0.0)
    for b in range(eights.shape[1]):
        for k in range(3):
            _relax(p, eights[k, b], skew_of(turns, k))
        balance_spider(p, eights[0, b], eights[1, b], eights[2, b])
        for k in range(3):
            e = eights[k, b]
            of_root, root = follow_root(p, e)
            moved = moved + load(e.moved, 0) + changed(of_root, p.tolerance * root)
    return sum_of(moved)


@kernel
def settle_still(row, memory):
    """Relax a point with independent samples; returns whether it converged, and sweeps.

    Args:
        row: Of the table of `PointConstants`.
        memory: `Memory`, in which the point was started.
    """
    p = point_constants_of(row)
    for sweep in range(_SWEEPS):
        moved = _sweep(p, memory.eights, memory.turns)
        if sweep > 0 and moved == 0.0:
            return True, sweep + 1
    return False, _SWEEPS
