"""Retries of a study: changes that are tried in order on points that failed, inside their own task.

Every change is made on top of those before it, until the point finishes. A change of the model takes the model's own
method, step and tolerance, a change of the method its own step and tolerance, unless the same change gives them: a
step that was chosen for one method says nothing about another.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.simulator import (
    WORK,
    BlockResult,
    Outcome,
    Retries,
    Simulator,
    Value,
    check_parameters,
    counted_time,
    is_set,
)

SMALLER_STEP = "smaller-step"
"""The change that halves the step or the tolerance that is in force: the one that is given, or that a run settled."""

_STEPS = ("step_s", "relative_tolerance")
_FOLLOWERS = {"model": ("method", *_STEPS), "method": _STEPS}
_NEVER_RETRIED = (Outcome.FINISHED, Outcome.NOT_APPLICABLE)


@dataclass(frozen=True)
class Change:
    """One change of the parameters of a point that failed."""

    values: Mapping[str, Value]  # parameters to set; empty for a smaller step

    @property
    def label(self) -> str:
        """The change in words."""
        told = (
            f"{name} = {value:g}" if isinstance(value, float) else f"{name} = {value}"
            for name, value in self.values.items()
        )
        return ", ".join(told) or SMALLER_STEP


@dataclass(frozen=True)
class RetryPlan:
    """The changes of a study, and which outcomes they are tried on."""

    changes: tuple[Change, ...] = ()  # in the order in which they are tried
    accepted: frozenset[int] = frozenset(_NEVER_RETRIED)  # outcomes that a point may end with, without a retry


NO_RETRIES = RetryPlan()
"""Of a study without retries."""


def check_retries(
    simulator: Simulator,
    base: Mapping[str, Value],
    factors: Mapping[str, Sequence[Value]],
    keep: Collection[str],
    entries: Sequence[str | Mapping[str, Any]],
    expected: Collection[str],
    unknown: Collection[str] = (),
) -> RetryPlan:
    """Check the retries of a study before anything runs.

    Parameters
    ----------
    simulator, base, keep
        What is simulated, and the values that all points share.
    factors
        Values that each factor takes; none where it is sampled.
    entries
        The changes as the study file gives them.
    expected
        Outcomes besides finished that do not count as failures.
    unknown
        Parameters whose values are known only from the points themselves.

    Raises
    ------
    InputError
        If a change is unknown, cannot be run, or makes no difference to any point.
    """
    changes = tuple(_change(simulator, entry) for entry in entries)
    touched = {name for change in changes for name in change.values}
    unsure = {name for name, levels in factors.items() if not levels} | set(unknown)
    points = list(_kinds_of_points(simulator, base, factors, touched))
    for change in changes:
        told = f"retry: {change.label}"
        after = [_changed(simulator, values, change, {}) for values in points]
        if not unsure & change.values.keys() and all(
            new is None or simulator.effective(new) == simulator.effective(old)
            for new, old in zip(after, points, strict=True)
        ):
            reason = "no point has a step or a tolerance" if not change.values else "it makes no difference"
            raise InputError(f"{told}: {reason}; remove it")
        points = [old if new is None else new for new, old in zip(after, points, strict=True)]
        _check_runnable(simulator, points, factors, keep, told)
    accepted = {*_NEVER_RETRIED, *(outcome for outcome in Outcome if outcome.label in expected)}
    return RetryPlan(changes, frozenset(int(outcome) for outcome in accepted))


def _change(simulator: Simulator, entry: str | Mapping[str, Any]) -> Change:
    if isinstance(entry, str):
        if entry != SMALLER_STEP:
            raise InputError(
                f'retry: {entry!r}: write "{SMALLER_STEP}" or a table, for instance {{ model = "rollers" }}'
                + near_match(entry, [SMALLER_STEP])
            )
        return Change({})
    if not entry:
        raise InputError("retry: {}: an empty table changes nothing; give a parameter and its value")
    try:
        return Change(check_parameters(simulator.parameters, entry))
    except InputError as error:
        raise InputError(f"retry: {error}") from error


def _kinds_of_points(
    simulator: Simulator, base: Mapping[str, Value], factors: Mapping[str, Sequence[Value]], touched: Collection[str]
) -> Iterator[dict[str, Value]]:
    """One set of values for every combination of levels that a change can meet in a study."""
    varied = {
        name: levels
        for name, levels in factors.items()
        if levels and (name in touched or name in _FOLLOWERS or name in _STEPS)
    }
    for values in itertools.product(*varied.values()):
        yield {**base, **dict(zip(varied, values, strict=True))}


def _check_runnable(
    simulator: Simulator,
    points: Sequence[Mapping[str, Value]],
    factors: Mapping[str, Sequence[Value]],
    keep: Collection[str],
    told: str,
) -> None:
    """Refuse a change that no point could be run with."""
    reasons = []
    for values in points:
        others = {name: levels for name, levels in factors.items() if name not in values}
        try:
            simulator.check({name: value for name, value in values.items() if value is not None}, others, keep)
        except InputError as error:
            reasons.append(error)
        else:
            return
    raise InputError(f"{told}: {reasons[0]}") from reasons[0]


def _changed(
    simulator: Simulator, values: Mapping[str, Value], change: Change, settled: Mapping[str, float]
) -> dict[str, Value] | None:
    """The values of a point after a change; None where it has no step or tolerance to be halved.

    `settled` are steps and tolerances that its last run settled by itself.
    """
    new, full = dict(values), simulator.effective(values)
    if change.values:
        for cause, followers in _FOLLOWERS.items():
            if change.values.get(cause, full.get(cause)) != full.get(cause):
                own = [name for name in followers if _is_numerics(simulator, name)]
                new |= {name: simulator.parameters[name].default for name in own}
        return {**new, **change.values}
    usual = simulator.methods(full).get(str(full.get("method")), {})
    for name in _STEPS:
        value = full.get(name) or settled.get(name) or usual.get(name)
        if value is not None:
            half = float(value) / 2
            return None if half < simulator.parameters[name].low else new | {name: half}
    return None


def _is_numerics(simulator: Simulator, name: str) -> bool:
    parameter = simulator.parameters.get(name)
    return parameter is not None and parameter.group == "numerics"


def changed_parameters(simulator: Simulator, retry: RetryPlan) -> tuple[str, ...]:
    """Names of the parameters that the retries may change, in the order of the simulator's."""
    touched = {name for change in retry.changes for name in change.values}
    for cause in touched & _FOLLOWERS.keys():
        touched = touched | {name for name in _FOLLOWERS[cause] if _is_numerics(simulator, name)}
    if any(not change.values for change in retry.changes):
        touched = touched | set(_STEPS)
    return tuple(name for name in simulator.parameters if name in touched)


