"""Questions to a cube: choose cells by value, by range or by a condition, and get them as labelled records."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import CubeError, InputError, near_match, option, printable
from tripod_doe.files.csv_table import csv_cell
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import level, plain_json
from tripod_doe.phases import is_phase, is_phase_name
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.cube.slab_reading import read_positions
from tripod_doe.study.cube.slabs import box, slabs
from tripod_doe.study.expressions import MOST_VALUES, Expression
from tripod_doe.study.memory import refuse_too_much_memory
from tripod_doe.study.named_arrays import NamedArray
from tripod_doe.study.query.selection import (
    Chosen,
    Selection,
    labels_text,
    nearest_rows,
    refuse_unmatched,
    selections,
    sole_number,
    taken,
)
from tripod_doe.study.result_directory.open_cube import opened_cube

_SLAB_CELLS = 4_000_000  # cells of a variable that are read together
_NOTHING = 1e-12  # part of the largest amplitude below which an amplitude is rounding
_VALUE_BYTES = 140  # of a value of an answer while it becomes text

Columns = dict[str, NDArray[Any]]


def query(
    cube: xr.Dataset | str | Path,
    variable: str,
    select: Mapping[str, Chosen] | Sequence[Selection | str] = (),
    nearest: bool = False,
    where: str | None = None,
    beside: Sequence[str] = (),
) -> xr.Dataset:
    """Choose cells of one variable, or of several along the same dimensions.

    Args:
        cube: An open cube, or where it is.
        variable: Name of the variable.
        select: Values, lists or ranges of coordinates: ``{"order": 3, "torque_n_m": slice(20, 60)}``, or as on the
            command line ``["order=3", "torque_n_m=20:60"]``. Values match to 1e-9 relative, or as they are printed.
        nearest: Take the nearest value of a coordinate where none matches.
        where: Condition on coordinates, scalar variables, the variable itself and ``outcome``; flags by their meanings.
        beside: Names of further variables; values of one with fewer dimensions are repeated.

    Returns:
        The variables, the outcome of its points where the cube has one, and ``selected``: whether a cell meets `where`.

    Raises:
        InputError: If a name is unknown, with the nearest known one. An empty answer is no error.
    """
    if isinstance(cube, str | Path):
        with opened_cube(cube) as data:
            answer = query(data, variable, select, nearest, where, beside)
            _refuse_large_answer(math.prod(answer[variable].shape), answer.nbytes)
            return answer.load()
    data = cube
    chosen = _choose(data, variable, select, nearest, beside)
    answer = data[list(chosen.variables)].isel(chosen.rows)
    answer = answer.drop_vars([name for name in answer.coords if name not in chosen.coordinates])
    if where is None:
        return answer
    return answer.assign(selected=(chosen.target.dims, chosen.meeting(where)))


def records(
    cube: xr.Dataset,
    variable: str,
    select: Mapping[str, Chosen] | Sequence[Selection | str] = (),
    nearest: bool = False,
    where: str | None = None,
    beside: Sequence[str] = (),
) -> Columns:
    """Choose cells of variables, as columns of equal length; see `query`.

    Returns:
        The coordinates by name, the variables and the outcome; flags by their meanings.
    """
    chosen = _choose(cube, variable, select, nearest, beside)
    columns = len(chosen.variables) + len(chosen.coordinates) + len(chosen.target.dims)
    cells, parts = 0 if where else math.prod(chosen.shape), list[Columns]()
    _refuse_large_answer(cells, _VALUE_BYTES * cells * columns)
    for part in chosen.parts():
        parts.append(part.columns(where))
        cells = sum(part[variable].size for part in parts)
        _refuse_large_answer(cells, _VALUE_BYTES * cells * columns)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _refuse_large_answer(cells: int, needed: int) -> None:
    refuse_too_much_memory(needed, f"an answer of {cells:,} cells", "select fewer cells")


def cell_count(
    cube: xr.Dataset,
    variable: str,
    select: Mapping[str, Chosen] | Sequence[Selection | str] = (),
    nearest: bool = False,
) -> int:
    """Number of selected cells; reads only coordinates."""
    return math.prod(_choose(cube, variable, select, nearest).shape)


def unmet(cube: xr.Dataset, select: Mapping[str, Chosen] | Sequence[Selection | str]) -> str:
    """The reason of an empty answer: the first selection without a matching label, and the existing labels."""
    for selection in selections(select):
        labels = cube.variables[selection.name]
        if taken(labels, None, selection, False).size == 0:
            ordered = bool(selection.values) and labels.dtype.kind in "fiu"
            remedy = "; --nearest takes the closest" if ordered else ""
            return f"{selection.name} {labels_text(labels)}{remedy}"
    return "no cell meets all conditions"


@dataclass(frozen=True)
class _Choice:
    """Chosen cells of a cube: a variable, the variables next to it, and the rows along each dimension."""

    cube: xr.Dataset  # the whole cube
    variable: str  # the name of the variable, or of the one with the most dimensions
    # variables, coordinates: the variables and the outcome, and the coordinates along the dimensions of the variable
    variables: Mapping[str, xr.Variable]
    coordinates: Mapping[str, xr.Variable]
    rows: Mapping[Any, IntArray]  # selected positions by dimension; all positions of an unnamed dimension

    @property
    def target(self) -> xr.Variable:
        """The variable itself."""
        return self.variables[self.variable]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of chosen cells along each dimension of the variable."""
        return tuple(self.rows[dim].size if dim in self.rows else self.cube.sizes[dim] for dim in self.target.dims)

    def parts(self) -> Iterator[_Choice]:
        """The same cells in slabs, in their order, so that only one slab is in memory besides the answer."""
        shape = self.shape
        if math.prod(shape) <= _SLAB_CELLS:
            yield self
            return
        for slab in slabs(shape, box(shape, 1, _SLAB_CELLS)):
            yield self._within(slab.place)

    def _within(self, place: tuple[slice, ...]) -> _Choice:
        """The cells of a box of them."""
        rows = {
            dim: self.rows[dim][along] if dim in self.rows else np.arange(along.start, along.stop)
            for dim, along in zip(self.target.dims, place, strict=True)
        }
        return replace(self, rows={**self.rows, **rows})

    def columns(self, where: str | None) -> Columns:
        """The chosen cells that meet a condition, as columns of equal length."""
        kept = np.ones(self.shape, bool) if where is None else self.meeting(where)
        dims = self.target.dims
        numbers = (self.rows.get(dim, np.arange(self.cube.sizes[dim])) for dim in dims)
        columns = dict(zip(map(str, dims), np.meshgrid(*numbers, indexing="ij", copy=False), strict=True))
        columns |= {name: self.column(name) for name in self.coordinates if dims}
        columns |= {name: self.column(name) for name in self.variables}
        return {name: column[kept] for name, column in columns.items()}

    def spread(self, other: xr.Variable) -> NDArray[Any]:
        """Values of a variable at the chosen cells, broadcast over the dimensions of the target."""
        return self._along(other.dims, read_positions(other, self.rows))

    def _along(self, dims: Sequence[Any], values: NDArray[Any]) -> NDArray[Any]:
        order = [dims.index(dim) for dim in self.target.dims if dim in dims]
        missing = tuple(axis for axis, dim in enumerate(self.target.dims) if dim not in dims)
        return np.broadcast_to(np.expand_dims(values.transpose(order), missing), self.shape)

    def column(self, name: str) -> NDArray[Any]:
        """A variable or a coordinate at the chosen cells, flags by their meanings."""
        source = self._source(name)
        return _decoded(self.spread(source), _words(source))

    def meeting(self, where: str) -> NDArray[np.bool_]:
        """Cells that meet a condition."""
        design = self.cube["outcome"].dims if "outcome" in self.cube.data_vars else ()
        dims = set(self.target.dims)
        known = [str(name) for name, other in self.cube.data_vars.items() if {*design}.intersection(other.dims) <= dims]
        words: dict[str, Collection[str]] = {name: list(_words(self._source(name)).values()) for name in known}
        words |= {name: _texts(labels) for name, labels in self.coordinates.items() if name in where}
        phases = [name for name in known if is_phase_name(name) or is_phase(self._source(name))]
        expression = Expression(where, [*self.coordinates, *known], words, phases, is_condition=True)
        used = [self._source(name).dims for name in expression.used]
        beside = math.prod({dim: self.cube.sizes[dim] for of in used for dim in of if dim not in dims}.values())
        if beside == 1 or math.prod(self.shape) * beside <= _SLAB_CELLS:
            return self._meeting(expression, design)
        meets = np.zeros(self.shape, bool)
        for slab in slabs(self.shape, box(self.shape, beside, _SLAB_CELLS)):
            meets[slab.place] = self._within(slab.place)._meeting(expression, design)
        return meets

    def _source(self, name: str) -> xr.Variable:
        return self.cube.variables[name]

    def _meeting(self, expression: Expression, design: Collection[Any]) -> NDArray[np.bool_]:
        meets = expression.truths(_Cells(self, design))
        if unknown := [dim for dim in meets.dims if dim not in self.target.dims]:
            labels = self._labels(unknown[0])
            first = labels.values.ravel()[0]
            raise InputError(
                f"{expression.text!r}: its values differ along {unknown[0]}, which {self.variable} does not have: "
                f"take one, as NAME[{level(first) if labels.dtype.kind in 'fiu' else repr(str(first))}], or the max, "
                f"min, mean or sum of all; {unknown[0]} {labels_text(labels)}"
            )
        data = meets.data
        for axis, dim in enumerate(meets.dims):
            if data.shape[axis] == self.cube.sizes[dim] and dim in self.rows and dim in meets.labels:
                data = np.take(data, self.rows[dim], axis)
            elif dim in meets.labels and data.shape[axis] != self.cube.sizes[dim]:
                raise InputError(f"{expression.text!r}: it has values at some {dim} only: take their max or min")
        return self._along(meets.dims, data)

    def _labels(self, dim: Any) -> xr.Variable:
        return self.cube[dim].variable  # positions where there are no labels


