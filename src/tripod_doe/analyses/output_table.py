"""All outputs of a cube as one table of numbers, and answers back under the labels of the outputs.

Every method of this package works on all columns of such a table at once. Phases are never taken as plain numbers:
where variances count, a phase stands as its cosine and sine, whose variances add up (a generalised Sobol' index, Gamboa
and others 2014); where values count, as its difference from the circular mean.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.number_text import number
from tripod_doe.phases import around_mean, is_phase, shorter_way
from tripod_doe.study.cube.dataset import COST_VARIABLES, PHASES, RECORD_ROLE, RESPONSE_ROLE, RESPONSES
from tripod_doe.study.cube.slab_reading import read_positions
from tripod_doe.study.memory import refuse_too_much_memory

_CONSTANT = 1e-9  # spread below which an output does not vary, over its largest magnitude
_LARGEST = 1e150  # sums of squares of larger numbers are infinite, of smaller ones than its inverse 0
_WAVEFORM = "rotation_deg"
_CHUNK = 5_000_000  # numbers that are worked on together
_MOST_NUMBERS = 10_000_000  # of an output that are read together


@dataclass(frozen=True)
class OutputTable:
    """One output, a column for each of its components."""

    name: str  # of the output
    variable: xr.DataArray  # as the cube holds it, the points along its first dimension
    values: FloatArray  # numbers, shape (point, component); phases relative to `centre`
    centre: FloatArray  # circular mean of phases (deg), else 0, shape (component,)
    wraps: bool  # whether they are phases
    # numerical error that the runs report of each component, in its unit; 0 where none is known. Shape (component,).
    error: FloatArray

    @property
    def is_waveform(self) -> bool:
        """Whether it is a course over the rotation angle."""
        return _WAVEFORM in self.variable.dims

    @property
    def varies(self) -> NDArray[np.bool_]:
        """Components that vary over the points beyond rounding, shape (component,)."""
        high, low = self.values.max(axis=0), self.values.min(axis=0)
        largest = 360.0 if self.wraps else float(max(high.max(initial=0.0), -low.min(initial=0.0)))
        return np.asarray(high - low > _CONSTANT * largest)

    def named(self, key: str) -> NDArray[np.bool_]:
        """The components that OUTPUT or OUTPUT_ORDER names, none if it names another output; shape (component,)."""
        shape = self.variable.shape[1:]
        if key == self.name:
            return np.ones(shape, bool).ravel()
        output, _, order = key.rpartition("_")
        if output == self.name and order.isdigit() and self.variable.dims[1:] == ("order",):
            return np.asarray(self.variable["order"].values == int(order))
        return np.zeros(shape, bool).ravel()

    @property
    def keys(self) -> list[str]:
        """Keys that `named` accepts."""
        orders = self.variable["order"].values if self.variable.dims[1:] == ("order",) else ()
        return [self.name, *(f"{self.name}_{order}" for order in orders)]

    def chunks(self) -> Iterator[IntArray]:
        """The components that vary, in parts that fit into the memory with their resamples."""
        indices, width = np.flatnonzero(self.varies), max(_CHUNK // self.values.shape[0], 1)
        for start in range(0, indices.size, width):
            yield indices[start : start + width]

    def parts(self, components: IntArray) -> FloatArray:
        """Numbers whose variances add up to the variance of each component, shape (part, point, component)."""
        values = self.values[:, components]
        if not self.wraps:
            return values[None]
        return np.stack([np.cos(np.radians(values)), np.sin(np.radians(values))])

    def placed(self, numbers: FloatArray) -> FloatArray:
        """Numbers relative to `centre` as the cube has them, phases above -180 and up to 180 deg."""
        return shorter_way(numbers + self.centre) if self.wraps else numbers

    def relative(self, numbers: FloatArray) -> FloatArray:
        """Numbers as a user gives them, relative to `centre`: a phase by the shorter way round."""
        return shorter_way(numbers - self.centre) if self.wraps else numbers

    def changes(self, differences: FloatArray) -> FloatArray:
        """Differences of numbers of this output; those of a phase by the shorter way round."""
        return shorter_way(differences) if self.wraps else differences

    def rows(self, chosen: IntArray) -> OutputTable:
        """The same output at some points only."""
        return replace(self, variable=self.variable[chosen], values=self.values[chosen])

    def labelled(self, answer: FloatArray, dims: tuple[str, ...]) -> xr.DataArray:
        """An answer, shape (*dims, component), under the labels of the output."""
        own = tuple(str(dim) for dim in self.variable.dims[1:])
        shape = (*answer.shape[: len(dims)], *self.variable.shape[1:])
        labels = {dim: self.variable[dim] for dim in own if dim in self.variable.coords}
        return xr.DataArray(answer.reshape(shape), dims=dims + own, coords=labels)


def chosen_outputs(cube: xr.Dataset, asked: Iterable[str]) -> list[str]:
    """Names of the outputs to analyse: the requested ones, else all results.

    Raises:
        InputError: If an output is not in the cube, or no point finished.
    """
    outputs = [
        str(name)
        for name, variable in cube.data_vars.items()
        if variable.dtype.kind == "f" and name not in COST_VARIABLES and variable.attrs.get("role") != RECORD_ROLE
    ]
    for name in asked:
        if name not in outputs:
            raise InputError(f"outputs: {name!r} is not in the cube{near_match(name, outputs)}")
    if not outputs:
        raise InputError("no point finished: there is no output to analyse")
    return list(dict.fromkeys(asked)) or outputs


def read_outputs(cube: xr.Dataset, names: Iterable[str], rows: IntArray) -> Iterator[OutputTable]:
    """Outputs as tables, each read when it is its turn.

    Args:
        cube: A cube whose points lie along ``point``.
        rows: Points to take, at which the outputs are finite.

    Raises:
        InputError: If an output does not fit into the free memory.
    """
    for name in names:
        yield _table(cube, name, rows)


def is_course(cube: xr.Dataset, name: str) -> bool:
    """Whether an output is a course over the rotation angle."""
    return _WAVEFORM in cube[name].dims


def answered_in_parts(
    cube: xr.Dataset, name: str, rows: IntArray, answer: Callable[[OutputTable], xr.Dataset]
) -> xr.Dataset:
    """Answers of one output, part by part along its last dimension, so that a course of many points fits into memory.

    Args:
        cube, name, rows: As for `read_outputs`.
        answer: Answers, under the labels of the output, for each component by itself.
    """
    parts = [answer(_table(part, name, rows)) for part in _parts(cube, name, rows.size)]
    if len(parts) == 1:
        return parts[0]
    return xr.concat(parts, cube[name].dims[-1], data_vars="minimal", coords="minimal", compat="equals")


def _parts(cube: xr.Dataset, name: str, points: int) -> Iterator[xr.Dataset]:
    """A cube with parts of an output along its last dimension."""
    variable = cube[name]
    last, length = str(variable.dims[-1]), variable.shape[-1]
    numbers = points * math.prod(variable.shape[1:])
    width = 1 << max(length * _MOST_NUMBERS // max(numbers, 1), 1).bit_length() - 1  # as chunks of large cubes
    for start in range(0, length, width) if variable.ndim > 1 else [0]:
        yield cube.isel({last: slice(start, start + width)}) if width < length and variable.ndim > 1 else cube


def _table(cube: xr.Dataset, name: str, rows: IntArray) -> OutputTable:
    variable = cube[name].isel(point=rows)
    needed = 2 * 8 * math.prod(variable.shape)  # with a copy
    refuse_too_much_memory(needed, f"{name} of {rows.size:,} points", "name fewer outputs in the analysis")
    values = read_positions(cube[name].variable, {"point": rows}).astype(float, copy=False).reshape(rows.size, -1)
    largest = max(np.fmax.reduce(values, axis=None, initial=0.0), -np.fmin.reduce(values, axis=None, initial=0.0))
    if largest and not 1 / _LARGEST < largest < _LARGEST:
        raise InputError(f"{name} has values of {number(largest)}, whose squares no number holds: use another unit")
    wraps = is_phase(variable)
    centre = np.zeros(values.shape[1])
    if wraps:
        values, centre = around_mean(values)
    error = np.zeros(values.shape[1])
    if f"{name}_error" in cube and cube[f"{name}_error"].dims == variable.dims:
        reported = read_positions(cube[f"{name}_error"].variable, {"point": rows}).astype(float).reshape(rows.size, -1)
        known = np.isfinite(reported)
        error = np.where(known, reported, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return OutputTable(name, variable, values, centre, wraps, error)


def is_level(attributes: Mapping[str, object]) -> bool:
    """Whether an output is a level as in dB: its zero is a reference that somebody chose, so it has no percentages."""
    return str(attributes.get("units", "")).startswith("dB") or "log10(" in str(attributes.get("formula", ""))


def without_zero(variable: xr.DataArray) -> bool:
    """Whether an output has no zero of its own, so that percentages and shares of it mean nothing: level or phase."""
    return is_level(variable.attrs) or is_phase(variable)


def side_by_side(cube: xr.Dataset, names: Sequence[str]) -> list[str]:
    """The outputs whose answers are in one variable along ``output``; the others have variables of their own.

    Those with the dimensions that most outputs have (else the fewest), or with some of them: an output with a further
    dimension would repeat the answers of all others along it, six hundred times for all outputs of the joint. Courses
    over the rotation angle stand alone.
    """
    if len(names) == 1:
        return list(names)
    own = {name: tuple(dim for dim in cube[name].dims if dim != "point") for name in names}
    own = {name: dims for name, dims in own.items() if _WAVEFORM not in dims}
    counts = Counter(dims for dims in own.values() if dims)
    shared = max(counts, key=lambda dims: (counts[dims], -len(dims)), default=())
    return [name for name, dims in own.items() if set(dims) <= set(shared)]


def stacked(parts: Mapping[str, xr.Dataset], joint: Sequence[str]) -> xr.Dataset:
    """The answers of several outputs: some along ``output``, each other one as variables OUTPUT_ANSWER.

    Args:
        joint: Outputs that stand side by side; one alone has no dimension ``output``.
    """
    together = [parts[name] for name in joint]
    result = together[0] if together else xr.Dataset()
    if len(together) > 1:
        outputs = xr.DataArray(np.array(joint, dtype=object), dims="output", name="output")
        result = xr.concat(together, outputs, join="outer", coords="minimal", compat="equals")
    for name in [name for name in parts if name not in joint]:
        own = {f"{name}_{key}": values for key, values in parts[name].data_vars.items()}
        result = result.merge(own, compat="override", combine_attrs="drop")
    return result


def meaning_of(name: str, meanings: Mapping[str, str]) -> str:
    """The meaning of an answer, also of one that is under the name of its output."""
    return meanings[next(key for key in sorted(meanings, key=len, reverse=True) if f"_{name}".endswith(f"_{key}"))]


def output_attributes(cube: xr.Dataset, names: Iterable[str]) -> dict[str, str]:
    """Attributes of a result: the outputs that were analysed, and their units by name."""
    units = {name: str(cube[name].attrs.get("units", "1")) for name in names}
    own = [name for name in units if cube[name].attrs.get("role") == RESPONSE_ROLE]
    phases = [name for name in units if is_phase(cube[name])]
    lists = {RESPONSES: own, PHASES: phases}
    return {"outputs": ", ".join(units), "output_units": json.dumps(units)} | {
        key: ", ".join(those) for key, those in lists.items() if those
    }


def usual_outputs(cube: xr.Dataset, asked: Collection[str], is_given: bool) -> list[str]:
    """Names of the outputs of an analysis that takes the thrust amplitude unless a study names others.

    Without names the responses of the study are taken as well; of a function all its outputs.
    """
    if is_given:
        return chosen_outputs(cube, asked)
    names = chosen_outputs(cube, ())
    own = [name for name in names if cube[name].attrs.get("role") == RESPONSE_ROLE]
    return [*asked, *own] if set(asked) <= set(names) else names
