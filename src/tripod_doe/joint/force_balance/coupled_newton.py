"""Newton's method for all couplings of a balance at once, for points at which relaxation does not converge.

Relaxation treats one coupling at a time. That fails where couplings decide: a roller whose groove lets it slide freely,
so that only its bearing holds its spin; a straight joint, in which nothing moves; inertia as large as the load. Here
one linear system with exact derivatives of the laws (`dual_numbers`) gives all unknowns.

A sample has nine unknowns: slip and force along the trunnion (over N) of every roller, and the normal forces over their
mean; and nine equations: two for every roller, three for the spider. In a massless joint samples are independent; each
starts from the two before it, so that a roller with two possible balances stays in its present one. Else earlier
samples act only through h = y_(-2) / 2 - 2 y_(-1), with y = (sin a, spin) of every roller. So each sample is solved
alone, with its sensitivity to h; a linear recursion around the revolution remains, closed by the twelve unknowns before
the first sample.

Far from the solution, the tangents of friction mislead. Then all transition velocities are enlarged until friction is
almost viscous and the iteration converges, and are reduced again in the largest steps that converge.
"""

from __future__ import annotations

import math

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.force_balance.added_motion import added_motion
from tripod_doe.joint.force_balance.periodic_system import link_samples, solve_samples
from tripod_doe.joint.force_balance.point_constants import TRANSITIONS, mean_load, point_constants_of
from tripod_doe.joint.force_balance.roller_forces import groove_forces, leaning_contact, spider_wrench
from tripod_doe.joint.force_balance.samples import Memory, force_scale, motion_at, remember, repeat_first, skew_of
from tripod_doe.mechanics.arithmetic.dual_numbers import variable
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH, clear, pick
from tripod_doe.mechanics.compilation.kernels import inner_kernel, kernel, kernel_part

_HASTY, _PATIENT, _IN_ALL = 12, 30, 500
"""Largest numbers of iterations of a step of the transition velocities for the hasty and the patient, and of all steps.
Three of four such points take 60 in total; points below 2 deg with steep friction up to 450."""
_SMALL_STRIDE, _HALVINGS, _STALLED = 1.2, 4, 5
"""Stride (a power of two) below which an iteration is patient; most consecutive halved changes; most iterations without
halving the change."""
_LARGEST_LEAN, _LARGEST_LOAD = 0.3, 0.7
"""Largest change in an iteration: of the force along a trunnion (over N), and of a normal force over the mean one."""
_WIDEST, _ON_THE_WAY = 10.0, 1e-4
"""Largest power of two that enlarges transition velocities, and the tolerance while they are enlarged."""
_BEFORE, _NOW, _SOLVED, _EARLIER = 0, 1, 2, 3
"""Indices of stored unknowns: before and after the last change, last solution, and the solution before it."""


@inner_kernel
def _place(matrix, row, k, number):
    """Write the derivatives of an equation for the unknowns of roller k and for earlier samples, and add its value."""
    matrix[row, 2 * k], matrix[row, 2 * k + 1] = pick(number, 1), pick(number, 2)
    matrix[row, 6 + k] = pick(number, 3)
    matrix[row, 9] += pick(number, 0)
    matrix[row, 10 + 2 * k], matrix[row, 11 + 2 * k] = pick(number, 4), pick(number, 5)


@inner_kernel
def _linearise_roller(row, skew, e, i, k, matrix, follows):
    """Write one roller's part of the equations of a sample, and how its tilt and spin follow from the unknowns."""
    p = point_constants_of(row)
    even_load = mean_load(p)
    cos_phi, sin_phi = e.cosine[0, i], e.sine[0, i]
    m = motion_at(p, cos_phi, sin_phi)
    slip, lean = variable(e.slip[0, i], 1), variable(e.lean[0, i], 2)
    normal = even_load * variable(e.normal[0, i] / even_load, 3)
    past_tilt, past_spin = variable(e.past_tilt[0, i], 4), variable(e.past_spin[0, i], 5)
    size = max(e.normal[0, i], 3e-3 * even_load)  # as `follow_root` does
    e.root[0, i] = p.axis_factor * size ** (1.0 / 3.0)
    root = e.root[0, i] * (1.0 + (max(normal, 3e-3 * even_load) - size) / (3.0 * size))
    contact = leaning_contact(p, m, lean)
    given = e.needle_force[0, i], e.needle_moment[0, i], e.needle_swing[0, i], e.steering[0, i]
    added = added_motion(p, m, contact, cos_phi, root, past_tilt, past_spin, given)
    g = groove_forces(p, m, skew, contact, slip, root, added, 1.0)
    across_1, across_2, about_shaft, _ = spider_wrench(p, m, g, cos_phi, sin_phi)
    _place(matrix, 2 * k, k, normal * g.moment / (even_load * p.roller_radius))
    _place(matrix, 2 * k + 1, k, g.trunnion_force - lean)
    _place(matrix, 6, k, (normal * across_1 + e.load_1[0, i]) / even_load)
    _place(matrix, 7, k, (normal * across_2 + e.load_2[0, i]) / even_load)
    about = normal * about_shaft + (e.load_about[0, i] - p.torque / 3.0)
    _place(matrix, 8, k, about / (even_load * p.pitch_radius))
    for d in range(6):
        follows[2 * k, d], follows[2 * k + 1, d] = pick(g.sin_a, d), pick(g.spin, d)
    follows[2 * k, 0] -= e.tilt[0, i]
    follows[2 * k + 1, 0] -= e.spin[0, i]


