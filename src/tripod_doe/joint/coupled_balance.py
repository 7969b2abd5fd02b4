"""The balance of a whole revolution at once, by Newton's method: for points at which relaxation does not settle.

Relaxation treats one coupling at a time. That fails where couplings decide: a roller whose groove lets it slide freely,
so that only its bearing holds its spin; a straight joint, in which nothing moves; inertia as large as the load. Here
all unknowns of all samples follow from one linear system, the derivatives of the laws themselves (`derivatives`).

A sample has nine unknowns: slip and force along the trunnion (over N) of every roller, and the normal forces over their
mean; and nine equations: two for every roller, three for the spider. Earlier samples act by y_(-2) / 2 - 2 y_(-1) only,
with y = (sin a, spin) of every roller. So every sample is solved for itself, with its answer to a change of that, and
what is left is a linear recursion around the revolution, closed by the twelve unknowns before the first sample.

Far from the solution, friction's tangents mislead. Then all transition velocities are enlarged until friction is all
but viscous, which is solved, and reduced again in steps as large as the iteration allows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.balance_constants import TRANSITIONS, PointConstants, point_constants_of
from tripod_doe.joint.linear_lap import solve_lap
from tripod_doe.joint.moving_roller import added_motion
from tripod_doe.joint.revolution import Memory, force_scale, motion_at, remember, repeat_first, skew_of
from tripod_doe.joint.roller_balance import groove_forces, leaning_contact, spider_wrench
from tripod_doe.mechanics.compilation import inlined_kernel, kernel
from tripod_doe.mechanics.derivatives import variable
from tripod_doe.mechanics.lanes import WIDTH, clear, pick

__all__ = ["loads_at_rest", "settle_together"]

FloatArray = NDArray[np.float64]

_ITERATIONS, _IN_ALL, _HALVINGS, _STALLED, _PATIENT = (12, 30), 500, 4, 5, 1.2
"""Largest numbers of iterations of a step of the transition velocities, for the hasty and the patient, and of a point;
of halved changes one after another, and of iterations in which changes do not fall to half; and the stride (a power of
two) below which one is patient. Three in four points that come here take 60 in all; below 2 deg, with steep friction,
up to 450."""
_LARGEST_LEAN, _LARGEST_LOAD = 0.3, 0.7
"""Largest change in an iteration: of the force along a trunnion (over N), and of a normal force over the mean one."""
_WIDEST, _ON_THE_WAY = 10.0, 1e-4
"""Power of two by which transition velocities are enlarged at most, and the tolerance while they are."""


@inlined_kernel
def _mean_load(row):
    """Of a groove, in N."""
    p = point_constants_of(row)
    return abs(p.torque) / (3.0 * p.pitch_radius)


@kernel
def _place(matrix, row, k, number):
    """Write an equation's derivatives for the unknowns of roller k and for what came before, and add its value."""
    matrix[row, 2 * k], matrix[row, 2 * k + 1] = pick(number, 1), pick(number, 2)
    matrix[row, 6 + k] = pick(number, 3)
    matrix[row, 9] += pick(number, 0)
    matrix[row, 10 + 2 * k], matrix[row, 11 + 2 * k] = pick(number, 4), pick(number, 5)


@kernel
def _linearise_roller(row, skew, e, i, k, matrix, follows):
    """Write one roller's part of the equations of a sample, and how its tilt and spin follow from the unknowns."""
    p = point_constants_of(row)
    mean_load = _mean_load(row)
    cos_phi, sin_phi = e.cosine[0, i], e.sine[0, i]
    m = motion_at(p, cos_phi, sin_phi)
    slip, lean = variable(e.slip[0, i], 1), variable(e.lean[0, i], 2)
    normal = mean_load * variable(e.normal[0, i] / mean_load, 3)
    past_tilt, past_spin = variable(e.past_tilt[0, i], 4), variable(e.past_spin[0, i], 5)
    size = max(e.normal[0, i], 3e-3 * mean_load)  # as `follow_root` does
    e.root[0, i] = p.axis_factor * size ** (1.0 / 3.0)
    root = e.root[0, i] * (1.0 + (max(normal, 3e-3 * mean_load) - size) / (3.0 * size))
    contact = leaning_contact(p, m, lean)
    given = e.needle_force[0, i], e.needle_moment[0, i], e.needle_swing[0, i], e.steering[0, i]
    added = added_motion(p, m, contact, cos_phi, root, past_tilt, past_spin, given)
    g = groove_forces(p, m, skew, contact, slip, root, added, 1.0)
    across_1, across_2, about_shaft, _ = spider_wrench(p, m, g, cos_phi, sin_phi)
    _place(matrix, 2 * k, k, normal * g.moment / (mean_load * p.roller_radius))
    _place(matrix, 2 * k + 1, k, g.trunnion_force - lean)
    _place(matrix, 6, k, (normal * across_1 + e.load_1[0, i]) / mean_load)
    _place(matrix, 7, k, (normal * across_2 + e.load_2[0, i]) / mean_load)
    about = normal * about_shaft + (e.load_about[0, i] - p.torque / 3.0)
    _place(matrix, 8, k, about / (mean_load * p.pitch_radius))
    for d in range(6):
        follows[2 * k, d], follows[2 * k + 1, d] = pick(g.sin_a, d), pick(g.spin, d)
    follows[2 * k, 0] -= e.tilt[0, i]
    follows[2 * k + 1, 0] -= e.spin[0, i]


