"""The balance of a point whose samples follow each other, by relaxation: the kernels behind `kinetostatic`.

Backward differences of second order link a sample to the two before it, around the whole revolution: a recursion over
two laps carries the changes of a sweep on to later samples.
"""

from __future__ import annotations

from tripod_doe.joint.force_balance.added_motion import moving_forces
from tripod_doe.joint.force_balance.point_constants import point_constants_of
from tripod_doe.joint.force_balance.samples import (
    balance_spider,
    changed,
    follow_root,
    force_scale,
    motion_at,
    remember,
    skew_of,
    store_wrench,
    sum_of,
)
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, load, select, spread, store
from tripod_doe.mechanics.compilation.kernels import inlined_kernel, kernel, kernel_part

_SWEEPS, _NEAR = 40, 0.03
"""Tangent slopes overshoot far from the solution, and secant slopes crawl near it: the tangent is taken at samples that
last changed by no more than `_NEAR`. A point that has not settled after this number of sweeps is solved at once
(`coupled_newton`)."""
FRESH, NEAR = -2, 2
"""Number of the first sweep: of a new balance, whose first sweeps find tilts and then spins; of a converged balance
that was changed, for which all slopes are tangents."""


@kernel_part
def _seek(p, eights, turns, newton):
    """Compute the change of every sample, and its sensitivity to changes of earlier samples."""
    for k in range(3):
        skew = skew_of(turns, k)
        for b in range(eights.shape[1]):
            e = eights[k, b]
            cos_phi, sin_phi = load(e.cosine, 0), load(e.sine, 0)
            m = motion_at(p, cos_phi, sin_phi)
            tangent = select(load(e.far, 0) > 0.0, 0.0, newton)
            g = moving_forces(p, m, e, skew, tangent)
            slip_slope, lean_slope = min(g.moment_slope, -1e-30), max(1.0 - g.feedback, 0.5)
            over = 1.0 / (slip_slope * lean_slope)
            over_slip, over_lean = lean_slope * over, slip_slope * over
            store(e.slip_step, 0, -g.moment * over_slip)
            store(e.slip_carry, 0, g.inertia_gain * g.spin_gain * over_slip)
            store(e.lean_step, 0, (g.trunnion_force - load(e.lean, 0)) * over_lean)
            store(e.lean_carry, 0, g.swing_gain * over_lean)
            store(e.tilt, 0, g.sin_a)
            store(e.tilt_gain, 0, g.tilt_gain)
            store(e.spin, 0, g.spin)
            store(e.spin_gain, 0, g.spin_gain)
            store_wrench(p, m, g, e, cos_phi, sin_phi)


@inlined_kernel
def _carry_on(e, i, before):
    """Changes of slip and lean at a sample and the one before it, with the effect of the two earlier changes."""
    slip_1, slip_2, lean_1, lean_2 = before
    slip = e.slip_step[0, i] + e.slip_carry[0, i] * (0.5 * slip_2 - 2.0 * slip_1)
    lean = e.lean_step[0, i] + e.lean_carry[0, i] * (0.5 * lean_2 - 2.0 * lean_1)
    return slip, slip_1, lean, lean_1


@kernel_part
def _follow_on(eights, samples):
    """Turn the separate changes of each groove's samples into changes that include the effect of earlier samples."""
    nothing = (0.0, 0.0, 0.0, 0.0)
    first, second, third = nothing, nothing, nothing
    for j in range(2 * samples):  # the first lap gives the effect on the first samples
        place = j if j < samples else j - samples
        b, i = place // WIDTH, place % WIDTH
        # one groove after the other would wait for each sum
        first = _carry_on(eights[0, b], i, first)
        second = _carry_on(eights[1, b], i, second)
        third = _carry_on(eights[2, b], i, third)
        if j >= samples:
            eights[0, b].slip_step[0, i], eights[0, b].lean_step[0, i] = first[0], first[2]
            eights[1, b].slip_step[0, i], eights[1, b].lean_step[0, i] = second[0], second[2]
            eights[2, b].slip_step[0, i], eights[2, b].lean_step[0, i] = third[0], third[2]
    for k in range(3):
        for j in range(samples, WIDTH * eights.shape[1]):
            place = j - samples
            one, e, i = eights[k, place // WIDTH], eights[k, j // WIDTH], j % WIDTH
            e.slip_step[0, i], e.lean_step[0, i] = one.slip_step[0, place % WIDTH], one.lean_step[0, place % WIDTH]


@kernel_part
def _change(p, e, tolerance):
    """Change the unknowns of eight samples."""
    slip, slip_step, lean, lean_step = load(e.slip, 0), load(e.slip_step, 0), load(e.lean, 0), load(e.lean_step, 0)
    new_slip, new_lean = slip + slip_step, lean + lean_step
    store(e.slip, 0, new_slip)
    store(e.lean, 0, new_lean)
    store(e.tilt, 0, load(e.tilt, 0) + load(e.tilt_gain, 0) * lean_step)
    store(e.spin, 0, load(e.spin, 0) + load(e.spin_gain, 0) * slip_step)
    by_slip, by_lean, lean_scale = abs(new_slip - slip), abs(new_lean - lean), force_scale(p) + 1e-12
    moved = changed(by_slip, tolerance * p.slip_transition) + changed(by_lean, tolerance * lean_scale)
    store(e.moved, 0, moved)
    store(e.far, 0, changed(by_slip, _NEAR * p.slip_transition) + changed(by_lean, _NEAR * lean_scale))


@kernel_part
def _change_all(p, eights, samples, tolerance):
    """Apply the changes of all samples; returns the number of changes above the tolerance."""
    _follow_on(eights, samples)
    moved = spread(0.0)
    for b in range(eights.shape[1]):
        for k in range(3):
            _change(p, eights[k, b], tolerance)
        balance_spider(p, eights[0, b], eights[1, b], eights[2, b])
        for k in range(3):
            e = eights[k, b]
            of_root, root = follow_root(p, e)
            moved = moved + load(e.moved, 0) + changed(of_root, tolerance * root)
            store(e.far, 0, load(e.far, 0) + changed(of_root, _NEAR * root))
    return sum_of(moved)


@kernel
def settle_moving(row, memory, tolerance, first):
    """Relax a point with linked samples; returns whether it converged, and sweeps.

    Parameters as for `equilibrium_relaxation.settle_still`; `tolerance` in place of the row's, and the number of the
    `first` sweep, `FRESH` or `NEAR`.
    """
    p, eights, turns, samples = point_constants_of(row), memory.eights, memory.turns, memory.samples
    for k in range(3):
        for b in range(eights.shape[1]):
            store(eights[k, b].far, 0, spread(0.0))
    for sweep in range(first, _SWEEPS):
        _seek(p, eights, turns, 1.0 if sweep >= NEAR or sweep < 0 else 0.0)
        moved = _change_all(p, eights, samples, tolerance) if sweep >= 0 else 1.0
        remember(memory, 1.0 if sweep >= 0 else 0.0)
        if sweep > 0 and moved == 0.0:
            return True, sweep + 1 - max(first, 0)
    return False, _SWEEPS