@dataclass(frozen=True)
class _Cells:
    """Values of names at the chosen cells; all values of the points for indexed or reduced names."""

    choice: _Choice
    rows: Collection[Any]  # the dimensions of the design

    @property
    def most(self) -> int:
        """Largest number of values per point, at least as many as the target has."""
        return max(MOST_VALUES, math.prod(self.choice.shape))

    def read(self, name: str, whole: bool) -> NamedArray:
        """Values of a name, flags by their meanings."""
        source, rows = self.choice._source(name), self.choice.rows
        own = {str(dim): rows[dim] for dim in source.dims if dim in rows and (dim in self.rows or not whole)}
        labels = {str(dim): self.choice._labels(dim).values for dim in source.dims if whole and dim not in self.rows}
        return NamedArray(tuple(map(str, source.dims)), _decoded(read_positions(source, own), _words(source)), labels)


def _not_kept(study: str, name: str) -> str:
    """What to do for an output that the simulator of a study has and the study does not keep; empty for others."""
    from tripod_doe.study.definition.simulators import load_simulator  # slow to import: every query would wait for them
    from tripod_doe.study.definition.study_file_schema import parse_file

    with suppress(InputError):
        table = parse_file(study, "the study in the cube").study
        if not table.function and name in load_simulator(table.scene).outputs:
            return "its study does not keep this output; name it in [keep] outputs and run the study again"
    return ""


