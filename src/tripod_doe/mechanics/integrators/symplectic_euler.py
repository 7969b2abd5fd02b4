"""Symplectic Euler: u' = u + h a(q, u), q' = q + h u'. Explicit in friction, so limited by 2 m_eff v_st / (mu f_n)."""

from __future__ import annotations

from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.monitor import EVALUATION_LIMIT, FINISHED, watch
from tripod_doe.mechanics.motion import evaluate, project_positions, project_velocities
from tripod_doe.mechanics.rotations import move

__all__ = ["METHOD"]


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `contract`."""
    step = (end - clock[0]) / count
    begin = clock[0]
    displacement = work.stages[0]
    evaluate(tables, work, positions, velocities, clock[0], settings.baumgarte)
    for n in range(count):
        for i in range(tables.bodies.size):
            for d in range(6):
                velocities[i, d] += step * work.acceleration[i, d]
                displacement[i, d] = step * velocities[i, d]
            move(positions[i], displacement[i], positions[i])
        clock[0] = begin + (n + 1) * step
        if settings.projection and tables.rows.size > 0:
            project_positions(tables, work, positions, velocities, clock[0])
            project_velocities(tables, work, positions, velocities, clock[0])
        evaluate(tables, work, positions, velocities, clock[0], settings.baumgarte)
        status = watch(tables, work, positions, velocities, clock[0], step)
        if status != FINISHED:
            return status
        if work.counters[0] > settings.budget:
            return EVALUATION_LIMIT
    return FINISHED


METHOD = Method("symplectic-euler", 1, "symplectic Euler, explicit, for what it shows", integrate, explicit=True)