def simulate_with_retries(
    simulator: Simulator, points: Mapping[str, NDArray[Any]], keep: Collection[str], retry: RetryPlan
) -> tuple[BlockResult, float, float]:
    """Simulate a block, and each of its points that failed again with one change more, until it finishes.

    Returns
    -------
    result : BlockResult
        With `Retries` where the study has any. Steps and evaluations are those of all attempts. A point that no change
        helps keeps its first outcome; its detail tells the whole history.
    cpu_seconds, wall_seconds : float
        Of all attempts; compilation is not counted.
    """
    result, cpu, wall = _timed(simulator, points, keep)
    if not retry.changes:
        return result, cpu, wall
    history = _History(simulator, points, result, retry)
    for change in retry.changes:
        rows, columns = history.next_attempt(change)
        if rows.size:
            again, more_cpu, more_wall = _timed(simulator, columns, keep)
            history.record(change, rows, again)
            cpu, wall = cpu + more_cpu, wall + more_wall
    return history.outcome(), cpu, wall


def untried(
    simulator: Simulator, points: Mapping[str, NDArray[Any]], result: BlockResult, retry: RetryPlan
) -> BlockResult:
    """A block that needs no retry, as `simulate_with_retries` would answer it."""
    return _History(simulator, points, result, retry).outcome() if retry.changes else result


