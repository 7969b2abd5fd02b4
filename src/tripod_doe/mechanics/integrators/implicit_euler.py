"""Implicit Euler with secant iterations for friction: first order, no limit on the step but accuracy."""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.inertia import add_momenta
from tripod_doe.mechanics.integrators.monitor import DIVERGED, FINISHED, accept
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors
from tripod_doe.mechanics.solve.newton import LEAST_SHARE, Stage, solve_stage

_START, _BASE = range(2)
"""Rows of `Work.stages`."""


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `method_interface`."""
    step, begin = (end - clock[0]) / count, clock[0]
    start, base = work.stages[_START], work.stages[_BASE]
    clear(base)
    for n in range(count):
        copy_vectors(positions, start)
        clear(work.momenta)
        add_momenta(tables, positions, velocities, 1.0, step, work.momenta)
        time = begin + (n + 1) * step
        stage = Stage(start, base, work.nothing, step, step, time)
        if not solve_stage(
            tables, work, stage, settings.iterations, settings.correction, LEAST_SHARE, positions, velocities
        ):
            return DIVERGED
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED
