"""Results of a block of points: created empty, filled as points end, split, and stored in journals and cubes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface.outcome import Outcome

WORK = ("steps", "force_evaluations", "solves", "simulated_seconds")
"""Fields of a `BlockResult` that count the work of each point; a retry adds to them."""

Rows = NDArray[np.integer[Any]] | slice | int


@dataclass(frozen=True)
class Values:
    r"""One output of a block of points."""

    dims: tuple[str, ...]  # dimensions of one point's value
    data: NDArray[Any]  # shape (point, \*dims); NaN where a point has no result
    unit: str = ""  # from a user's function; empty if it gives none, or if the simulator declares the output


def common_unit(name: str, unit: str, other: str) -> str:
    """The common unit of an output at two sets of points; an empty unit agrees with any.

    Raises:
        InputError: If points have different units.
    """
    if unit and other and unit != other:
        raise InputError(f"{name}: points have different units {unit!r} and {other!r}")
    return unit or other


def refuse_other_dims(name: str, dims: tuple[str, ...], other: tuple[str, ...]) -> None:
    """Refuse an output that has other dimensions at other points (InputError)."""
    if dims != other:
        raise InputError(f"{name}: points have different dimensions {', '.join(dims)} and {', '.join(other)}")


def take_labels(known: dict[str, NDArray[Any]], given: Mapping[str, NDArray[Any]]) -> None:
    """Add the labels along dimensions of further points to those that are known.

    Raises:
        InputError: If points have different labels.
    """
    for dim, labels in given.items():
        held = known.setdefault(dim, labels)
        if held is labels or np.array_equal(held, labels):
            continue
        numbers = held.shape == labels.shape and {held.dtype.kind, labels.dtype.kind} <= set("iuf")
        if not numbers or not np.allclose(held, labels, rtol=1e-12, atol=0, equal_nan=True):  # rounding
            raise InputError(f"dimension {dim!r}: points have different labels; a cube has the same at all points")


@dataclass(frozen=True)
class Retries:
    """Changes that retries made to a block; the first axis of every array is the point."""

    # number of the last tried change, 0 for the first attempt, shape (point,)
    attempt: NDArray[np.int8]
    # first_outcome, first_detail: how the first attempt ended, with the reason of a failure or a note
    first_outcome: NDArray[np.int8]
    first_detail: list[str]
    # parameters that a retry may change, with the values of the attempt that finished, else of the first attempt:
    # floats (NaN where the model has no such parameter), or words (empty there)
    used: dict[str, NDArray[Any]]

    def take(self, rows: NDArray[np.integer[Any]]) -> Retries:
        """The retries of some points, in the order of `rows`."""
        return Retries(
            self.attempt[rows],
            self.first_outcome[rows],
            [self.first_detail[row] for row in rows],
            {name: column[rows] for name, column in self.used.items()},
        )


@dataclass(frozen=True, kw_only=True)
class BlockResult:
    """Results of a simulator for a block of points; the first axis of every array is the point."""

    outcome: NDArray[np.int8]  # `Outcome` values, shape (point,)
    detail: list[str]  # why a point failed, or a note on one that finished; mostly empty there
    # steps, force_evaluations, solves: counted work, shape (point,); solves are factorisations of a linear system, zero
    # for methods without one
    steps: IntArray
    force_evaluations: IntArray
    solves: IntArray
    # simulated time up to the end or the failure, shape (point,); NaN without a motion
    simulated_seconds: FloatArray
    outputs: dict[str, Values] = field(default_factory=dict)  # kept outputs by name
    coordinates: dict[str, NDArray[Any]] = field(default_factory=dict)  # labels along the dimensions of the outputs
    # tolerances or steps that runs chose, by the name of the parameter, shape (point,) each; NaN if given
    settled: dict[str, FloatArray] = field(default_factory=dict)
    retries: Retries | None = None  # None without retries

    @classmethod
    def blank(
        cls, count: int, outcome: Outcome = Outcome.NOT_RUN, detail: str = "", simulated_seconds: float = 0.0
    ) -> BlockResult:
        """Points without outputs and without work, all with the same outcome and detail."""
        return cls(
            outcome=np.full(count, outcome, np.int8),
            detail=[detail] * count,
            steps=np.zeros(count, np.int64),
            force_evaluations=np.zeros(count, np.int64),
            solves=np.zeros(count, np.int64),
            simulated_seconds=np.full(count, simulated_seconds),
        )

    @property
    def count(self) -> int:
        """Number of points."""
        return self.outcome.size

    @property
    def nbytes(self) -> int:
        """Bytes of the outputs."""
        return sum(values.data.nbytes for values in self.outputs.values())

    def end(self, rows: Rows, outcome: Outcome, detail: str = "") -> None:
        """Set outcome and detail of some points."""
        self.outcome[rows] = outcome
        for row in np.atleast_1d(np.arange(self.count)[rows]):
            self.detail[row] = detail

    def put(self, name: str, dims: tuple[str, ...], rows: Rows, data: NDArray[Any], unit: str = "") -> None:
        r"""Set one output of some points; the others stay NaN.

        Args:
            data: Their values, shape (rows, \*dims), or the values of a single point for a single row.
            unit: From a user's function.

        Raises:
            InputError: If points have values of different dimensions, shapes or units.
        """
        shape = data.shape if isinstance(rows, int) else data.shape[1:]
        if name not in self.outputs:
            self.outputs[name] = Values(dims, np.full((self.count, *shape), np.nan))
        refuse_other_dims(name, self.outputs[name].dims, dims)
        held = self.outputs[name].data
        if held.shape[1:] != shape:
            raise InputError(f"{name}: points have different shapes {held.shape[1:]} and {shape}")
        if unit != self.outputs[name].unit:
            self.outputs[name] = replace(self.outputs[name], unit=common_unit(name, self.outputs[name].unit, unit))
        held[rows] = data

    def settle(self, name: str, rows: Rows, values: FloatArray | float) -> None:
        """Record the tolerance or step that runs chose."""
        self.settled.setdefault(name, np.full(self.count, np.nan))[rows] = values

    def fill(self, rows: NDArray[np.integer[Any]], part: BlockResult) -> None:
        """Copy another block's points into these rows, with the outputs of the finished ones."""
        self.outcome[rows] = part.outcome
        for row, text in zip(rows, part.detail, strict=True):
            self.detail[row] = text
        for name in WORK:
            getattr(self, name)[rows] = getattr(part, name)
        for name in self.settled.keys() | part.settled.keys():
            self.settle(name, rows, part.settled.get(name, np.full(part.count, np.nan)))
        finished = part.outcome == Outcome.FINISHED
        for name, values in part.outputs.items():
            self.put(name, values.dims, rows[finished], values.data[finished], values.unit)
        take_labels(self.coordinates, part.coordinates)

    def take(self, rows: NDArray[np.integer[Any]], keep: Collection[str] = ()) -> BlockResult:
        """Copies of some points, in the order of `rows`, with the outputs named in `keep`, or with all."""
        outputs = {
            name: replace(values, data=values.data[rows])
            for name, values in self.outputs.items()
            if not keep or name in keep
        }
        along = {dim for values in outputs.values() for dim in values.dims}
        return replace(
            self,
            outcome=self.outcome[rows],
            detail=[self.detail[row] for row in rows],
            outputs=outputs,
            coordinates={name: labels for name, labels in self.coordinates.items() if name in along},
            settled={name: column[rows] for name, column in self.settled.items()},
            retries=self.retries.take(rows) if self.retries else None,
            **{name: getattr(self, name)[rows] for name in WORK},
        )
