"""Linearly implicit Euler with the secant slope of friction: one linear solve a step.

Forces are evaluated at the positions that the step's first velocities give. K v from the matrices instead neglects the
rotation of levers, normals and slip directions: the error of the joint's third order was 1000 / s times the step,
twenty times the error of the secant.
"""

from __future__ import annotations

from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.constraints import evaluate_constraints
from tripod_doe.mechanics.integrators.monitor import DIVERGED, FINISHED, accept
from tripod_doe.mechanics.solve.equations_of_motion import evaluate, linearise
from tripod_doe.mechanics.solve.newton import factorise_system, gather, solve_system

_CHANGE, _AHEAD = range(2)
"""Rows of `Work.stages`."""


@kernel
def integrate(tables, work, positions, velocities, clock, end, count, settings):
    """Advance by equal steps; see `method_interface`."""
    step, begin = (end - clock[0]) / count, clock[0]
    change, ahead = work.stages[_CHANGE], work.stages[_AHEAD]
    for n in range(count):
        time = begin + (n + 1) * step
        _move_all(tables, positions, velocities, step, change, ahead)
        linearise(tables, work, ahead, velocities, 1.0, step, step * step, work.matrix)
        if tables.rows.size > 0:
            evaluate_constraints(tables.rows, ahead, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian)
            for k in range(tables.rows.size):  # positions at the end of the step meet the linearised equations
                work.gamma[k] = -work.phi[k] / step
        if not factorise_system(tables, work, ahead):
            return DIVERGED
        clear(work.blocks)
        gather(tables, work.force, step, work.blocks)
        solve_system(tables, work, work.gamma, change)
        for i in range(tables.bodies.size):
            for d in range(6):
                velocities[i, d] += change[i, d]
        _move_all(tables, positions, velocities, step, change, positions)
        evaluate(tables, work, positions, velocities, time, 0.0)
        status = accept(tables, work, positions, velocities, clock, time, step, settings)
        if status != FINISHED:
            return status
    return FINISHED


@kernel
def _move_all(tables, positions, velocities, step, change, moved):
    """Positions of all bodies after a step with these velocities; `moved` may be `positions`."""
    for i in range(tables.bodies.size):
        for d in range(6):
            change[i, d] = step * velocities[i, d]
        move(positions[i], change[i], moved[i])
