"""Errors of the candidates that a pilot ran, against the finest one that finished at each point, and their prices.

A candidate differs from the reference by d, which has a numerical error n of its own. As n is exceeded once in twenty,
it is two standard deviations, and the error of the candidate is sqrt(d^2 + (n / 2)^2). That is on the safe side: where
the numerical errors of different points have nothing to do with each other, d holds them already. Of a full model, n
itself is the error: how much smaller the error is, is not known.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.encoding import in_unit_cube
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Candidate, Outcome, Quantity
from tripod_doe.study.definition.accuracy_table import AutoModel

AS_GOOD = 1.1
"""Ratio to the reference's error up to which a candidate is accepted where neither meets the accuracy."""
HOPELESS = 10.0
"""Error over the allowed one that also stands for a candidate that failed: a larger number
would spoil the interpolation at distant points."""

_DEVIATIONS = 2
"""Standard deviations in a numerical error. Of `rollers` at 60 points of the field (benchmarks/accuracy.py) the complex
error is 1/1.69 of the reported one in the median: 1/1.70 follows where that is twice the deviation of the amplitude."""


@dataclass(frozen=True)
class PilotErrors:
    """Errors and prices of the candidates that a pilot ran. All errors are relative, divided by the allowed ones.

    The reference of a point is the finest full candidate that finished there.
    """

    columns: dict[str, NDArray[Any]]  # factors of the pilot points, each of shape (pilot point,)
    candidates: tuple[Candidate, ...]  # the candidates that it ran, from the cheapest to the finest
    # of each candidate to the reference, with sign, shape (pilot point, candidate, quantity); NaN where the candidate
    # failed, 0 for candidates finer than the reference, which did not run there
    differences: FloatArray
    numerical: FloatArray  # numerical error of the reference, shape (pilot point, quantity)
    prices: FloatArray  # CPU seconds per run of each candidate, shape (candidate,)
    runs: IntArray  # points at which each candidate ran, shape (candidate,)

    @property
    def count(self) -> int:
        """Number of pilot points."""
        return int(self.numerical.shape[0])

    @property
    def errors(self) -> FloatArray:
        """Difference and uncertainty, as the root of the sum of squares."""
        whole = np.hypot(self.differences, self.numerical[:, None] * self.uncertain[:, None])
        return np.asarray(np.minimum(np.nan_to_num(whole, nan=HOPELESS), HOPELESS))

    @property
    def uncertain(self) -> FloatArray:
        """Share of the reference's numerical error that adds to a candidate's, shape (candidate,)."""
        return np.array([1.0 if candidate.full else 1 / _DEVIATIONS for candidate in self.candidates[:-1]] + [1.0])

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether the reference meets the accuracy itself, so that it can judge others, shape (pilot point,)."""
        return np.asarray((self.numerical <= 1).all(axis=1))

    @property
    def worst(self) -> FloatArray:
        """Error of the worst quantity, shape (pilot point, candidate)."""
        return np.asarray(self.errors.max(axis=2))

    @property
    def accepted(self) -> NDArray[np.bool_]:
        """Whether a candidate is within the accuracy, or as good as the reference, shape (pilot point, candidate)."""
        worst = self.worst
        return np.asarray(worst <= np.maximum(1.0, AS_GOOD * worst[:, -1:]))

    @property
    def price(self) -> float:
        """CPU seconds of the pilot."""
        return float(self.prices @ self.runs)


def pilot_errors(pilot: xr.Dataset, names: list[str], auto: AutoModel) -> PilotErrors:
    """Errors of each candidate against the reference of each pilot point, and its price.

    Args:
        pilot: A cube with its costs, of any design that runs some of the candidates of `accuracy` at some points.

    Raises:
        InputError: If the cube lacks a factor, a quantity or a candidate, or the reference finished nowhere.
    """
    cells = {name: _column(pilot, name) for name in [*names, *auto.parameters]}
    candidate_of = np.full(pilot["outcome"].size, -1)
    for number, candidate in enumerate(auto.candidates):
        candidate_of[np.all([_equal(cells[name], value) for name, value in candidate.values.items()], axis=0)] = number
    ran = [number for number in range(len(auto.candidates)) if (candidate_of == number).any()]
    if len(ran) < 2:
        raise InputError("the pilot ran fewer than two candidates: nothing can be compared")
    own = {name: cells[name] for name in names}
    _, first, point_of = np.unique(in_unit_cube(own, own).round(12), axis=0, return_index=True, return_inverse=True)
    table = np.full((first.size, len(ran)), -1)
    for position, number in enumerate(ran):
        chosen = np.flatnonzero(candidate_of == number)
        table[point_of[chosen], position] = chosen
    candidates = tuple(auto.candidates[number] for number in ran)
    reference = _references(pilot, table, candidates)
    known = reference >= 0
    if not known.any():
        raise InputError(
            f"the pilot's reference ({candidates[-1].label}) finished at no point: nothing can be compared"
        )
    pairs = [
        _errors(pilot, quantity, table[known], reference[known], auto.accuracy.floor)
        for quantity in auto.accuracy.quantities
    ]
    differences, numerical = (np.stack(parts, axis=-1) for parts in zip(*pairs, strict=True))
    columns = {name: column[first][known] for name, column in own.items()}
    return PilotErrors(
        columns, candidates, differences, numerical, _prices(pilot, table, candidates), (table >= 0).sum(axis=0)
    )


def _usable(pilot: xr.Dataset, table: IntArray) -> NDArray[np.bool_]:
    """Whether a candidate finished at a point, shape (pilot point, candidate)."""
    return np.asarray((table >= 0) & (pilot["outcome"].values.reshape(-1)[table] == Outcome.FINISHED))


def _references(pilot: xr.Dataset, table: IntArray, candidates: tuple[Candidate, ...]) -> IntArray:
    """Position of the finest full candidate (the last, if none is full) that finished at each point, -1 if none did."""
    judges = np.array([candidate.full for candidate in candidates])
    judges[-1] = True
    able = _usable(pilot, table) & judges
    return np.where(able.any(axis=1), len(candidates) - 1 - able[:, ::-1].argmax(axis=1), -1)


def _column(pilot: xr.Dataset, name: str) -> NDArray[Any]:
    """A parameter in every cell of a cube, shape (cell,), whether it varies or all share it."""
    if name in pilot.coords:
        return np.asarray(xr.broadcast(pilot["outcome"], pilot[name])[1].values.reshape(-1))
    fixed = json.loads(str(pilot.attrs.get("fixed_parameters", "{}")))
    if name not in fixed:
        known = near_match(name, [*(str(key) for key in pilot.coords), *fixed])
        raise InputError(f"the pilot has no {name}, which the study varies or chooses{known}")
    return np.full(pilot["outcome"].size, fixed[name])


def _equal(column: NDArray[Any], value: object) -> NDArray[np.bool_]:
    if isinstance(value, str):
        return np.asarray(column.astype(str) == value)
    return np.isclose(column.astype(float), float(value), rtol=1e-9, atol=0)  # type: ignore[arg-type]


def _errors(
    pilot: xr.Dataset, quantity: Quantity, table: IntArray, reference: IntArray, floor: float
) -> tuple[FloatArray, FloatArray]:
    """Differences to the reference, shape (pilot point, candidate), NaN where a run failed, and numerical errors."""
    values, largest = _cells(pilot, quantity.output, quantity)
    numerical = np.zeros_like(values)
    if quantity.error in pilot:
        numerical = np.nan_to_num(_cells(pilot, quantity.error, quantity)[0])
    cell = table[np.arange(reference.size), reference]
    finer = (table < 0) & (np.arange(table.shape[1]) > reference[:, None])
    at = np.where(_usable(pilot, table), values[table], np.where(finer, values[cell][:, None], np.nan))
    size = np.maximum(np.abs(values[cell]), floor * largest[cell]) * quantity.allowed
    return _over(at - values[cell][:, None], size[:, None]), _over(numerical[cell], size)


def _over(errors: FloatArray, size: FloatArray) -> FloatArray:
    """Errors over the allowed ones, at most `HOPELESS`; none is none where a point has no force at all, either."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(errors == 0, 0.0, np.clip(errors / size, -HOPELESS, HOPELESS))