def _choose(
    cube: xr.Dataset,
    variable: str,
    select: Mapping[str, Chosen] | Sequence[Selection | str],
    nearest: bool,
    beside: Sequence[str] = (),
) -> _Choice:
    names = list(dict.fromkeys((variable, *beside)))
    for name in names:
        if name not in cube.data_vars:
            failed = "outcome" in cube and bool((cube["outcome"] != Outcome.FINISHED).all())
            without = ", of which no point finished" if failed else ""
            known = left_out(cube).get(name) or _not_kept(str(cube.attrs.get("study", "")), name)
            why = f": {known}" if known else near_match(name, map(str, cube.data_vars))
            raise InputError(f"{option('variable', name)}: not in this cube{without}{why}")
    variable = max(names, key=lambda name: len(cube.variables[name].dims))
    dims = set(cube.variables[variable].dims)
    if other := next((name for name in names if not set(cube.variables[name].dims) <= dims), None):
        ends = " and ".join(
            f"{name} lies along {', '.join(map(str, cube.variables[name].dims))}" for name in (variable, other)
        )
        raise InputError(f"{option('variable', other)}: {ends}: query each by itself")
    if "outcome" in cube.data_vars and set(cube.variables["outcome"].dims) <= dims:
        names.append("outcome")
    shown = {name: cube.variables[name] for name in names}
    coordinates = {str(name): labels.variable for name, labels in cube.coords.items() if set(labels.dims) <= dims}
    rows: dict[Any, IntArray] = {}
    near: dict[Any, list[tuple[xr.Variable, float]]] = {}  # numbers of which one point is to have the nearest ones
    for selection in selections(select):
        if selection.name not in coordinates:
            known = near_match(selection.name, coordinates)
            raise InputError(f"{option('select', selection.name)}: not a coordinate here{known}")
        labels = coordinates[selection.name]
        if len(labels.dims) != 1:
            raise InputError(f"{option('select', selection.name)}: it has only one value, so it cannot be selected")
        dim = labels.dims[0]
        if nearest and (number := sole_number(labels, selection)) is not None:
            near.setdefault(dim, []).append((labels, number))
            continue
        rows[dim] = taken(labels, rows.get(dim), selection, nearest)
        refuse_unmatched(labels, selection, nearest)
    rows |= {dim: nearest_rows(asked, rows.get(dim)) for dim, asked in near.items()}
    return _Choice(cube, variable, shown, coordinates, rows)


