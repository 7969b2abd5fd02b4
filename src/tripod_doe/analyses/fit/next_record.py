"""What to measure next: how far one more record at each of some operating points would narrow an unknown.

The whitened Jacobian of the fit is extended by the rows of a record that is not measured yet, with the usual scatter of
those that are, and the error of the model there. That needs the derivatives at the candidates, and no data.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tripod_doe.analyses.fit.estimation.identifiability import covariance_of
from tripod_doe.analyses.fit.estimation.misfit import Misfit, Rows
from tripod_doe.analyses.fit.estimation.solution import Solution
from tripod_doe.analyses.fit.estimation.unknowns import Layout
from tripod_doe.analyses.fit.model_error import ModelError, Needles
from tripod_doe.analyses.fit.problem import Answers, FitProblem
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.model_interface import Value
from tripod_doe.number_text import level_or_word

_RANGE = 1 / np.sqrt(12)  # standard deviation of a place of which only the bounds are known
_STEP = 0.01  # of a range, for derivatives at candidates
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


def next_record(rig: FitProblem, points: Answers, solution: Solution) -> Next | None:
    """Effect of one more record at each candidate; None where the fit file asks for none.

    Args:
        rig, solution: The fit and its solution.
        points: Computes the candidates.
    """
    if not rig.candidates or rig.file.next is None:
        return None
    if solution.skews is not None and solution.skews.stay:
        points = rig.with_initial_skews(points)
    layout, best = rig.layout, solution.best
    names = [unknown.name for unknown in layout.unknowns]
    relative = [_relative(layout, solution, scalar) for scalar in range(layout.count)]
    scalars = list(range(layout.count))
    if rig.file.next.narrow is not None:
        scalars = [s for s in scalars if names[layout.owner[s]] == rig.file.next.narrow]
    scalar = max(scalars, key=lambda s: relative[s])
    value, slope = _value_and_slope(layout, best.place, scalar)
    like = int(np.flatnonzero((layout.index == scalar).any(axis=0))[0])
    rows = _candidate_rows(rig, points, solution, like)
    able = [at for at, row in enumerate(rows) if row is not None]
    gained: list[Gain | None] = [None] * len(rows)
    aim = rig.file.next.within * abs(value) / slope
    for at, gain in zip(able, _gains(solution, rig.orders, [rows[a] for a in able], scalar, aim), strict=True):  # type: ignore[misc]
        gained[at] = gain
    predicted = [None if row is None else np.abs(row.prediction) for row in rows]
    every = [rig.operating(each) for each in (*rig.candidates, *(each.parameters for each in rig.records))]
    shown = [n for n in rig.varied if any(n in each for each in rig.candidates) or len({row[n] for row in every}) > 1]
    labels = rig.records[like].labels
    grouped = [unknown.per for unknown in layout.unknowns if unknown.per in labels]
    return Next(
        layout.names()[scalar],
        rig.file.next.within,
        {name: [row[name] for row in every[: len(rows)]] for name in shown},
        ", ".join(f"{column} {labels[column]}" for column in dict.fromkeys(grouped)),
        gained,
        predicted,
    )


def _candidate_rows(rig: FitProblem, points: Answers, solution: Solution, like: int) -> list[CandidateRows | None]:
    """The model and its derivatives at every candidate; None where it fails.

    Args:
        like: The record in whose groups a candidate is.
    """
    layout, count, width = rig.layout, len(rig.candidates), len(rig.layout.unknowns)
    scalars = np.array([_scalars_of(rig, candidate, like) for candidate in rig.candidates])
    usual = np.array([solution.best.place[row].mean() for row in layout.index])
    here = np.clip(np.where(scalars < layout.count, np.append(solution.best.place, usual)[scalars], usual), 0, 1)
    steps = np.where(here > 0.5, -_STEP, _STEP)
    trials = here + steps * np.vstack([np.zeros(width), np.eye(width)])[:, None]  # (trial, candidate, unknown)
    flat = trials.reshape(-1, width)
    values = np.stack([u.physical(flat[:, at]) for at, u in enumerate(layout.unknowns)], axis=-1)
    columns = rig.columns(rig.candidates * (width + 1), values, rig.cheap)
    orders, needles = points(columns)
    chosen = orders[:, rig.orders].reshape(width + 1, count, -1)
    columns = {name: column[:count] for name, column in columns.items()}
    columns["model"] = np.array([rig.model] * count, object)
    error = rig.error(columns, np.nan_to_num(chosen[0]), Needles(needles.second[:count], needles.skew[:count])).times(
        solution.error_size.of(rig.orders)
    )
    rows: list[CandidateRows | None] = []
    for at in range(count):
        if not np.isfinite(chosen[:, at]).all():
            rows.append(None)
            continue
        slope = np.zeros((len(rig.orders), layout.count + width), complex)
        slope[:, scalars[at]] = ((chosen[1:, at] - chosen[0, at]) / steps[at][:, None]).T
        rows.append(CandidateRows(chosen[0, at], slope, error.at(at)))
    return rows


def _scalars_of(rig: FitProblem, candidate: Mapping[str, Value], like: int) -> list[int]:
    """The scalar of each unknown at a candidate; those that no record has follow the others, one an unknown."""
    layout, operating = rig.layout, rig.operating(candidate)
    scalars = []
    for which, unknown in enumerate(layout.unknowns):
        own, new = layout.index[which], layout.count + which
        if unknown.per in operating:  # a group may have the value that the candidate has
            label = f"{unknown.per} {level_or_word(operating[unknown.per])}"
            same = [scalar for scalar in own.tolist() if layout.groups[scalar] == label]
            scalars.append(same[0] if same else new)
        else:
            scalars.append(new if unknown.per == "record" else int(own[like]))
    return scalars


def _value_and_slope(layout: Layout, place: FloatArray, scalar: int) -> tuple[float, float]:
    """Value of a scalar, and its derivative by its place."""
    unknown, step = layout.unknowns[layout.owner[scalar]], 1e-6
    here = float(unknown.physical(place[scalar]))
    there = unknown.physical(place[scalar] + np.array([-step, step]))
    return here, float(there[1] - there[0]) / (2 * step)


def _relative(layout: Layout, solution: Solution, scalar: int) -> float:
    """Half width of an interval over the value."""
    value, slope = _value_and_slope(layout, solution.best.place, scalar)
    half = (solution.profiles[scalar].high - solution.profiles[scalar].low) / 2
    return half * slope / max(abs(value), 1e-12)


def _gains(
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