def _cells(pilot: xr.Dataset, name: str, quantity: Quantity) -> tuple[FloatArray, FloatArray]:
    """A quantity in every cell, and the largest value next to it; shape (cell,)."""
    if name not in pilot:
        known = near_match(name, [str(key) for key in pilot.data_vars])
        raise InputError(f"[accuracy]: {quantity.name}: the pilot has no output {name}{known}")
    rows = pilot[name].values.reshape(pilot["outcome"].size, -1)
    if quantity.label is None:
        return rows[:, 0], np.abs(rows[:, 0])
    labels = pilot[str(pilot[name].dims[-1])].values.tolist()
    if quantity.label not in labels:
        raise InputError(f"[accuracy]: {quantity.name}: {name} goes from {labels[0]} to {labels[-1]}")
    rotating = [position for position, label in enumerate(labels) if label != 0]
    return rows[:, labels.index(quantity.label)], np.abs(rows[:, rotating]).max(axis=1)


def _prices(pilot: xr.Dataset, table: IntArray, candidates: tuple[Candidate, ...]) -> FloatArray:
    """Counted force evaluations, averaged over the pilot, times the recorded seconds per evaluation."""
    if "force_evaluations" not in pilot:
        return np.array([candidate.price for candidate in candidates])
    counted = np.where(table >= 0, pilot["force_evaluations"].values.reshape(-1)[table], np.nan)
    return np.asarray(np.nanmean(counted, axis=0) * [candidate.evaluation_seconds for candidate in candidates])
