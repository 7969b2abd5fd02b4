"""The balance of a point whose samples follow each other, by relaxation: the kernels behind `kinetostatic`.

A sample follows the two before it, by backward differences of second order around the whole revolution: what a sweep
changes at one sample is carried on to the next ones by a recursion, two laps of it.
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
from tripod_doe.mechanics.arithmetic.lanes import WIDTH, load, spread, store
from tripod_doe.mechanics.compilation.kernels import kernel, kernel_part

_SWEEPS, _NEAR = 40, 0.03
"""Tangent slopes overshoot far from the solution, and secant slopes crawl near it: the tangent is taken once no sample
changes by more than `_NEAR`. A point that has not settled after this number of sweeps is solved at once
(`coupled_newton`)."""


@kernel_part
def _seek(p, eights, turns, newton):
    """Find what every sample wants to change, and how the changes before it add to that."""
    for k in range(3):
        skew = skew_of(turns, k)
        for b in range(eights.shape[1]):
            e = eights[k, b]
            cos_phi, sin_phi = load(e.cosine, 0), load(e.sine, 0)
            m = motion_at(p, cos_phi, sin_phi)
            g = moving_forces(p, m, e, skew, newton)
            slip_slope, lean_slope = min(g.moment_slope, -1e-30), max(1.0 - g.feedback, 0.5)
            store(e.slip_step, 0, -g.moment / slip_slope)
            store(e.slip_carry, 0, g.inertia_gain * g.spin_gain / slip_slope)
            store(e.lean_step, 0, (g.trunnion_force - load(e.lean, 0)) / lean_slope)
            store(e.lean_carry, 0, g.swing_gain / lean_slope)
            store(e.tilt, 0, g.sin_a)
            store(e.tilt_gain, 0, g.tilt_gain)
            store(e.spin, 0, g.spin)
            store(e.spin_gain, 0, g.spin_gain)
            store_wrench(p, m, g, e, cos_phi, sin_phi)


@kernel_part
def _follow_on(eights, samples):
    """Turn what the samples of each groove want to change into changes that follow those before them."""
    for k in range(3):
        slip_1, slip_2, lean_1, lean_2 = 0.0, 0.0, 0.0, 0.0
        for j in range(2 * samples):  # a lap to know what reaches the first samples
            place = j if j < samples else j - samples
            e, i = eights[k, place // WIDTH], place % WIDTH
            slip_1, slip_2 = e.slip_step[0, i] + e.slip_carry[0, i] * (0.5 * slip_2 - 2.0 * slip_1), slip_1
            lean_1, lean_2 = e.lean_step[0, i] + e.lean_carry[0, i] * (0.5 * lean_2 - 2.0 * lean_1), lean_1
            if j >= samples:
                e.slip_step[0, i], e.lean_step[0, i] = slip_1, lean_1
        for j in range(samples, WIDTH * eights.shape[1]):
            place = j - samples
            first, e, i = eights[k, place // WIDTH], eights[k, j // WIDTH], j % WIDTH
            e.slip_step[0, i], e.lean_step[0, i] = first.slip_step[0, place % WIDTH], first.lean_step[0, place % WIDTH]


@kernel_part
def _change(p, e):
    """Change the unknowns of eight samples."""
    slip, slip_step, lean, lean_step = load(e.slip, 0), load(e.slip_step, 0), load(e.lean, 0), load(e.lean_step, 0)
    new_slip, new_lean = slip + slip_step, lean + lean_step
    store(e.slip, 0, new_slip)
    store(e.lean, 0, new_lean)
    store(e.tilt, 0, load(e.tilt, 0) + load(e.tilt_gain, 0) * lean_step)
    store(e.spin, 0, load(e.spin, 0) + load(e.spin_gain, 0) * slip_step)
    by_slip, by_lean, lean_scale = abs(new_slip - slip), abs(new_lean - lean), force_scale(p) + 1e-12
    moved = changed(by_slip, p.tolerance * p.slip_transition) + changed(by_lean, p.tolerance * lean_scale)
    store(e.moved, 0, moved)
    store(e.far, 0, changed(by_slip, _NEAR * p.slip_transition) + changed(by_lean, _NEAR * lean_scale))


@kernel_part
def _change_all(p, eights, samples):
    """Change all samples as they want; how many changes exceed the tolerance, and how many exceed `_NEAR`."""
    _follow_on(eights, samples)
    moved, far = spread(0.0), spread(0.0)
    for b in range(eights.shape[1]):
        for k in range(3):
            _change(p, eights[k, b])
        balance_spider(p, eights[0, b], eights[1, b], eights[2, b])
        for k in range(3):
            e = eights[k, b]
            of_root, root = follow_root(p, e)
            moved = moved + load(e.moved, 0) + changed(of_root, p.tolerance * root)
            far = far + load(e.far, 0) + changed(of_root, _NEAR * root)
    return sum_of(moved), sum_of(far)


@kernel
def settle_moving(row, memory):
    """Relax a point in which every sample follows those before it; whether it settled, and sweeps.

    Parameters as for `equilibrium_relaxation.settle_still`.
    """
    p, eights, turns, samples = point_constants_of(row), memory.eights, memory.turns, memory.samples
    newton = 1.0
    for sweep in range(-2, _SWEEPS):  # before the first: tilts, then the spins that go with them
        _seek(p, eights, turns, newton)
        moved, far = 1.0, 1.0
        if sweep >= 0:
            moved, far = _change_all(p, eights, samples)
        remember(memory, 1.0 if sweep >= 0 else 0.0)
        if sweep > 0 and moved == 0.0:
            return True, sweep + 1
        newton = 1.0 if sweep == -2 or (far == 0.0 and sweep > 0) else 0.0
    return False, _SWEEPS
