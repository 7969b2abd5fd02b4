"""The two-step backward differentiation formula with secant iterations: second order, L-stable.

p = (4 p_n - p_(n-1)) / 3 + (2 h / 3) Q(q, u) for the momenta, and the same for displacements counted from q_n, where
the attitude at t_(n-1) enters as its rotation vector from that at t_n. The first step uses implicit Euler: its error of
second order in h occurs only once. A step whose equations do not converge is also done by implicit Euler, in parts:
else a light rattling body would end a run on which it has little effect.
"""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import load_attitude, rotation_vector
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import kernel, kernel_part
from tripod_doe.mechanics.forces.inertia import add_momenta
from tripod_doe.mechanics.integrators.monitor import DIVERGED, FINISHED, accept
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors
from tripod_doe.mechanics.solve.newton import LEAST_SHARE, Stage, solve_stage
from tripod_doe.mechanics.tables import REJECTED

_START, _BASE, _OLD_POSITIONS, _OLD_VELOCITIES = range(4)
"""Rows of `Work.stages`."""

_MOST_PARTS = 16


@kernel_part
def _in_parts(tables, work, end, step, settings, positions, velocities):
    """Advance by implicit Euler in halves, quarters and so on of a step until all converge; whether they do."""
    start, base = work.stages[_START], work.stages[_BASE]
    clear(base)
    parts, done = 1, 0
    while done < parts < _MOST_PARTS:
        work.counters[REJECTED] += 1
        copy_vectors(work.stages[_OLD_POSITIONS], positions)
        copy_vectors(work.stages[_OLD_VELOCITIES], velocities)
        parts, done = 2 * parts, 0
        part, converged = step / parts, True
        while converged and done < parts:
            copy_vectors(positions, start)
            clear(work.momenta)
            add_momenta(tables, start, velocities, 1.0, part, work.momenta)
            stage = Stage(start, base, work.nothing, part, part, end - (parts - 1 - done) * part)
            converged = solve_stage(
                tables, work, stage, settings.iterations, settings.correction, LEAST_SHARE, positions, velocities
            )
            if converged:
                done += 1
    return done == parts


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `method_interface`. clock[1] holds the step of the history."""
    bodies = tables.bodies.size
    step, begin = (end - clock[0]) / count, clock[0]
    start, base = work.stages[_START], work.stages[_BASE]
    old_positions, old_velocities = work.stages[_OLD_POSITIONS], work.stages[_OLD_VELOCITIES]
    for n in range(count):
        copy_vectors(positions, start)
        time = begin + (n + 1) * step
        has_history = abs(clock[1] - step) <= 1e-6 * step
        factor = 2.0 / 3.0 * step if has_history else step
        for i in range(bodies):
            turn = rotation_vector(load_attitude(old_positions[i]), load_attitude(start[i]))
            for d in range(6):
                behind = old_positions[i, d] - start[i, d] if d < 3 else turn[d - 3]
                base[i, d] = -behind / 3.0 if has_history else 0.0
        clear(work.momenta)
        add_momenta(tables, start, velocities, 4.0 / 3.0 if has_history else 1.0, step, work.momenta)
        if has_history:
            add_momenta(tables, old_positions, old_velocities, -1.0 / 3.0, 2.0 * step, work.momenta)
        copy_vectors(start, old_positions)
        copy_vectors(velocities, old_velocities)
        stage = Stage(start, base, work.nothing, factor, factor, time)
        if not solve_stage(
            tables, work, stage, settings.iterations, settings.correction, LEAST_SHARE, positions, velocities
        ) and not _in_parts(tables, work, time, step, settings, positions, velocities):
            return DIVERGED
        clock[1] = step
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED
