"""Implicit Euler with steps from the scene's time scale: for many light bodies that rattle between a few heavy ones.

Implicit Euler lags behind by half the change of a velocity over a step. In a scene that changes by itself in the time
T (`Scene.time_scale`) the relative tolerance therefore asks for steps of 2 tolerance T. Step control by the error of
every body would resolve impacts of light bodies without effect. So the equations of a step are solved only to `_SLACK`
times the tolerance, with the secant slope of friction (`newton.LEAST_SHARE`); a step whose equations do not converge is
halved.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.inertia import add_momenta
from tripod_doe.mechanics.integrators.monitor import EVALUATION_LIMIT, FINISHED, STEP_LIMIT, accept
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors
from tripod_doe.mechanics.solve.newton import LEAST_SHARE, Stage, solve_stage
from tripod_doe.mechanics.tables import EVALUATIONS, REJECTED

_START, _BEFORE, _BASE = range(3)
"""Rows of `Work.stages`."""

_SLACK = 50.0
"""Measured on the joint (benchmarks/joint_methods.py): looser solves fail more often, tighter ones gain nothing."""

_ITERATIONS = 10


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance with step control, or by equal steps without; see `method_interface`. clock[1] holds the next step."""
    start, before, base = work.stages[_START], work.stages[_BEFORE], work.stages[_BASE]
    equal = (end - clock[0]) / count
    pace = 2.0 * settings.tolerance * tables.scales[3] if settings.controlled else equal
    solved = _SLACK * settings.tolerance if settings.controlled else settings.correction
    iterations = _ITERATIONS if settings.controlled else settings.iterations
    least = 1.0 if settings.controlled else LEAST_SHARE
    if clock[1] == 0.0:
        clock[1] = pace
    clear(base)
    while clock[0] < end - 1e-9 * equal:
        left = end - clock[0]
        step = left / max(math.ceil(left / min(clock[1], pace) - 1e-6), 1.0)
        time = end if step > 0.999 * left else clock[0] + step
        copy_vectors(positions, start)
        copy_vectors(velocities, before)
        clear(work.momenta)
        add_momenta(tables, positions, velocities, 1.0, step, work.momenta)
        stage = Stage(start, base, work.nothing, step, step, time)
        if solve_stage(tables, work, stage, iterations, solved, least, positions, velocities):
            status = accept(tables, work, positions, velocities, clock, time, step, settings)
            if status != FINISHED:
                return status
            clock[1] = 2.0 * clock[1] if clock[1] < pace else pace
        else:
            work.counters[REJECTED] += 1
            copy_vectors(start, positions)
            copy_vectors(before, velocities)
            clock[1] = 0.5 * step
            if clock[1] < settings.floor:
                return STEP_LIMIT
            if work.counters[EVALUATIONS] > settings.budget:
                return EVALUATION_LIMIT
    return FINISHED
