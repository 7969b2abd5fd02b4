"""Implicit Euler that chooses its step: for scenes of many light bodies around a few heavy ones.

Heavy are the bodies of the scene's core (all, if it has none); they carry the forces that one asks for, light ones
rattle between them. The step follows the heavy bodies: half the change of a velocity over a step, which is what implicit
Euler lags behind, stays near the tolerance. The equations of a step are solved to the tolerance for heavy bodies and
to `_LIGHT` times that for light ones, whose impacts no step of this size resolves; a step whose equations do not
converge is halved. Contact vibrations die within a few steps: nothing else is rejected.
"""

from __future__ import annotations

import math

from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.implicit import solve_stage
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.monitor import EVALUATION_LIMIT, FINISHED, STEP_LIMIT, accept
from tripod_doe.mechanics.motion import add_momenta, clear, copy_vectors, larger, velocity_at_rest
from tripod_doe.mechanics.rotations import dot, load_vector, rotate, rotation_by, scale, subtract

__all__ = ["METHOD"]

_LIGHT = 30.0
_ITERATIONS = 10


@kernel
def _largest_change(tables, start, before, positions, velocities, step):
    """Largest change of a velocity of a heavy body relative to the scene's scales, in whichever axes it is steadier."""
    pattern, frame = tables.pattern, load_vector(tables.frame, 0)
    back = rotation_by(scale(-step, frame))
    worst = 0.0
    for pivot in range(pattern.tail if pattern.tail < pattern.order.size else 0, pattern.order.size):
        i = tables.body_of_row[pattern.order[pivot]]
        old, new = velocity_at_rest(frame, start[i], before[i]), velocity_at_rest(frame, positions[i], velocities[i])
        for kind in range(2):
            turning = subtract(load_vector(velocities[i], 3 * kind), load_vector(before[i], 3 * kind))
            at_rest = subtract(new[kind], rotate(back, old[kind]))
            change = math.sqrt(min(dot(turning, turning), dot(at_rest, at_rest)))
            worst = larger(worst, change / tables.scales[1 + kind])
    return worst


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance with step control, or by equal steps without; see `contract`. clock[1] holds the next step."""
    start, before, base = work.stages[0], work.stages[1], work.stages[2]
    equal, tolerance = (end - clock[0]) / count, settings.tolerance
    if clock[1] == 0.0 or not settings.controlled:
        clock[1] = equal
    clear(base.ravel())
    while clock[0] < end - 1e-9 * equal:
        left = end - clock[0]
        step = left / max(round(left / clock[1] + 0.49), 1.0)
        time = end if step > 0.999 * left else clock[0] + step
        copy_vectors(positions, start)
        copy_vectors(velocities, before)
        clear(work.momenta.ravel())
        add_momenta(tables, positions, velocities, 1.0, step, work.momenta)
        if solve_stage(
            tables, work, start, base, step, step, time, _ITERATIONS, settings.baumgarte * tolerance, settings.correction / settings.baumgarte,
            positions, velocities,
        ):  # fmt: skip
            status = accept(tables, work, positions, velocities, clock, time, step, settings)
            if status != FINISHED:
                return status
            if settings.controlled:
                error = 0.5 * _largest_change(tables, start, before, positions, velocities, step)
                clock[1] = step * min(max(tolerance / max(error, 1e-30), 0.3), 2.0)
        else:
            work.counters[4] += 1
            copy_vectors(start, positions)
            copy_vectors(before, velocities)
            clock[1] = 0.5 * step
            work.failure[1] = clock[1]
            if clock[1] < settings.floor:
                return STEP_LIMIT
            if work.counters[0] > settings.budget:
                return EVALUATION_LIMIT
    return FINISHED


METHOD = Method(
    "adaptive-euler", 1, "implicit Euler with a step that follows the heavy bodies of a scene", integrate, controlled=True
)
