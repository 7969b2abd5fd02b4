"""What to measure next: how far one more record at each of some operating points would narrow an unknown.

The whitened Jacobian of the fit is extended by the rows of a record that is not measured yet, with the usual scatter of
those that are, and the error of the model there. That needs the derivatives at the candidates, and no data.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tripod_doe.analyses.fit.fit import Solution
from tripod_doe.analyses.fit.identifiability import covariance_of
from tripod_doe.analyses.fit.misfit import Misfit, Rows
from tripod_doe.analyses.fit.model_error import ModelError
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.model_interface import Value

_RANGE = 1 / np.sqrt(12)  # standard deviation of a place of which only the bounds are known
_MOST_RECORDS = 1000  # beyond which records of one point are said not to reach an aim


@dataclass(frozen=True)
class CandidateRows:
    """Prediction and derivatives of the model at one candidate."""

    prediction: ComplexArray  # at the fitted values, shape (order,)
    slope: ComplexArray  # derivatives by the scalars, then by each unknown of the new record alone, (order, scalar)
    error: ModelError  # of the model in this record


@dataclass(frozen=True)
class Gain:
    """Effect of one more record at a candidate."""

    part: float  # half width of the interval with it, over that without
    records: float  # records there until the aim is reached; infinite where it is not within a thousand
    half: FloatArray  # half widths of the intervals of the predicted amplitudes, shape (order,)


@dataclass(frozen=True)
class Next:
    """Effects of records at all candidates."""

    unknown: str  # the one to narrow, with its record or group
    within: float  # relative half width that is aimed at
    operating: Mapping[str, Sequence[Value]]  # what differs between candidates or records
    group: str  # of records to which the candidates belong, in words; empty where there are none
    gains: Sequence[Gain | None]  # None where the model fails
    predicted: Sequence[FloatArray | None]  # amplitudes, shape (order,)


def gains(
    solution: Solution, orders: Sequence[int], candidates: Sequence[CandidateRows], scalar: int, aim: float
) -> list[Gain]:
    """Effect of one more record at each candidate on the interval of one scalar.

    Args:
        candidates: The candidates; a scalar that a new record would have for itself follows those of the fit.
        aim: Half width that is aimed at, on the unit cube.
    """
    rows = solution.problem.misfit.rows
    noise = _usual_noise(rows, orders)
    own = solution.profiles[scalar]
    half, answers = (own.high - own.low) / 2, []
    for candidate in candidates:
        now = _variance(solution, orders, candidate, noise, scalar, 1e-9)
        one = _variance(solution, orders, candidate, noise, scalar, 1.0)
        count = 1.0
        while count <= _MOST_RECORDS:
            if half * np.sqrt(_variance(solution, orders, candidate, noise, scalar, count) / now) <= aim:
                break
            count *= 1.25
        records = float(np.ceil(count)) if count <= _MOST_RECORDS else np.inf
        if half <= aim:
            records = 0.0
        answers.append(Gain(float(np.sqrt(one / now)), records, _band(solution, candidate)))
    return answers


def _usual_noise(rows: Rows, orders: Sequence[int]) -> FloatArray:
    """Usual deviations of a record's orders along and across, over its largest order, shape (2, order)."""
    size = np.zeros(rows.records)
    np.maximum.at(size, rows.record, np.abs(rows.measured))
    across = np.where(np.isfinite(rows.across), rows.across, rows.along)
    return np.array(
        [
            [float(np.median((part / size[rows.record])[rows.order == order])) for order in orders]
            for part in (rows.along, across)
        ]
    )


def _variance(
    solution: Solution, orders: Sequence[int], candidate: CandidateRows, noise: FloatArray, scalar: int, count: float
) -> float:
    """Variance of a scalar with `count` records at a candidate."""
    problem, best = solution.problem, solution.best
    rows, old = problem.misfit.rows, problem.layout.count
    size = float(np.abs(candidate.prediction).max())
    along, across = noise * size
    error = candidate.error
    free = bool(rows.free_phase.mean() > 0.5)
    more = replace(
        rows,
        record=np.append(rows.record, np.full(len(orders), rows.records)),
        order=np.append(rows.order, np.array(orders)),
        measured=np.append(best_aligned(solution), candidate.prediction),
        along=np.append(rows.along, along / np.sqrt(count)),
        across=np.append(rows.across, across / np.sqrt(count)),
        own_error=np.hstack([rows.own_error, error.own[:, 0] / np.sqrt(count)]),
        shared=_below(rows.shared, error.shared[0]),
        turning=_below(rows.turning, error.turning[0]),
        free_phase=np.append(rows.free_phase, free),
        free_sign=np.append(rows.free_sign, False),
    )
    width = candidate.slope.shape[1]
    mean, std = problem.layout.priors()
    extra = width - old  # scalars of the new record alone: known to their range before
    ended = [own.open_low or own.open_high for own in solution.profiles]  # by a bound, which also holds later on
    std = np.where(ended, np.minimum(std, _RANGE), std)
    prior = np.append(mean, np.full(extra, 0.5)), np.append(std, np.full(extra, _RANGE))
    misfit = Misfit(more, np.append(problem.misfit.used, True), prior)
    prediction = np.append(np.nan_to_num(best.prediction), candidate.prediction)
    slope = np.vstack([np.hstack([best.slope, np.zeros((best.slope.shape[0], extra))]), candidate.slope])
    compared = misfit.compare(prediction, np.append(best.place, np.full(extra, 0.5)))
    return float(covariance_of(misfit.jacobian(compared, slope))[scalar, scalar])


def _below(errors: Any, more: Any) -> Any:
    """Errors that records share with those of one more, which may share more kinds, or fewer: these come last."""
    width = max(errors.shape[1], more.shape[1])
    return np.vstack([np.pad(each, ((0, 0), (0, width - each.shape[1]))) for each in (errors, more)])


def best_aligned(solution: Solution) -> ComplexArray:
    """The fitted orders as the records would show them, shape (row,)."""
    compared = solution.problem.compare(solution.best.prediction, solution.best.place)
    measured = solution.problem.misfit.rows.measured
    return np.asarray(np.where(np.isfinite(compared.aligned), compared.aligned, measured), complex)


def _band(solution: Solution, candidate: CandidateRows) -> FloatArray:
    """Half widths of the predicted amplitudes: what is not known of the unknowns, and the error of the model."""
    size = np.abs(candidate.prediction)
    unit = candidate.prediction / np.where(size > 0, size, 1)
    slope = (np.conj(unit)[:, None] * candidate.slope).real
    known, new = np.split(slope, [solution.problem.layout.count], axis=1)
    variance = np.einsum("ij,jk,ik->i", known, solution.covariance, known) + ((_RANGE * new) ** 2).sum(axis=1)
    wide = np.sqrt(variance + candidate.error.whole[0] ** 2)
    return np.asarray(np.sqrt(solution.allowed / solution.scatter) * wide, float)
