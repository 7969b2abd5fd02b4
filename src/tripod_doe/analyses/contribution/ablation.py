"""An ablation: its operating points, and the part of the amplitude that each combination of mechanisms gives there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import ComplexArray, FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.study.cube.dataset import SWITCH_ROLE
from tripod_doe.study.definition.study_file_schema import parse_file
from tripod_doe.study.designs.ablation import HALF

_ROUNDING = 1e-6  # an amplitude below this part of the operating point's largest amplitude is only error


@dataclass(frozen=True)
class OperatingPoints:
    """Operating points of an ablation, the operating point of each point of the cube, and their dimensions."""

    of_point: IntArray
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    labels: dict[str, xr.Variable]

    @property
    def count(self) -> int:
        """Number of operating points."""
        return math.prod(self.shape)


class Projections:
    """P(S) in percent, for combinations S written as bits, the first mechanism the lowest; NaN if unknown.

    Attributes:
        count: Number of mechanisms.
        total: |A_all|, shape (operating point, own dimensions).
        error: Its error: as known, at least rounding; same shape.
        weak: Where the magnitude is not above its error, same shape.
    """

    def __init__(self, switched: FloatArray, operating: OperatingPoints, values: ComplexArray, error: FloatArray):
        self.count = switched.shape[1]
        self._values = np.concatenate([values, np.full_like(values[:1], np.nan)])  # row -1: no such point
        self._row: dict[tuple[int, int], int] = {}
        codes = switched.astype(np.int64) @ (1 << np.arange(self.count))
        half = (switched == HALF) @ (1 << np.arange(self.count))
        codes = np.where(half > 0, -half, codes)
        for row, at in enumerate(zip(operating.of_point.tolist(), codes.tolist(), strict=True)):
            self._row.setdefault(at, row)
        self._points = operating.count
        self.all_on = (1 << self.count) - 1
        self._reference = self._amplitudes(self.all_on)
        self.total: FloatArray = np.abs(self._reference)
        largest = np.zeros(self._points)
        np.fmax.at(largest, operating.of_point, _largest(values))
        known = np.concatenate([error, np.full_like(error[:1], 0)])[self._rows(self.all_on)]
        floor = _ROUNDING * largest.reshape(-1, *(1,) * (values.ndim - 1))
        self.error: FloatArray = np.fmax(known, floor)
        self.weak: NDArray[np.bool_] = self.total <= self.error

    def _rows(self, combination: int) -> IntArray:
        return np.array([self._row.get((at, combination), -1) for at in range(self._points)], np.int64)

    def _amplitudes(self, combination: int) -> ComplexArray:
        return self._values[self._rows(combination)]

    def missing(self, combination: int) -> NDArray[np.bool_]:
        """Whether a combination has no result, for each operating point."""
        lost = np.isnan(self._amplitudes(combination)).reshape(self._points, -1)
        return np.asarray(lost.all(axis=1), bool)

    def __call__(self, combination: int) -> FloatArray:
        """P of one combination, shape (operating point, own dimensions)."""
        square = np.where(self.weak, np.nan, self.total) ** 2
        projected: FloatArray = 100 * (self._amplitudes(combination) * self._reference.conj()).real / square + 0.0
        return projected  # adding 0 turns -0 into 0

    def changes(self, combinations: Sequence[int]) -> FloatArray:
        """Change of the amplitude in percent with other combinations, shape (operating point, combination, ...).

        Args:
            combinations: As for a call; the bit of a mechanism whose friction is halved, with a minus.
        """
        whole = np.where(self.weak, np.nan, self.total)
        return np.stack([100 * (np.abs(self._amplitudes(each)) / whole - 1) for each in combinations], axis=1) + 0.0

    @property
    def is_halved(self) -> bool:
        """Whether there are points with a friction halved."""
        return any(code < 0 for _, code in self._row)

    def of_whole(self, parts: ComplexArray) -> FloatArray:
        """Parts of A_all in percent, (point, part, own dimensions) -> (operating point, part, own dimensions)."""
        square = np.where(self.weak, np.nan, self.total)[:, None] ** 2
        there = np.concatenate([parts, np.full_like(parts[:1], np.nan)])[self._rows(self.all_on)]
        return 100 * (there * self._reference[:, None].conj()).real / square + 0.0


def _largest(values: ComplexArray) -> FloatArray:
    """Largest magnitude of each point over the output's dimensions, zero if no value is known."""
    magnitude: FloatArray = np.nan_to_num(np.abs(values).reshape(len(values), -1))
    return magnitude.max(axis=1, initial=0.0)


def has_all_combinations(cube: xr.Dataset) -> bool:
    """Whether the design contains all combinations, so that a missing one is a gap, not a choice."""
    file = parse_file(cube.attrs["study"], "the study in the cube")
    designs = [file.design, *(file.designs[name] for name in file.design.of)]
    return any(design.kind == "ablation" and design.combinations == "all" for design in designs)


def switches_and_points(cube: xr.Dataset) -> tuple[list[str], OperatingPoints]:
    """Names of the switched mechanisms, and the operating points that the other factors make."""
    factors = [str(name) for name in cube.coords if cube[name].dims == ("point",) and "source" in cube[name].attrs]
    switches = [name for name in factors if cube[name].attrs.get("role") == SWITCH_ROLE]
    if not switches:
        raise InputError("this analysis needs the cube of an ablation design, alone or as a part of a product")
    return switches, _points_of(cube, [name for name in factors if name not in switches])


def _one_nan(value: Any) -> Any:
    """A value of a factor, where it is an open field always the same NaN: two of them are equal as keys."""
    return math.nan if isinstance(value, float) and math.isnan(value) else value


def _points_of(cube: xr.Dataset, factors: list[str]) -> OperatingPoints:
    """Operating points: one dimension per factor if they fill a grid, else one dimension for all."""
    columns = [[_one_nan(value) for value in cube[name].values.tolist()] for name in factors]
    levels = [list(dict.fromkeys(column)) for column in columns]
    shape = tuple(len(values) for values in levels)
    rows = list(zip(*columns, strict=True)) if factors else [()] * cube.sizes["point"]
    distinct = {row: position for position, row in enumerate(dict.fromkeys(rows))}

    def label(name: str, dim: str, values: list[Any]) -> xr.Variable:
        return xr.Variable((dim,), np.array(values, cube[name].dtype), cube[name].attrs)

    if len(distinct) == math.prod(shape):
        places = [{value: at for at, value in enumerate(values)} for values in levels]
        at = [[place[value] for value in column] for place, column in zip(places, columns, strict=True)]
        index = np.ravel_multi_index(tuple(np.array(a) for a in at), shape) if factors else np.zeros(len(rows), int)
        labels = {name: label(name, name, values) for name, values in zip(factors, levels, strict=True)}
        return OperatingPoints(np.asarray(index, np.int64), tuple(factors), shape, labels)
    dim = "operating_point"
    listed = {
        name: label(name, dim, list(values)) for name, values in zip(factors, zip(*distinct, strict=True), strict=True)
    }
    number = {dim: xr.Variable((dim,), np.arange(len(distinct), dtype=np.int32), {"long_name": "operating point"})}
    return OperatingPoints(
        np.array([distinct[row] for row in rows], np.int64), (dim,), (len(distinct),), number | listed
    )
