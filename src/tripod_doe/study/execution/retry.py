"""Retries: points of a block that failed are simulated again with the changes of the study, inside their own task."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.model_interface import WORK, BlockResult, Outcome, Retries, Simulator, Value, counted_time, is_set
from tripod_doe.study.definition.retry_plan import Change, RetryPlan, changed_parameters, changed_values


def simulate_with_retries(
    simulator: Simulator, points: Mapping[str, NDArray[Any]], keep: Collection[str], retry: RetryPlan
) -> tuple[BlockResult, float, float]:
    """Simulate a block, and repeat each failed point with one more change at a time until it finishes.

    Returns:
        result: With `Retries` if the study has any. Steps and evaluations are summed over all attempts. A point that
            never finishes keeps its first outcome; its detail lists all attempts.
        cpu_seconds, wall_seconds: Of all attempts, without compilation.
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
    """The result of a block that was not retried, with the fields of `simulate_with_retries`."""
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
    """Steps and tolerances that the run of a point chose by itself."""
    return {name: float(column[row]) for name, column in block.settled.items() if is_set(column[row])}


class _History:
    """The attempts at a block so far: its results, and the values of each point in its last attempt."""

    def __init__(
        self, simulator: Simulator, points: Mapping[str, NDArray[Any]], first: BlockResult, retry: RetryPlan
    ) -> None:
        self._simulator, self._retry = simulator, retry
        self._first, self._points = first, points
        self._block = first.take(np.arange(first.count))
        self._waiting = ~np.isin(first.outcome, list(retry.accepted))
        self._values = {row: self._set_values(row) for row in np.flatnonzero(self._waiting).tolist()}
        self._attempt = np.zeros(first.count, np.int8)
        self._settled = {row: _settled(first, row) for row in self._values}

    def _set_values(self, row: int) -> dict[str, Value]:
        """The values of a point that are set."""
        values = {name: column[row : row + 1].tolist()[0] for name, column in self._points.items()}
        return {name: value for name, value in values.items() if is_set(value)}

    def next_attempt(self, change: Change) -> tuple[IntArray, dict[str, NDArray[Any]]]:
        """Rows that a change affects, and all their parameters after it."""
        rows = []
        for row in np.flatnonzero(self._waiting).tolist():
            self._attempt[row] += 1
            new = changed_values(self._simulator, self._values[row], change, self._settled[row])
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
        """Copy the points that finished in an attempt, extend the detail of the others, and add up the work of all."""
        before = self._block.take(rows)
        helped = again.outcome == Outcome.FINISHED
        self._block.fill(rows[helped], again.take(np.flatnonzero(helped)))
        self._waiting[rows[helped]] = False
        self._settled |= {row: _settled(again, k) for k, row in enumerate(rows.tolist())}
        for row, earlier, outcome, detail in zip(rows, before.detail, again.outcome, again.detail, strict=True):
            if outcome != Outcome.FINISHED:
                history = f"{earlier}; then {change.label}: {Outcome(int(outcome)).label} {detail}"
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
            full = self._simulator.effective(self._values[row] if solved else self._set_values(row))
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
