"""The end of every step: the clock is set, and the run notes its energy balance, slip reversals, drift and runaway."""

from __future__ import annotations

from typing import NamedTuple

from tripod_doe.mechanics.compilation import kernel
from tripod_doe.mechanics.constraints import evaluate_constraints
from tripod_doe.mechanics.lanes import load, select, store
from tripod_doe.mechanics.motion import clear, evaluate, larger

__all__ = ["DIVERGED", "EVALUATION_LIMIT", "FINISHED", "RUNAWAY", "STEP_LIMIT", "Settings", "accept", "begin_watch"]

FINISHED, DIVERGED, STEP_LIMIT, EVALUATION_LIMIT = 0, 1, 3, 4
"""How a stretch of a run ended; the integers are those of `results.Outcome`."""

RUNAWAY = 1e6
"""A speed this many times the scene's scale is no motion of the scene."""


_ROLLING = 0.01
"""Slip below this share of the transition velocity is what rolling and rounding leave: its sign means nothing."""


class Settings(NamedTuple):
    """Numerics of a run.

    Attributes
    ----------
    tolerance
        Relative tolerance of methods that control their step.
    floor
        Smallest step before a run gives up.
    budget
        Largest number of force evaluations.
    iterations, correction
        Largest number of iterations of an implicit stage, and the relative correction at which they end.
    baumgarte
        Rate of Baumgarte's stabilisation, 0 for none.
    projection
        Whether states are projected onto the constraints after every step.
    controlled
        Whether methods with step control use it; without they take equal steps.
    """

    tolerance: float = 1e-6
    floor: float = 1e-13
    budget: int = 2_000_000_000
    iterations: int = 60
    correction: float = 1e-9
    baumgarte: float = 0.0
    projection: bool = True
    controlled: bool = True


@kernel
def begin_watch(tables, work, positions, velocities, time):
    """Note the state that a run starts from, so that the first step has powers and slips to compare with."""
    evaluate(tables, work, positions, velocities, time, 0.0)
    for p in range(5):
        work.power_before[p] = work.ledger[1 + p]
    _count_reversals(tables.contacts, work.touching, work.slip, work.slip_before, work.reversals)
    clear(work.reversals.ravel())


@kernel
def _count_reversals(contacts, touching, slip, before, reversals):
    """Compare the slips of contacts that touch, or did, with those of the last accepted step."""
    for i in range(contacts.size):
        if touching[i, 0] + touching[i, 1] == 0:
            continue
        touching[i, 1] = touching[i, 0]
        least = (_ROLLING * contacts[i].sliding_transition) ** 2
        for k in range(contacts[i].first, contacts[i].first + contacts[i].groups):
            now, then, counts = slip[k], before[k], reversals[k]
            product = load(now, 0) * load(then, 0) + load(now, 1) * load(then, 1) + load(now, 2) * load(then, 2)
            store(counts, 0, load(counts, 0) + select(product < -least, 1.0, 0.0))
            store(counts, 1, load(counts, 1) + select(abs(product) > 0.0, 1.0, 0.0))
            for d in range(3):
                store(then, d, load(now, d))


@kernel
def accept(tables, work, positions, velocities, clock, time, step, settings):
    """End a step that is accepted; the ledger and the slips must be those of its state.

    Parameters
    ----------
    clock
        Receives the time in clock[0].
    time, step
        Time of the state, and the step that led to it.
    settings
        Numerics: the budget of force evaluations.

    Returns
    -------
    int
        `FINISHED` to go on, or why to stop.
    """
    clock[0] = time
    work.counters[3] += 1
    for p in range(5):
        power = work.ledger[1 + p]
        work.balance[p] += 0.5 * step * (power + work.power_before[p])
        work.power_before[p] = power
    _count_reversals(tables.contacts, work.touching, work.slip, work.slip_before, work.reversals)
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
    return EVALUATION_LIMIT if work.counters[0] > settings.budget else FINISHED