def analyses_with(directory: Path, variable: str) -> list[Path]:
    """The files of analyses in a result directory that hold a variable, or the reason why it is missing."""
    files = []
    for file in analysis_files(directory).values():
        with suppress(CubeError), opened_cube(file) as cube:
            if variable in cube.data_vars or variable in left_out(cube):
                files.append(file)
    return files


def left_out(cube: xr.Dataset) -> dict[str, str]:
    """Why variables are not in an analysis, by their names: its attribute holds a line ``NAME: reason`` for each."""
    lines = [line.partition(": ") for line in str(cube.attrs.get("left_out", "")).splitlines()]
    return {name: reason for name, _, reason in lines}


def _texts(variable: xr.Variable) -> set[str]:
    """All texts among the values of a variable; none of numbers."""
    return set(map(str, variable.values.flat)) if variable.dtype.kind in "OU" else set()


def _words(variable: xr.Variable) -> dict[int, str]:
    """Meanings of a flag by its value, from its CF attributes; a flag of bits (flag_masks) is left as a number."""
    if not {"flag_values", "flag_meanings"} <= variable.attrs.keys():
        return {}
    values = np.atleast_1d(variable.attrs["flag_values"]).tolist()
    return dict(zip(map(int, values), str(variable.attrs["flag_meanings"]).split(), strict=False))


def _decoded(values: NDArray[Any], words: Mapping[int, str]) -> NDArray[Any]:
    """Meanings of flags; other values unchanged."""
    if not words:
        return values
    known, inverse = np.unique(values, return_inverse=True)
    meanings: NDArray[Any] = np.array([words.get(int(value), str(value)) for value in known.tolist()], dtype=object)
    return meanings[inverse].reshape(values.shape)


def narrowed(answer: xr.Dataset) -> xr.Dataset:
    """An answer as a cube: cells that a condition left out are NaN."""
    if "selected" not in answer:
        return answer
    variables = answer.drop_vars(["selected", "outcome"], errors="ignore").data_vars
    kept = {name: variable.where(answer["selected"]) for name, variable in variables.items()}
    return answer.drop_vars("selected").assign(kept)


def records_text(columns: Columns, form: str, decimal_comma: bool = False) -> str:
    """Records as text: ``table``, ``csv`` or ``json`` (a list of objects, NaN as null).

    Args:
        decimal_comma: Write CSV with commas in numbers and semicolons between them, as spreadsheets of some countries
            read it.
    """
    shown = without_rounding(columns) if form == "table" else columns
    rows = list(zip(*(column.tolist() for column in shown.values()), strict=True))
    if form == "json":
        return json.dumps([dict(zip(columns, map(plain_json, row), strict=True)) for row in rows])
    if form == "csv":
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n", delimiter=";" if decimal_comma else ",")
        writer.writerow(map(csv_cell, columns))
        writer.writerows([[_csv_word(value, decimal_comma) for value in row] for row in rows])
        return buffer.getvalue().rstrip("\n")
    lines = [[printable(name) for name in columns], *([_table_word(value) for value in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    aligned = [" ".join(word.rjust(width) for word, width in zip(line, widths, strict=True)) for line in lines]
    return "\n".join(aligned) if rows else "no cell matches"


def without_rounding(columns: Columns) -> Columns:
    """The columns as pages and tables show them: amplitudes below 1e-12 of the largest are 0."""
    shown = dict(columns)
    for name, column in columns.items():
        if name.endswith("amplitude") and column.dtype.kind == "f":
            size = np.abs(column)
            largest = np.max(size, initial=0.0, where=np.isfinite(size))
            shown[name] = np.where(size <= _NOTHING * largest, 0.0, column)
    return shown


def _csv_word(value: Any, decimal_comma: bool) -> object:
    if value != value:
        return ""
    return str(value).replace(".", ",") if decimal_comma and isinstance(value, float) else csv_cell(value)


_FORMATS = {".csv": "csv", ".json": "json", ".nc": "netcdf", ".xlsx": "xlsx", ".txt": "table"}
"""Formats of an answer by the ending of its file."""


def answer_format(asked: str | None, output: Path | None) -> str:
    """The format of an answer: as asked or as its file is named, else a table.

    Raises:
        InputError: If both contradict each other, or neither decides for a file.
    """
    if output is None:
        return asked or "table"
    named = _FORMATS.get(output.suffix.lower())
    where = option("output", str(output))
    if asked is None and named is None:
        raise InputError(f"{where}: end the name in {', '.join(_FORMATS)}, or give {option('format')}")
    if asked and named and asked != named:
        raise InputError(f"{where} is named as {named}, but {option('format')} is {asked}: change one of both")
    return asked or named or "table"


def _table_word(value: Any) -> str:
    if isinstance(value, float):
        return "NaN" if math.isnan(value) else f"{value:.6g}"
    return printable(str(value)).replace("\n", r"\n")