def _timed(
    simulator: Simulator, points: Mapping[str, NDArray[Any]], keep: Collection[str]
) -> tuple[BlockResult, float, float]:
    simulator.prepare(points)
    cpu, wall = counted_time()
    result = simulator.simulate(points, keep)
    later_cpu, later_wall = counted_time()
    return result, later_cpu - cpu, later_wall - wall


def _settled(block: BlockResult, row: int) -> dict[str, float]:
    """Steps and tolerances that a point of a block settled by itself."""
    return {name: float(column[row]) for name, column in block.settled.items() if is_set(column[row])}


class _History:
    """What became of a block so far: its results, and the values that each point was last tried with."""

    def __init__(
        self, simulator: Simulator, points: Mapping[str, NDArray[Any]], first: BlockResult, retry: RetryPlan
    ) -> None:
        self._simulator, self._retry = simulator, retry
        self._first, self._points = first, points
        self._block = first.take(np.arange(first.count))
        self._waiting = ~np.isin(first.outcome, list(retry.accepted))
        self._values = {row: self._given(row) for row in np.flatnonzero(self._waiting).tolist()}
        self._attempt = np.zeros(first.count, np.int8)
        self._settled = {row: _settled(first, row) for row in self._values}

    def _given(self, row: int) -> dict[str, Value]:
        """The values of a point that are set."""
        values = {name: column[row : row + 1].tolist()[0] for name, column in self._points.items()}
        return {name: value for name, value in values.items() if is_set(value)}

    def next_attempt(self, change: Change) -> tuple[IntArray, dict[str, NDArray[Any]]]:
        """Rows that a change is tried on, and all their parameters with it; a change that gives the same is no try."""
        rows = []
        for row in np.flatnonzero(self._waiting).tolist():
            self._attempt[row] += 1
            new = _changed(self._simulator, self._values[row], change, self._settled[row])
            if new is None or self._simulator.effective(new) == self._simulator.effective(self._values[row]):
                continue
            self._values[row] = new
            rows.append(row)
        columns = {
            name: parameter.column([self._values[row].get(name) for row in rows])
            for name, parameter in self._simulator.parameters.items()
        }
        return np.array(rows, np.int64), columns

    def record(self, change: Change, rows: IntArray, again: BlockResult) -> None:
        """Take over the points that finished in an attempt, tell of the others, and count the work of all."""
        before = self._block.take(rows)
        helped = again.outcome == Outcome.FINISHED
        self._block.fill(rows[helped], again.take(np.flatnonzero(helped)))
        self._waiting[rows[helped]] = False
        self._settled |= {row: _settled(again, k) for k, row in enumerate(rows.tolist())}
        for row, told, outcome, detail in zip(rows, before.detail, again.outcome, again.detail, strict=True):
            if outcome != Outcome.FINISHED:
                history = f"{told}; then {change.label}: {Outcome(int(outcome)).label} {detail}"
                self._block.detail[row] = history.rstrip()
        for name in WORK:
            spent = np.stack([getattr(before, name), getattr(again, name)])
            unknown = np.isnan(spent).all(axis=0)
            getattr(self._block, name)[rows] = np.where(unknown, spent[0], np.nansum(spent, axis=0))

    def outcome(self) -> BlockResult:
        """The block with all its attempts."""
        names = changed_parameters(self._simulator, self._retry)
        used: dict[str, list[Value]] = {name: [] for name in names}
        for row in range(self._first.count):
            solved = row in self._values and not self._waiting[row]
            full = self._simulator.effective(self._values[row] if solved else self._given(row))
            full |= _settled(self._block if solved else self._first, row)
            for name in names:
                used[name].append(full[name])
        columns = {name: self._simulator.parameters[name].column(values) for name, values in used.items()}
        retries = Retries(
            self._attempt,
            self._first.outcome,
            list(self._first.detail),
            {
                name: np.array(["" if value is None else value for value in column], dtype=str)
                if column.dtype == object
                else column.astype(float)
                for name, column in columns.items()
            },
        )
        return replace(self._block, retries=retries)