@kernel
def _linearise(row, memory):
    """Write the equations of all samples."""
    equations, follows = memory.lap.equations, memory.lap.follows
    clear(equations)
    for j in range(memory.samples):
        for k in range(3):
            e = memory.eights[k, j // WIDTH]
            _linearise_roller(row, skew_of(memory.turns, k), e, j % WIDTH, k, equations[j], follows[j])


@kernel
def _largest_changes(row, lap):
    """Largest changes of slip over its transition velocity, of force along the trunnion, and of load over its mean.

    The first is infinite where the linear system had no solution.
    """
    slip, lean, load, all_of_them = 0.0, 0.0, 0.0, 0.0
    for j in range(lap.steps.shape[0]):
        for k in range(3):
            of_slip, of_lean, of_load = lap.changes[j, 2 * k, 0], lap.changes[j, 2 * k + 1, 0], lap.changes[j, 6 + k, 0]
            slip, lean, load = max(slip, abs(of_slip)), max(lean, abs(of_lean)), max(load, abs(of_load))
            all_of_them += of_slip + of_lean + of_load
    return slip / point_constants_of(row).slip_transition if abs(all_of_them) < math.inf else math.inf, lean, load


@kernel
def _scale_of_lean(row):
    """How large the force along a trunnion may be, over the mean normal force."""
    return force_scale(point_constants_of(row)) + 1e-12


@kernel
def _change(row, memory, part):
    """Change all unknowns by a part of what was worked out."""
    lap, mean_load = memory.lap, _mean_load(row)
    for k in range(3):
        for j in range(lap.steps.shape[0]):
            e, i = memory.eights[k, j // WIDTH], j % WIDTH
            e.slip[0, i] += part * lap.changes[j, 2 * k, 0]
            e.lean[0, i] += part * lap.changes[j, 2 * k + 1, 0]
            e.normal[0, i] += part * lap.changes[j, 6 + k, 0] * mean_load
            e.tilt[0, i] += part * lap.steps[j, 2 * k, 0]
            e.spin[0, i] += part * lap.steps[j, 2 * k + 1, 0]
    remember(memory, 1.0)


def _iterate(row: FloatArray, memory: Memory, tolerance: float, patient: bool, most: int) -> tuple[bool, int]:
    """Newton's method from what is there; whether it converged to the tolerance, and iterations, at most so many.

    Where the next change would be larger than the last one, the patient take half of that back; others give up. All
    give up where changes have stopped falling.
    """
    least, halvings, lean_scale, before = math.inf, 0, _scale_of_lean(row), memory.state.copy()
    linked, fallen, at = PointConstants(*row).pace > 0, math.inf, 0
    for iteration in range(most):
        _linearise(row, memory)
        solve_lap(memory.lap, linked)
        slip, lean, load = _largest_changes(row, memory.lap)
        largest = max(slip, lean / lean_scale, load)
        if largest < 0.5 * fallen:
            fallen, at = largest, iteration
        overshoots = slip > 1.5 * least or slip == math.inf
        halvings = halvings + 1 if overshoots else 0
        if iteration - at >= _STALLED or halvings > (_HALVINGS if patient else 0):
            return False, iteration + 1
        if overshoots:
            memory.state[:] = 0.5 * (before + memory.state)
            remember(memory, 1.0)
            continue
        least, before[:] = slip, memory.state
        _change(row, memory, min(1.0, _LARGEST_LEAN / max(lean, 1e-30), _LARGEST_LOAD / max(load, 1e-30)))
        if slip <= tolerance and lean <= tolerance * lean_scale and load <= tolerance:
            return True, iteration + 1
    return False, most


def settle_together(row: FloatArray, memory: Memory) -> tuple[bool, int]:
    """Solve a point.

    Parameters
    ----------
    row
        Of the table of `PointConstants`.
    memory
        `Memory`, in which the point was started.

    Returns
    -------
    tuple
        Whether it settled, and iterations.
    """
    tolerance, done = PointConstants(*row).tolerance, 0
    power, stride, reached, before = 0.0, 3.0, math.inf, math.inf
    remember(memory, 1.0)
    kept = earlier = memory.state.copy()
    while done < _IN_ALL:
        wide = row.copy()
        wide[list(TRANSITIONS)] *= 2.0**power
        goal = tolerance if power == 0.0 else max(tolerance, _ON_THE_WAY)
        patient = stride < _PATIENT or power == _WIDEST
        well, count = _iterate(wide, memory, goal, patient, min(_ITERATIONS[patient], _IN_ALL - done))
        done += count
        if well and power == 0.0:
            repeat_first(memory)
            return True, done
        if well:
            kept, earlier = memory.state.copy(), kept
            reached, before, stride = power, reached, 1.5 * stride
        elif reached < math.inf:
            stride = 0.5 * (reached - power)
        elif power == _WIDEST:
            return False, done
        power = min(power + stride, _WIDEST) if reached == math.inf else max(reached - stride, 0.0)
        memory.state[:] = kept
        if before < math.inf:  # go on as it went from the last solution but one to the last one
            memory.state[:] += (2.0**reached - 2.0**power) / (2.0**before - 2.0**reached) * (kept - earlier)
        remember(memory, 1.0)
    return False, done


def loads_at_rest(row: FloatArray, memory: Memory) -> FloatArray:
    """Normal forces over their mean that keep the spider in balance before any roller slips or leans, (sample, 3).

    Parameters as for `settle_together`.
    """
    remember(memory, 1.0)
    _linearise(row, memory)
    spider = memory.lap.equations[:, 6:9]
    change = np.linalg.solve(spider[..., 6:9], spider[..., 9:10])[..., 0]
    return np.asarray(1.0 - change, float)