@kernel
def _linearise(row, memory, first, last):
    """Write the equations of samples."""
    for j in range(first, last):
        clear(memory.lap.equations[j])
        for k in range(3):
            e = memory.eights[k, j // WIDTH]
            skew = skew_of(memory.turns, k)
            _linearise_roller(row, skew, e, j % WIDTH, k, memory.lap.equations[j], memory.lap.follows[j])


@inner_kernel
def _largest_changes(row, lap, first, last):
    """Largest changes of slip over its transition velocity, of force along the trunnion, and of load over its mean.

    The first value is infinite if the linear system has no solution.
    """
    slip, lean, load, all_of_them = 0.0, 0.0, 0.0, 0.0
    for j in range(first, last):
        for k in range(3):
            of_slip, of_lean, of_load = lap.changes[j, 2 * k, 0], lap.changes[j, 2 * k + 1, 0], lap.changes[j, 6 + k, 0]
            slip, lean, load = max(slip, abs(of_slip)), max(lean, abs(of_lean)), max(load, abs(of_load))
            all_of_them += of_slip + of_lean + of_load
    return slip / point_constants_of(row).slip_transition if abs(all_of_them) < math.inf else math.inf, lean, load


@inner_kernel
def _change(row, memory, first, last, part):
    """Add a part of the Newton step to all unknowns."""
    lap, even_load = memory.lap, mean_load(point_constants_of(row))
    for k in range(3):
        for j in range(first, last):
            e, i = memory.eights[k, j // WIDTH], j % WIDTH
            e.slip[0, i] += part * lap.changes[j, 2 * k, 0]
            e.lean[0, i] += part * lap.changes[j, 2 * k + 1, 0]
            e.normal[0, i] += part * lap.changes[j, 6 + k, 0] * even_load
            e.tilt[0, i] += part * lap.steps[j, 2 * k, 0]
            e.spin[0, i] += part * lap.steps[j, 2 * k + 1, 0]


@inner_kernel
def _note(memory, first, last, notes):
    """Store the unknowns."""
    for k in range(3):
        for j in range(first, last):
            e, i, noted = memory.eights[k, j // WIDTH], j % WIDTH, notes[k, j]
            noted[0], noted[1], noted[2] = e.slip[0, i], e.lean[0, i], e.normal[0, i]
            noted[3], noted[4] = e.tilt[0, i], e.spin[0, i]


@inner_kernel
def _set(memory, first, last, notes, part, others):
    """Restore stored unknowns, and add a part of their difference from other stored ones."""
    for k in range(3):
        for j in range(first, last):
            e, i, a, b = memory.eights[k, j // WIDTH], j % WIDTH, notes[k, j], others[k, j]
            e.slip[0, i], e.lean[0, i] = a[0] + part * (a[0] - b[0]), a[1] + part * (a[1] - b[1])
            e.normal[0, i] = a[2] + part * (a[2] - b[2])
            e.tilt[0, i], e.spin[0, i] = a[3] + part * (a[3] - b[3]), a[4] + part * (a[4] - b[4])


@inner_kernel
def _guess(memory, j):
    """Extrapolate a sample from the two before it."""
    last, other = j - 1, max(j - 2, 0)
    for k in range(3):
        e, i = memory.eights[k, j // WIDTH], j % WIDTH
        a, n, b, m = memory.eights[k, last // WIDTH], last % WIDTH, memory.eights[k, other // WIDTH], other % WIDTH
        e.slip[0, i], e.lean[0, i] = 2.0 * a.slip[0, n] - b.slip[0, m], 2.0 * a.lean[0, n] - b.lean[0, m]
        e.normal[0, i] = 2.0 * a.normal[0, n] - b.normal[0, m]


@kernel_part
def _iterate(row, memory, first, last, tolerance, patient, most):
    """Newton's method from the present unknowns; whether it converged to the tolerance, and iterations.

    If the next change would be larger than the last one, a patient iteration takes half of the last change back; others
    stop. All stop when changes no longer decrease.
    """
    p, noted = point_constants_of(row), memory.noted
    linked, lean_scale = p.pace > 0.0, force_scale(p) + 1e-12
    least, halvings, fallen, at = math.inf, 0, math.inf, 0
    for iteration in range(most):
        if linked:
            remember(memory, 1.0)
        _linearise(row, memory, first, last)
        solve_samples(memory.lap, first, last, linked)
        if linked:
            link_samples(memory.lap)
        slip, lean, load = _largest_changes(row, memory.lap, first, last)
        largest = max(slip, lean / lean_scale, load)
        if largest < 0.5 * fallen:
            fallen, at = largest, iteration
        overshoots = slip > 1.5 * least or slip == math.inf
        halvings = halvings + 1 if overshoots else 0
        if iteration - at >= _STALLED or halvings > (_HALVINGS if patient else 0):
            return False, iteration + 1
        if overshoots:
            _note(memory, first, last, noted[_NOW])
            _set(memory, first, last, noted[_BEFORE], -0.5, noted[_NOW])
            continue
        least = slip
        _note(memory, first, last, noted[_BEFORE])
        _change(row, memory, first, last, min(1.0, _LARGEST_LEAN / max(lean, 1e-30), _LARGEST_LOAD / max(load, 1e-30)))
        if slip <= tolerance and lean <= tolerance * lean_scale and load <= tolerance:
            return True, iteration + 1
    return False, most


@inner_kernel
def _widen(row, power, wide):
    """Write the row with transition velocities enlarged by a power of two."""
    for at in range(row.size):
        wide[at] = row[at]
    for at in TRANSITIONS:
        wide[at] *= 2.0**power


@kernel_part
def _solve(row, memory, first, last, most):
    """Solve independent samples; returns whether they converged, and iterations.

    Each sample but the first starts from an extrapolation; if that fails, from its previous values.
    """
    tolerance, done = point_constants_of(row).tolerance, 0
    power, stride, reached, before = 0.0, 3.0, math.inf, math.inf
    solved, earlier = _SOLVED, _EARLIER
    _note(memory, first, last, memory.noted[solved])
    _note(memory, first, last, memory.noted[earlier])
    if first > 0:
        _guess(memory, first)
    while done < most:
        _widen(row, power, memory.wide)
        patient = stride < _SMALL_STRIDE or power == _WIDEST
        goal = tolerance if power == 0.0 else max(tolerance, _ON_THE_WAY)
        allowed = min(_PATIENT if patient else _HASTY, most - done)
        well, count = _iterate(memory.wide, memory, first, last, goal, patient, allowed)
        done += count
        if well and power == 0.0:
            return True, done
        if well:
            solved, earlier = earlier, solved
            _note(memory, first, last, memory.noted[solved])
            reached, before, stride = power, reached, 1.5 * stride
        elif reached < math.inf:
            stride = 0.5 * (reached - power)
        elif power == _WIDEST:
            return False, done
        power = min(power + stride, _WIDEST) if reached == math.inf else max(reached - stride, 0.0)
        ahead = 0.0  # extrapolation from the last two solutions
        if before < math.inf:
            ahead = (2.0**reached - 2.0**power) / (2.0**before - 2.0**reached)
        _set(memory, first, last, memory.noted[solved], ahead, memory.noted[earlier])
    return False, done


@kernel
def _solve_all(row, memory, most):
    """Solve all samples: linked ones at once, others each from the samples before it.

    Returns whether all converged, and iterations times the samples in each.
    """
    length, done = memory.samples if point_constants_of(row).pace > 0.0 else 1, 0
    for first in range(0, memory.samples, length):
        converged, iterations = _solve(row, memory, first, first + length, most)
        done += iterations * length
        if not converged:
            return False, done
    return True, done


def settle_together(row: FloatArray, memory: Memory) -> tuple[bool, int]:
    """Solve a point; returns whether it converged, and iterations of the whole revolution.

    Parameters as for `equilibrium_relaxation.settle_still`.
    """
    settled, of_samples = _solve_all(row, memory, _IN_ALL)
    if settled:
        remember(memory, 1.0)
        repeat_first(memory)
    return settled, -(-of_samples // memory.samples)


def loads_at_rest(row: FloatArray, memory: Memory) -> FloatArray:
    """Normal forces over their mean that keep the spider in balance before any roller slips or leans, (sample, 3).

    Parameters as for `settle_together`.
    """
    remember(memory, 1.0)
    _linearise(row, memory, 0, memory.samples)
    spider = memory.lap.equations[:, 6:9]
    change = np.linalg.solve(spider[..., 6:9], spider[..., 9:10])[..., 0]
    return np.asarray(1.0 - change, float)
