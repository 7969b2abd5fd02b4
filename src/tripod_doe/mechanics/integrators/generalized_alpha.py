"""Generalized-alpha (Chung and Hulbert 1993; on rotations Bruels and Cardona 2010) with secant iterations.

Spectral radius 0.8 at infinity, second order. The algorithmic acceleration a obeys
(1 - am) a' + am a = (1 - af) u'' + af u''_n with u'' the true acceleration, and

    q' = q o (h u + h^2 ((1/2 - beta) a + beta a')),   u' = u + h ((1 - gamma) a + gamma a').

The first step is one of implicit Euler: a stiff start would ring, since only a fifth of it is damped a step.
"""

from __future__ import annotations

from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.integrators.monitor import DIVERGED, FINISHED, accept
from tripod_doe.mechanics.solve.equations_of_motion import copy_vectors
from tripod_doe.mechanics.solve.newton import LEAST_SHARE, Stage, solve_stage

_START, _BEFORE, _BASE, _ALGORITHMIC, _TRUE = range(5)
"""Rows of `Work.stages`."""

_RADIUS = 0.8
_AM = (2.0 * _RADIUS - 1.0) / (_RADIUS + 1.0)
_AF = _RADIUS / (_RADIUS + 1.0)
_GAMMA = 0.5 + _AF - _AM
_BETA = 0.25 * (_GAMMA + 0.5) ** 2


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `method_interface`. clock[1] says whether accelerations are known."""
    step, begin = (end - clock[0]) / count, clock[0]
    start, before, base = work.stages[_START], work.stages[_BEFORE], work.stages[_BASE]
    algorithmic, true = work.stages[_ALGORITHMIC], work.stages[_TRUE]
    reach = step * _BETA / _GAMMA
    factor = step * _GAMMA * (1.0 - _AF) / (1.0 - _AM)
    for n in range(count):
        copy_vectors(positions, start)
        time = begin + (n + 1) * step
        starting = clock[1] == 0.0
        for i in range(tables.bodies.size):
            for d in range(6):
                speed, old = velocities[i, d], algorithmic[i, d]
                known = speed + step * (1.0 - _GAMMA) * old
                before[i, d] = known + step * _GAMMA * (_AF * true[i, d] - _AM * old) / (1.0 - _AM)
                base[i, d] = step * speed + step * step * (0.5 - _BETA) * old - reach * known
                algorithmic[i, d] = known  # kept until the new velocity is known
                if starting:
                    before[i, d], base[i, d] = speed, 0.0
        by_position, by_velocity = (step, step) if starting else (reach, factor)
        stage = Stage(start, base, before, by_position, by_velocity, time)
        if not solve_stage(
            tables, work, stage, settings.iterations, settings.correction, LEAST_SHARE, positions, velocities
        ):
            return DIVERGED
        for i in range(tables.bodies.size):
            for d in range(6):
                true[i, d] = (velocities[i, d] - before[i, d]) / by_velocity
                algorithmic[i, d] = (velocities[i, d] - algorithmic[i, d]) / (step * _GAMMA)
                if starting:
                    algorithmic[i, d] = true[i, d]
        clock[1] = 1.0
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED
