"""Symplectic Euler: u' = u + h a(q, u), q' = q + h u'. Explicit in friction, so limited by 2 m_eff v_st / (mu f_n)."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.integrators.monitor import FINISHED, accept
from tripod_doe.mechanics.solve.equations_of_motion import evaluate, settle


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `method_interface`."""
    step, begin = (end - clock[0]) / count, clock[0]
    displacement = work.displacement
    evaluate(tables, work, positions, velocities, begin, settings.baumgarte)
    for n in range(count):
        for i in range(tables.bodies.size):
            for d in range(6):
                velocities[i, d] += step * work.acceleration[i, d]
                displacement[i, d] = step * velocities[i, d]
            move(positions[i], displacement[i], positions[i])
        time = begin + (n + 1) * step
        settle(tables, work, positions, velocities, time, settings)
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED
