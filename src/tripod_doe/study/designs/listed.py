"""Designs of listed levels: grids, lists of points, one factor at a time, and tables."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from tripod_doe.errors import InputError, closest, near_match
from tripod_doe.simulator import Parameter, Value
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import DesignTable
from tripod_doe.study.designs.columns import Column, CrossedColumns, HeldColumns
from tripod_doe.study.designs.request import Family, Made, Request, axis_levels, column_of, held, levels_of


def _grid(request: Request) -> Made:
    """All combinations of the levels."""
    return Made(crossed(grid_levels(request.factors)))


def crossed(levels: Mapping[str, Column]) -> CrossedColumns:
    """All combinations of the levels of some factors, the last changing fastest."""
    return CrossedColumns([HeldColumns({name: column}) for name, column in levels.items()], tuple(levels))


def grid_levels(factors: Mapping[str, Factor]) -> dict[str, Column]:
    """The levels of a grid along each of its dimensions.

    Raises
    ------
    InputError
        If a factor has the same level twice.
    """
    levels = {name: axis_levels(factor) for name, factor in factors.items()}
    for name, values in levels.items():
        if len(set(values.tolist())) < len(values):
            raise InputError(f"[factors.{name}]: the same value occurs twice; a grid needs different values")
    return levels


def _zip(request: Request) -> Made:
    """The first levels of all factors together, then the second ones, and so on."""
    columns = {name: levels_of(factor) for name, factor in request.factors.items()}
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        raise InputError(f"zip needs as many values for every factor, but {told}")
    return held(columns)


def _one_at_a_time(request: Request) -> Made:
    """The base point, then each factor through its values with all others at their defaults."""
    study, factors = request.study, request.factors
    home = {name: study.simulator.effective(study.base)[name] for name in factors}
    rows, varied = [home], ["base"]
    for name, factor in factors.items():
        if home[name] is None:
            raise InputError(f"[factors.{name}]: it has no default value; one-at-a-time cannot vary it")
        for value in levels_of(factor):
            rows.append({**home, name: value})
            varied.append(name)
    columns = {name: column_of(factor, (row[name] for row in rows)) for name, factor in factors.items()}
    return held(columns, {"varied": np.array(varied, dtype=object)})


def _rows(study: Study, design: DesignTable) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the CSV file of a table design."""
    if design.table is None:
        raise InputError("a table design needs table = a CSV file")
    path = study.folder.file(design.table, "table")
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            header, *rows = [row for row in csv.reader(stream, strict=True) if row] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"table = {design.table!r}: cannot read {path}: {reason}") from error
    return [name.strip() for name in header], rows


def _table(request: Request) -> Made:
    """A CSV file with a header: one column a factor; fields of a parameter without default may be empty."""
    study, design = request.study, request.table
    header, rows = _rows(study, design)
    (name, count), *_ = Counter(header).most_common(1) or [("", 0)]
    if count > 1:
        raise InputError(f"table = {design.table!r}: column {name!r} stands there {count} times; keep one of them")
    for name in request.factors:
        if name not in header:
            raise InputError(f"table = {design.table!r}: no column {name!r}{closest(name, header)}")
    if not rows:
        raise InputError(f"table = {design.table!r}: it has no rows")
    for name in header:
        if name not in study.simulator.parameters:
            raise InputError(
                f"table = {design.table!r}: column {name!r} is not a parameter"
                f"{near_match(name, study.simulator.parameters)}"
            )
        if name in study.base:
            raise InputError(f"table = {design.table!r}: {name} is also a base value; remove it from [base]")
    columns = {}
    for index, name in enumerate(header):
        parameter = study.simulator.parameters[name]
        values = []
        for line, row in enumerate(rows, start=2):
            if len(row) != len(header):
                raise InputError(
                    f"table = {design.table!r}: line {line} has {len(row)} fields, the header {len(header)}"
                )
            try:
                values.append(_cell(parameter, row[index].strip()))
            except (InputError, ValueError) as error:
                raise InputError(f"table = {design.table!r}: line {line}: {name}: {error}") from error
        columns[name] = parameter.column(values)
    return held(columns)


def _cell(parameter: Parameter, text: str) -> Value:
    """One field of a CSV file as its parameter takes it; an empty one leaves open what follows from others."""
    if not text and parameter.default is None and parameter.kind != "argument":
        return None if parameter.kind == "choice" else math.nan
    if parameter.kind == "choice":
        return parameter.check(text)
    try:
        number = float(text)
    except ValueError:
        if parameter.kind == "argument":
            return parameter.check(text)
        raise
    return parameter.check(number)


def _lengths(request: Request) -> list[int]:
    return [len(factor.values or ()) for factor in request.factors.values()]


LISTED: dict[str, Family] = {
    "grid": Family(_grid, lambda request: math.prod(_lengths(request)), value_bytes=lambda table: 0),
    "zip": Family(_zip, lambda request: max(_lengths(request), default=0)),
    "one-at-a-time": Family(_one_at_a_time, lambda request: 1 + sum(_lengths(request))),
    "table": Family(_table, lambda request: 0),
}
"""Designs of listed levels by kind."""
