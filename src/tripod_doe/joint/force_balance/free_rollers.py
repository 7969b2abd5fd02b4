"""The balance of rollers that slide freely in their grooves: one unknown per roller, solved by bisection.

Without sliding friction in the groove only the needles act along the trunnion: the spin alone determines slip and
contact angle, and the housing has no axial force. The moment about the trunnion changes sign over all spins, but not
monotonically: needles of small skew and the spinning moment amplify each other, so that Newton's method jumps between
turning points. Bisection finds a spin with zero moment.
"""

from __future__ import annotations

import math

from tripod_doe.joint.force_balance.point_constants import flank, point_constants_of
from tripod_doe.joint.force_balance.roller_forces import STILL, groove_forces, leaning_contact
from tripod_doe.joint.force_balance.samples import (
    balance_spider,
    changed,
    follow_root,
    motion_at,
    skew_of,
    store_wrench,
    sum_of,
)
from tripod_doe.mechanics.arithmetic.simd_lanes import load, select, spread, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel
from tripod_doe.mechanics.laws.needles import needle_grip, needle_slip

_BISECTIONS, _ROUNDS = 90, 12
_BETWEEN = 1e-3
"""Tolerance of the contact ellipse if the iteration alternates between two spins of almost equal load."""
_REACH = 1e6
"""Fastest spin over the speed of the joint: skewed needles alone spin a free roller fast."""


@inlined_kernel
def _forces(p, m, skew, spin, root):
    """Slip, force along the trunnion and forces of a roller with this spin."""
    along_axes = needle_slip(m.along_trunnion, spin, p.needle_lever, skew)
    lean = -p.needle_friction * skew.cosine * needle_grip(along_axes, p.needle_transition)
    contact = leaning_contact(p, m, lean)
    arm = flank(p) * p.roller_radius
    tau_1, z_1 = arm * m.t_z, -arm * contact.t_tau
    tau_0, z_0 = arm * m.w_z, m.along_groove - arm * (contact.cos_a * m.w_r - contact.sin_a * m.w_t)
    rate = math.sqrt(tau_1 * tau_1 + z_1 * z_1)
    slip = (tau_0 * tau_1 + z_0 * z_1) / rate + spin * rate
    return slip, lean, groove_forces(p, m, skew, contact, slip, root, STILL, 1.0)


@kernel
def _bisect(p, e, skew):
    """Find the spins of eight samples."""
    cos_phi, sin_phi, root = load(e.cosine, 0), load(e.sine, 0), load(e.root, 0)
    m = motion_at(p, cos_phi, sin_phi)
    low, high = spread(-_REACH * p.omega), spread(_REACH * p.omega)
    for _ in range(_BISECTIONS):
        spin = 0.5 * (low + high)
        rises = _forces(p, m, skew, spin, root)[2].moment > 0.0
        low, high = select(rises, spin, low), select(rises, high, spin)
    slip, lean, g = _forces(p, m, skew, 0.5 * (low + high), root)
    store(e.slip, 0, slip)
    store(e.lean, 0, lean)
    store_wrench(p, m, g, e, cos_phi, sin_phi)


@kernel
def settle_free(row, memory):
    """Solve a point without sliding friction in its grooves; returns whether it converged, and rounds of bisection.

    Parameters as for `equilibrium_relaxation.settle_still`.
    """
    p, eights = point_constants_of(row), memory.eights
    for turn in range(_ROUNDS):
        limit = p.tolerance if turn < _ROUNDS // 2 else max(p.tolerance, _BETWEEN)
        moved = spread(0.0)
        for b in range(eights.shape[1]):
            for k in range(3):
                _bisect(p, eights[k, b], skew_of(memory.turns, k))
            balance_spider(p, eights[0, b], eights[1, b], eights[2, b])
            for k in range(3):
                of_root, root = follow_root(p, eights[k, b])
                moved = moved + changed(of_root, limit * root)
        if sum_of(moved) == 0.0:
            return True, turn + 1
    return False, _ROUNDS
