"""Prototype."""

from __future__ import annotations

from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.implicit import solve_stage
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.monitor import DIVERGED, FINISHED, accept
from tripod_doe.mechanics.motion import add_momenta, clear, copy_vectors

__all__ = ["METHOD"]


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance."""
    whole, begin = (end - clock[0]) / count, clock[0]
    start, before, base, momenta = work.stages[0], work.stages[1], work.stages[2], work.momenta
    clear(base.ravel())
    for n in range(count):
        target = begin + (n + 1) * whole
        step = target - clock[0]
        while clock[0] < target - 1e-9 * whole:
            step = min(step, target - clock[0])
            copy_vectors(positions, start)
            copy_vectors(velocities, before)
            clear(momenta.ravel())
            add_momenta(tables, positions, velocities, 1.0, step, momenta)
            time = clock[0] + step
            if solve_stage(tables, work, start, base, momenta, step, step, time, settings, positions, velocities):
                status = accept(tables, work, positions, velocities, clock, time, step, settings)
                if status != FINISHED:
                    return status
                clock[1] = step
                step *= 2.0
            else:
                work.counters[4] += 1
                copy_vectors(start, positions)
                copy_vectors(before, velocities)
                step *= 0.5
                if step < settings.floor:
                    return DIVERGED
    return FINISHED


METHOD = Method("adaptive-euler", 1, "implicit Euler with secant iterations", integrate)
