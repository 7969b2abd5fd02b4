"""Objectives and constraints of candidates, from the points of their operating points and their scatter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.optimisation.optimisation_file import ConstraintTable, ObjectiveTable
from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import digits_apart, number

_ROUNDING = 1e-12  # part of a limit within which a value lies on it


@dataclass(frozen=True)
class PointValues:
    """A quantity at the points of some candidates."""

    values: FloatArray  # shape (candidate, joint, operating point); NaN where a point failed
    numerical: FloatArray  # numerical error of the same shape; NaN where it is not known
    model: FloatArray  # error to expect of the model, of the same shape; NaN where it is not known


@dataclass(frozen=True)
class Ends:
    """How the points of some candidates ended, shape (candidate, point) each."""

    outcome: NDArray[np.int8]
    detail: NDArray[np.object_]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether a point did not finish."""
        return np.asarray(self.outcome != Outcome.FINISHED)

    def reasons(self) -> list[str]:
        """Reasons of failed candidates: the most frequent outcome of their points with a reason; empty if none did."""
        texts = []
        for outcomes, details, failed in zip(self.outcome, self.detail, self.failed, strict=True):
            if not failed.any():
                texts.append("")
                continue
            (outcome, count), *_ = Counter(outcomes[failed].tolist()).most_common(1)
            first = str(details[np.flatnonzero(outcomes == outcome)[0]])
            of = f" ({count} of {outcomes.size} points)" if outcomes.size > 1 else ""
            texts.append(f"{Outcome(outcome).label}{of}{f': {first}' if first else ''}")
        return texts


