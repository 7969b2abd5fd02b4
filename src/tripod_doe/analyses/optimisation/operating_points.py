"""The operating points at which each candidate is judged: a grid or a table, with weights."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from tripod_doe.analyses.optimisation.optimisation_file import AtTable, OptimisationRequest
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.files.csv_table import read_csv_table
from tripod_doe.model_interface import Parameter, Value
from tripod_doe.study.definition.complaints import complaints
from tripod_doe.typed_numbers import number_or_text

_KEYS = ("table", "weights")
_MOST = 10_000


@dataclass(frozen=True)
class OperatingPoints:
    """Operating points with their weights."""

    values: tuple[Mapping[str, Value], ...]  # one mapping an operating point; a single empty one without any
    weights: FloatArray  # they add up to one, shape (operating point,)

    @property
    def names(self) -> list[str]:
        """The operating parameters."""
        return list(self.values[0])

    @property
    def count(self) -> int:
        """Number of operating points."""
        return len(self.values)


def operating_points(request: OptimisationRequest, parameters: Mapping[str, Parameter]) -> OperatingPoints:
    """The operating points of a file; InputError if a parameter, a value, a weight or the table is wrong."""
    at = request.file.at
    weights: Any = at.get("weights")
    try:
        if "table" in at and not isinstance(at["table"], dict):
            rows, weights = _rows(request, str(at["table"]), weights)
        else:
            rows = _grid(request, {name: table for name, table in at.items() if name not in _KEYS})
        values = tuple(_checked(row, parameters) for row in rows)
    except InputError as error:
        raise request.fail("[at]", error) from error
    for table in ("base", "variables", "scatter"):
        if both := sorted(set(values[0]) & getattr(request.file, table).keys()):
            raise request.fail("[at]", f"{both[0]} is in [{table}], too: leave one of them out")
    try:
        return OperatingPoints(values, _weights(weights, len(values)))
    except InputError as error:
        raise request.fail("[at]", error) from error


def _grid(request: OptimisationRequest, tables: Mapping[str, Any]) -> list[dict[str, Value]]:
    lists: dict[str, list[Any]] = {}
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise InputError(f"{name} = {table!r}: write a table of it, [at.{name}] values = [...]")
        try:
            lists[name] = list(AtTable.model_validate(table).values)
        except ValidationError as error:
            lines = complaints(error, AtTable)
            raise InputError("\n".join(f"{name}: {line.removeprefix('the file: ')}" for line in lines)) from error
    if (count := math.prod(map(len, lists.values()))) > _MOST:
        raise InputError(f"{count:,} operating points; at most {_MOST:,} are allowed")
    return [dict(zip(lists, row, strict=True)) for row in itertools.product(*lists.values())]


def _rows(request: OptimisationRequest, table: str, weights: Any) -> tuple[list[dict[str, Value]], Any]:
    """The rows of a CSV file, and the weights that a column of it holds."""
    header, lines = read_csv_table(request.folder.file(table, "table"), f"table = {table!r}", _MOST)
    rows: list[dict[str, Value]] = [
        {name: number_or_text(text) for name, text in zip(header, line, strict=True)} for line in lines.values()
    ]
    if isinstance(weights, str):
        if weights not in rows[0]:
            raise InputError(f"weights = {weights!r}: no such column{near_match(weights, rows[0])}")
        return rows, [row.pop(weights) for row in rows]
    return rows, weights


def _checked(row: Mapping[str, Any], parameters: Mapping[str, Parameter]) -> dict[str, Value]:
    for name in row:
        if name not in parameters:
            raise InputError(f"{name}: unknown parameter{near_match(name, parameters)}")
    return {name: parameters[name].check(value) for name, value in row.items()}


def _weights(given: Any, count: int) -> FloatArray:
    if given is None:
        return np.full(count, 1 / count)
    if not isinstance(given, list) or not all(type(each) in (int, float) for each in given):
        raise InputError("weights: a list of numbers, or the name of a column of the table")
    weights = np.array(given, float)
    total = sum(weights.tolist())
    if len(weights) != count or (weights < 0).any() or not 0 < total < math.inf:  # nor any that is not finite
        raise InputError(
            f"weights = {given}: one for each of the {count} operating points, none negative, not all zero"
        )
    return np.asarray(weights / total)
