"""The end of every step: the clock is set, and the run notes its energy balance, slip paths, drift and runaway."""

from __future__ import annotations

import math
from typing import NamedTuple

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.arithmetic.simd_lanes import load, select, store
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.forces.constraints import evaluate_constraints
from tripod_doe.mechanics.solve.equations_of_motion import accelerate, generalized_forces, larger
from tripod_doe.mechanics.tables import EVALUATIONS, STEPS, TRACED, Tables, Work

FINISHED, DIVERGED, STEP_LIMIT, EVALUATION_LIMIT = 0, 1, 3, 4
"""How a stretch of a run ended; the integers are those of `tripod_doe.model_interface.Outcome`."""

TRACE_FULL = -1
"""A stretch has paused for its trace to be emptied, and goes on when it is called again."""

RUNAWAY = 1e6
"""Speed over the scene's scale above which a run counts as diverged."""


_ROLLING = 0.01
"""Slip below this share of the transition velocity comes from rolling and rounding: its sign is not significant."""


class Settings(NamedTuple):
    """Numerics of a run."""

    tolerance: float = 1e-6  # relative tolerance of methods that control their step
    floor: float = 1e-13  # smallest step before a run gives up
    budget: int = 2_000_000_000  # largest number of force evaluations
    # iterations, correction: largest number of iterations of an implicit stage, and the relative correction at which
    # they end
    iterations: int = 60
    correction: float = 1e-9
    baumgarte: float = 0.0  # rate of Baumgarte's stabilisation, 0 for none
    projection: bool = True  # whether states are projected onto the constraints after every step
    controlled: bool = True  # whether methods with step control use it; without they take equal steps


def begin_watch(tables: Tables, work: Work, positions: FloatArray, velocities: FloatArray, time: float) -> None:
    """Note the state that a run starts from, so that the first step has powers and slips to compare with."""
    generalized_forces(tables, work, positions, velocities)
    accelerate(tables, work, positions, velocities, time, 0.0)
    _note_start(tables, work, positions, velocities)


@kernel
def _note_start(tables, work, positions, velocities):
    """Keep powers, ways and slips of an evaluated state."""
    for p in range(5):
        work.power_before[p] = work.ledger[1 + p]
    _work_beyond_powers(tables, positions, velocities, 0.0, work.motion_before)
    _follow_slips(tables.contacts, work.touching, work.slip, work.slip_before, 0.0, work.paths)


@kernel
def _work_beyond_powers(tables, positions, velocities, step, before):
    """Work of constant loads and gravity along bodies' displacements, minus the mean of their powers times the step.

    In a coarse step displacements differ from the integral of velocities; a ledger of powers would miss this.
    """
    more = 0.0
    for i in range(tables.bodies.size):
        body = tables.bodies[i]
        for d in range(3):
            if body.free[d] != 0.0:
                load = body.load[d] + (body.mass * tables.gravity[d] if body.block >= 0 else 0.0)
                way = positions[i, d] - before[i, d]
                more += load * (way - 0.5 * step * (velocities[i, d] + before[i, 3 + d]))
            before[i, d], before[i, 3 + d] = positions[i, d], velocities[i, d]
    return more


@kernel
def _follow_slips(contacts, touching, slip, before, step, paths):
    """Add up the slip paths of touching spheres in a step (or touching before it), in total and with reversed slip."""
    for i in range(contacts.size):
        if touching[i, 0] + touching[i, 1] == 0:
            continue
        touching[i, 1] = touching[i, 0]
        least = (_ROLLING * contacts[i].sliding_transition) ** 2
        for k in range(contacts[i].first, contacts[i].first + contacts[i].groups):
            now, then, path = slip[k], before[k], paths[k]
            x, y, z = load(now, 0), load(now, 1), load(now, 2)
            a, b, c = load(then, 0), load(then, 1), load(then, 2)
            way = 0.5 * step * (math.sqrt(x * x + y * y + z * z) + math.sqrt(a * a + b * b + c * c))
            store(path, 0, load(path, 0) + select(x * a + y * b + z * c < -least, way, 0.0))
            store(path, 1, load(path, 1) + way)
            for d in range(3):
                store(then, d, load(now, d))


@kernel
def _trace(work, positions, velocities, time):
    """Store a state; return whether memory for states is full."""
    row = work.trace[work.counters[TRACED]]
    work.counters[TRACED] += 1
    row[0] = time
    places, speeds = 1, 1 + 7 * positions.shape[0]
    for i in range(positions.shape[0]):
        for d in range(7):
            row[places + 7 * i + d] = positions[i, d]
        for d in range(6):
            row[speeds + 6 * i + d] = velocities[i, d]
    return work.counters[TRACED] == work.trace.shape[0]


@kernel
def accept(tables, work, positions, velocities, clock, time, step, settings):
    """End a step that is accepted; the ledger and the slips must be those of its state.

    Args:
        clock: Receives the time in clock[0].
        time, step: Time of the state, and the step that led to it.
        settings: Numerics: the budget of force evaluations.

    Returns:
        `FINISHED` to go on, or the reason to stop.
    """
    clock[0] = time
    work.counters[STEPS] += 1
    for p in range(5):
        power = work.ledger[1 + p]
        work.balance[p] += 0.5 * step * (power + work.power_before[p])
        work.power_before[p] = power
    work.balance[0] += _work_beyond_powers(tables, positions, velocities, step, work.motion_before)
    _follow_slips(tables.contacts, work.touching, work.slip, work.slip_before, step, work.paths)
    for i in range(tables.bodies.size):
        for d in range(6):
            size = abs(velocities[i, d]) / (tables.scales[1] if d < 3 else tables.scales[2])
            if not size <= RUNAWAY:
                work.failure[0], work.failure[1] = i, size
                return DIVERGED
    if tables.rows.size > 0:
        evaluate_constraints(tables.rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian)
        for k in range(tables.rows.size):
            work.extremes[0] = larger(work.extremes[0], abs(work.phi[k]))
    full = _trace(work, positions, velocities, time) if work.trace.shape[0] > 0 else False
    if work.counters[EVALUATIONS] > settings.budget:
        return EVALUATION_LIMIT
    return TRACE_FULL if full else FINISHED