@dataclass(frozen=True)
class Judged:
    """Objectives and constraints of some candidates."""

    objectives: FloatArray  # shape (candidate, objective); NaN where a candidate failed
    objective_errors: FloatArray  # numerical and of the model, half widths; NaN where not known
    constraints: FloatArray  # shape (candidate, constraint)
    constraint_errors: FloatArray
    violations: FloatArray  # relative to the limit, shape (candidate, constraint); above 0 where one is not kept
    failed: FloatArray  # share of the points that did not finish, shape (candidate,)
    reasons: list[str]  # why a candidate is not feasible; empty where it is

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Whether a candidate can be built, finishes, and keeps all limits, shape (candidate,)."""
        return np.array([not reason for reason in self.reasons], bool)

    def take(self, rows: NDArray[np.integer[Any]] | NDArray[np.bool_]) -> Judged:
        """Some of the candidates."""
        at = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        return Judged(
            objectives=self.objectives[at],
            objective_errors=self.objective_errors[at],
            constraints=self.constraints[at],
            constraint_errors=self.constraint_errors[at],
            violations=self.violations[at],
            failed=self.failed[at],
            reasons=[self.reasons[k] for k in at.tolist()],
        )

    def nearest(self) -> int | None:
        """Row of the candidate whose limits are broken least in sum; None where none has values of all of them."""
        able = np.flatnonzero(np.isfinite(self.violations).all(axis=1))
        if not able.size or not self.violations.shape[1]:
            return None
        return int(able[np.maximum(self.violations[able], 0).sum(axis=1).argmin()])

    @staticmethod
    def impossible(reasons: list[str], objectives: int, constraints: int) -> Judged:
        """Impossible candidates, whose points are not run."""
        count = len(reasons)
        aims, limits = np.full((count, objectives), np.nan), np.full((count, constraints), np.nan)
        return Judged(aims, aims, limits, limits, limits, np.ones(count), reasons)

    @staticmethod
    def joined(parts: Sequence[Judged]) -> Judged:
        """Candidates of several parts, one after the other."""
        return Judged(
            objectives=np.concatenate([part.objectives for part in parts]),
            objective_errors=np.concatenate([part.objective_errors for part in parts]),
            constraints=np.concatenate([part.constraints for part in parts]),
            constraint_errors=np.concatenate([part.constraint_errors for part in parts]),
            violations=np.concatenate([part.violations for part in parts]),
            failed=np.concatenate([part.failed for part in parts]),
            reasons=[reason for part in parts for reason in part.reasons],
        )


def judged(
    objectives: Mapping[str, ObjectiveTable],
    constraints: Mapping[str, ConstraintTable],
    values: Mapping[tuple[str, int | None], PointValues],
    ends: Ends,
    weights: FloatArray,
    quantile: float,
    quotients: Container[str] = (),
) -> Judged:
    """Judge candidates.

    Args:
        values: Every quantity that they name, by output and order.
        weights: Of the operating points; they add up to one.
        quantile: Share of the joints of a sample for which a value must hold; points that failed count as the worst of
            them.
        quotients: Names of responses that divide.
    """
    aims = [_of_objective(values[table.output, table.order], table, weights, quantile) for table in objectives.values()]
    limits = [
        _of_constraint(values[table.output, table.order], table, weights, quantile) for table in constraints.values()
    ]
    count = len(ends.outcome)
    none = np.zeros((count, 0))
    objective = np.stack([value for value, _ in aims], axis=1)
    kept = np.stack([value for value, _, _ in limits], axis=1) if limits else none
    violation = np.stack([far for _, _, far in limits], axis=1) if limits else none
    failed = ends.failed.mean(axis=1)
    reasons = [
        _reason(why, objectives, objective[row], kept[row], violation[row], constraints, quotients)
        for row, why in enumerate(ends.reasons())
    ]
    return Judged(
        objective,
        np.stack([error for _, error in aims], axis=1),
        kept,
        np.stack([error for _, error, _ in limits], axis=1) if limits else none,
        violation,
        failed,
        reasons,
    )


def _reason(
    why: str,
    aims: Mapping[str, ObjectiveTable],
    objectives: FloatArray,
    kept: FloatArray,
    violation: FloatArray,
    constraints: Mapping[str, ConstraintTable],
    quotients: Container[str],
) -> str:
    """The reason why a candidate is not feasible; empty where it is."""
    judged = dict(zip([*aims, *constraints], [*objectives, *kept], strict=True))
    if missing := [name for name, value in judged.items() if not np.isfinite(value)]:
        divides = any((aims.get(name) or constraints[name]).output in quotients for name in missing)
        return why or f"{', '.join(missing)}: no value there" + ", as where its formula divides by rounding" * divides
    texts = []
    for (name, table), value, far in zip(constraints.items(), kept, violation, strict=True):
        if far > 0:
            is_above = table.high is not None and value > table.high
            limit = table.high if is_above else table.low
            digits = max(digits_apart(float(value), float(limit or 0.0)), 4)  # the limit itself is no violation
            texts.append(f"{name} = {number(float(value), digits)} {'above' if is_above else 'below'} {limit:g}")
    return "; ".join(texts)


def _over(values: FloatArray, over: str, weights: FloatArray) -> FloatArray:
    """One value over the operating points, shape (candidate, joint); NaN where one of them failed."""
    if over == "mean":
        return np.asarray(values @ weights)
    return np.asarray(values.max(axis=2) if over == "max" else values.min(axis=2))


def _quantile(values: FloatArray, share: float, high: bool) -> FloatArray:
    """The value that the share of the joints keeps, shape (candidate,); NaN where too many failed.

    Args:
        values: Shape (candidate, joint).
        high: Whether large values are bad.
    """
    if values.shape[1] == 1:
        return np.asarray(values[:, 0])
    worst = np.inf if high else -np.inf
    ordered = np.where(np.isfinite(values), values, worst)
    whole = np.isfinite(values).all(axis=1)
    part = share if high else 1 - share
    answers = np.quantile(ordered, part, axis=1, method="higher" if high else "lower")
    answers[whole] = np.quantile(ordered[whole], part, axis=1, method="median_unbiased")
    return np.where(np.isfinite(answers), answers, np.nan)


def _error(at: PointValues, over: str, weights: FloatArray, share: float, high: bool) -> FloatArray:
    """Half width: numerical and model error, and the error of the quantile by the sample, shape (candidate,).

    NaN where neither a numerical error nor one of the model is known, and nothing was sampled.

    Args:
        high: Whether large values are bad: the side of the quantile.
    """
    worst = -at.values if over == "min" else at.values
    point = np.where(np.isfinite(worst), worst, -np.inf).argmax(axis=2)[:, :, None]

    def taken(error: FloatArray) -> FloatArray:
        each = error @ weights if over == "mean" else np.take_along_axis(error, point, 2)[:, :, 0]
        return np.asarray(each)

    single = at.values.shape[1] == 1
    numerical, model = taken(at.numerical), taken(at.model)
    known = np.isfinite(numerical) | np.isfinite(model)
    both = np.where(known, np.nan_to_num(numerical) + np.nan_to_num(model), np.nan)
    if single:
        return np.asarray(both[:, 0])
    count = at.values.shape[1]
    part = share if high else 1 - share
    half = 1.96 * np.sqrt(part * (1 - part) / count)
    values = _over(at.values, over, weights)
    with np.errstate(invalid="ignore"):
        ends = np.quantile(values, np.clip([part - half, part + half], 0, 1), axis=1)
    sampled = (ends[1] - ends[0]) / 2
    return np.asarray(sampled + np.where(known, both, 0).mean(axis=1))


def _of_objective(
    at: PointValues, table: ObjectiveTable, weights: FloatArray, quantile: float
) -> tuple[FloatArray, FloatArray]:
    high = table.goal == "minimise"
    value = _quantile(_over(at.values, table.over, weights), quantile, high)
    return value, _error(at, table.over, weights, quantile, high)


def limit_scale(table: ConstraintTable) -> float:
    """The size of a limit, to which violations are relative."""
    return max(abs(each) for each in (table.low, table.high) if each is not None) or 1.0


def _of_constraint(
    at: PointValues, table: ConstraintTable, weights: FloatArray, quantile: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Value, error and relative violation of a constraint; with two limits those of the one that is nearer."""
    sides = []
    for limit, high in ((table.high, True), (table.low, False)):
        if limit is None:
            continue
        over = table.over or ("max" if high else "min")
        value = _quantile(_over(at.values, over, weights), quantile, high)
        far = (value - limit if high else limit - value) / limit_scale(table)
        far = np.where(np.abs(value - limit) <= _ROUNDING * abs(limit), 0.0, far)
        sides.append((value, _error(at, over, weights, quantile, high), far))
    if len(sides) == 1:
        return sides[0]
    upper = np.nan_to_num(sides[0][2], nan=-np.inf) >= np.nan_to_num(sides[1][2], nan=-np.inf)
    first, second = sides
    return (
        np.where(upper, first[0], second[0]),
        np.where(upper, first[1], second[1]),
        np.where(upper, first[2], second[2]),
    )
