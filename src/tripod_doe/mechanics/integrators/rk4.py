"""The classical Runge-Kutta method of order 4 on rotation vectors from the start of the step (Munthe-Kaas)."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import load_vector, move, tangent_rate
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.integrators.monitor import FINISHED, accept
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors, evaluate, settle

_START, _FIRST, _SHIFT, _SHIFT_SUM, _CHANGE_SUM, _DISPLACEMENT = range(6)
"""Rows of `Work.stages`."""


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `method_interface`."""
    bodies = tables.bodies.size
    step, begin = (end - clock[0]) / count, clock[0]
    start, first = work.stages[_START], work.stages[_FIRST]
    shift, displacement = work.stages[_SHIFT], work.stages[_DISPLACEMENT]
    shift_sum, change_sum = work.stages[_SHIFT_SUM], work.stages[_CHANGE_SUM]
    evaluate(tables, work, positions, velocities, begin, settings.baumgarte)
    for n in range(count):
        copy_vectors(positions, start)
        copy_vectors(velocities, first)
        clear(shift)
        clear(shift_sum)
        clear(change_sum)
        time, end_time = begin + n * step, begin + (n + 1) * step
        for stage in range(4):
            weight = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
            reach = step if stage == 2 else 0.5 * step
            if stage > 0:
                lag = 0.5 * step if stage < 3 else step
                evaluate(tables, work, positions, velocities, time + lag, settings.baumgarte)
            for i in range(bodies):
                rate = tangent_rate(load_vector(shift[i], 3), load_vector(velocities[i], 3))
                for d in range(6):
                    speed = velocities[i, d] if d < 3 else rate[d - 3]
                    shift_sum[i, d] += weight * speed
                    change_sum[i, d] += weight * work.acceleration[i, d]
                    shift[i, d] = reach * speed
                    velocities[i, d] = first[i, d] + reach * work.acceleration[i, d]
                    displacement[i, d] = shift[i, d]
                if stage == 3:
                    for d in range(6):
                        displacement[i, d] = shift_sum[i, d]
                        velocities[i, d] = first[i, d] + change_sum[i, d]
                move(start[i], displacement[i], positions[i])
        settle(tables, work, positions, velocities, end_time, settings)
        status = accept(tables, work, positions, velocities, clock, end_time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED
