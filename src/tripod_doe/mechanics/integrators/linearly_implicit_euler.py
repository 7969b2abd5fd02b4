"""Linearly implicit Euler with the secant slope of friction: one linear solve a step."""

from __future__ import annotations

from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.constraints import evaluate_constraints
from tripod_doe.mechanics.implicit import factorise_system, gather, solve_system
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.monitor import DIVERGED, FINISHED, accept
from tripod_doe.mechanics.motion import accelerate, clear, constraint_rate, linearise
from tripod_doe.mechanics.rotations import move

__all__ = ["METHOD"]


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `contract`."""
    step, begin = (end - clock[0]) / count, clock[0]
    change = work.stages[0]
    linearise(tables, work, positions, velocities, 1.0, step, step * step, work.matrix)
    for n in range(count):
        time = begin + (n + 1) * step
        if tables.rows.size > 0:
            evaluate_constraints(
                tables.rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian
            )
            for k in range(tables.rows.size):  # positions at the end of the step meet the linearised equations
                rate = constraint_rate(tables.rows[k], work.jacobian[k], velocities)
                work.gamma[k] = -rate - work.phi[k] / step
        if not factorise_system(tables, work, positions):
            return DIVERGED
        clear(work.blocks.ravel())
        gather(tables, work.force, step, work.blocks)
        gather(tables, work.drift, -step * step, work.blocks)
        solve_system(tables, work, work.gamma, change)
        for i in range(tables.bodies.size):
            for d in range(6):
                velocities[i, d] += change[i, d]
                change[i, d] = step * velocities[i, d]
            move(positions[i], change[i], positions[i])
        linearise(tables, work, positions, velocities, 1.0, step, step * step, work.matrix)
        accelerate(tables, work, positions, velocities, time, 0.0)
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED


METHOD = Method("linearly-implicit-euler", 1, "linearly implicit Euler with secant friction", integrate, lagged=True)
