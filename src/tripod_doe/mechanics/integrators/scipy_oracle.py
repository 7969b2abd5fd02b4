"""SciPy's solvers on the same right-hand side: slow, as a reference for the methods of this package."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import scipy.integrate

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.integrators.monitor import DIVERGED, EVALUATION_LIMIT, FINISHED, Settings, accept
from tripod_doe.mechanics.solve.equations_of_motion import evaluate
from tripod_doe.mechanics.tables import EVALUATIONS, FACTORISATIONS, Tables, Work
from tripod_doe.process.one_thread import one_thread


class _BudgetSpentError(Exception):
    """Raised to leave SciPy's loop when the budget of evaluations is used up."""


@kernel
def _unpack(y, positions, velocities):
    """Split a flat state; quaternions are normalised here, not by the solver."""
    for i in range(1, positions.shape[0]):
        at = 13 * (i - 1)
        norm = 0.0
        for d in range(7):
            positions[i, d] = y[at + d]
        for d in range(3, 7):
            norm += positions[i, d] * positions[i, d]
        norm = 1.0 / np.sqrt(norm)
        for d in range(3, 7):
            positions[i, d] *= norm
        for d in range(6):
            velocities[i, d] = y[at + 7 + d]


@kernel
def _rates(tables, work, time, y, baumgarte, positions, velocities, out):
    """Right-hand side y' = f(t, y) for centre of mass, quaternion and velocities of every body."""
    _unpack(y, positions, velocities)
    evaluate(tables, work, positions, velocities, time, baumgarte)
    for i in range(1, positions.shape[0]):
        at = 13 * (i - 1)
        w, x, y_, z = positions[i, 3], positions[i, 4], positions[i, 5], positions[i, 6]
        a, b, c = 0.5 * velocities[i, 3], 0.5 * velocities[i, 4], 0.5 * velocities[i, 5]
        for d in range(3):
            out[at + d] = velocities[i, d]
        out[at + 3] = -a * x - b * y_ - c * z
        out[at + 4] = a * w + b * z - c * y_
        out[at + 5] = b * w + c * x - a * z
        out[at + 6] = c * w + a * y_ - b * x
        for d in range(6):
            out[at + 7 + d] = work.acceleration[i, d]


def _pack(positions: FloatArray, velocities: FloatArray) -> FloatArray:
    return np.hstack([positions[1:], velocities[1:]]).ravel()


def _tolerances(tables: Tables, tolerance: float) -> FloatArray:
    length, speed, rotation = tables.scales[:3]
    each = np.array([length] * 3 + [length * rotation / speed] * 4 + [speed] * 3 + [rotation] * 3)
    return tolerance * np.tile(each, tables.bodies.size - 1)


def _integrate(
    solver: str,
    tables: Tables,
    work: Work,
    positions: FloatArray,
    velocities: FloatArray,
    clock: FloatArray,
    end: float,
    count: int,
    settings: Settings,
) -> int:
    """Advance with SciPy's step control; see `method_interface`.

    SciPy's success flag is ignored: the caller checks the result.

    On one thread of linear algebra: on several, LU factors are rounded differently, and results must not depend on
    the process that computes them.
    """
    rates = np.empty(13 * (positions.shape[0] - 1))

    def right_hand_side(time: float, y: FloatArray) -> FloatArray:
        if work.counters[EVALUATIONS] > settings.budget:
            raise _BudgetSpentError
        _rates(tables, work, time, y, settings.baumgarte, positions, velocities, rates)
        return rates.copy()

    options: dict[str, Any] = {"rtol": settings.tolerance, "atol": _tolerances(tables, settings.tolerance)}
    start, solved = _pack(positions, velocities), int(work.counters[FACTORISATIONS])
    try:
        with one_thread():
            stepper = getattr(scipy.integrate, solver)(right_hand_side, clock[0], start, end, **options)
            while stepper.status == "running":
                before = stepper.t
                with np.errstate(all="ignore"):
                    stepper.step()
                if stepper.status == "failed" or not np.all(np.isfinite(stepper.y)):
                    work.failure[0] = 0
                    return DIVERGED
                right_hand_side(stepper.t, stepper.y)
                work.counters[FACTORISATIONS] = solved + stepper.nlu
                step = stepper.t - before
                status = int(accept(tables, work, positions, velocities, clock, stepper.t, step, settings))
                if status != FINISHED:
                    return status
    except _BudgetSpentError:
        return EVALUATION_LIMIT
    except (ValueError, np.linalg.LinAlgError):  # SciPy refuses a Jacobian that is not finite
        return DIVERGED
    return FINISHED


radau = partial(_integrate, "Radau")
bdf = partial(_integrate, "BDF")
lsoda = partial(_integrate, "LSODA")
dop853 = partial(_integrate, "DOP853")
