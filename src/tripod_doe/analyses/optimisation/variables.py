"""Variables with ranges or values, on the unit interval for a search, and the parameters that follow them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.optimisation.optimisation_file import OptimisationRequest, VariableTable
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Parameter, Simulator, Value
from tripod_doe.study.definition.responses import POINT, Arrays
from tripod_doe.study.expressions import Expression
from tripod_doe.study.named_arrays import NamedArray

_MOST_LEVELS = 1_000_000


@dataclass(frozen=True)
class Variable:
    """A parameter that a search chooses, as a number of the unit interval."""

    parameter: Parameter
    low: float = 0.0
    high: float = 1.0
    logarithmic: bool = False
    levels: tuple[Value, ...] = ()  # the values it may take; none for a range of numbers

    @property
    def name(self) -> str:
        """Its name."""
        return self.parameter.name

    def snapped(self, unit: FloatArray) -> FloatArray:
        """The middles of the intervals of levels; numbers of a range unchanged."""
        if not self.levels:
            return unit
        count = len(self.levels)
        return np.asarray((np.minimum(np.floor(unit * count), count - 1) + 0.5) / count)

    def values(self, unit: FloatArray) -> NDArray[Any]:
        """Values at numbers of the unit interval, shape (candidate,)."""
        if self.levels:
            at = np.minimum(np.floor(unit * len(self.levels)), len(self.levels) - 1).astype(int)
            return self.parameter.column([self.levels[k] for k in at.tolist()])
        if self.logarithmic:
            return np.clip(self.low * (self.high / self.low) ** unit, self.low, self.high)
        return np.clip(self.low + unit * (self.high - self.low), self.low, self.high)

    def unit(self, value: Value) -> float:
        """The number of the unit interval that stands for a value, or for the nearest one that is allowed."""
        if self.levels:
            numbers = all(isinstance(level, int | float) for level in self.levels)
            if numbers and isinstance(value, int | float):
                at = int(np.argmin([abs(float(level) - float(value)) for level in self.levels]))  # type: ignore[arg-type]
            else:
                at = self.levels.index(value) if value in self.levels else 0
            return (at + 0.5) / len(self.levels)
        number = min(max(float(value or 0), self.low), self.high)
        if self.logarithmic:
            return math.log(number / self.low) / math.log(self.high / self.low)
        return (number - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Follower:
    """A parameter that follows others by a formula."""

    parameter: Parameter
    expression: Expression


@dataclass(frozen=True)
class Variables:
    """All that a candidate sets."""

    chosen: tuple[Variable, ...]  # what a search chooses
    followers: tuple[Follower, ...]  # what follows, in file order
    base: Mapping[str, Value]  # values that formulas may use

    @property
    def names(self) -> list[str]:
        """All parameters that a candidate sets."""
        return [each.name for each in self.chosen] + [each.parameter.name for each in self.followers]

    def snapped(self, units: FloatArray) -> FloatArray:
        """Candidates on the unit cube, shape (candidate, variable), each variable on the middle of its level."""
        return np.stack([each.snapped(units[:, at]) for at, each in enumerate(self.chosen)], axis=1)

    def columns(self, units: FloatArray) -> dict[str, NDArray[Any]]:
        """Values of all parameters that candidates set, shape (candidate,) each; `misfits` says which cannot be."""
        columns = {each.name: each.values(units[:, at]) for at, each in enumerate(self.chosen)}
        arrays = {
            name: NamedArray((), np.array(value, float)) for name, value in self.base.items() if _is_number(value)
        }
        for each in self.followers:
            arrays |= {
                name: NamedArray((POINT,), column.astype(float))
                for name, column in columns.items()
                if column.dtype.kind in "fi"
            }
            value = each.expression.numbers(Arrays(arrays))
            columns[each.parameter.name] = np.array(np.broadcast_to(value.data, len(units)))
        return columns

    def misfits(self, units: FloatArray) -> list[str]:
        """Why candidates cannot be: a value that follows and is not allowed for its parameter; empty where they can."""
        reasons = [""] * len(units)
        if not self.followers or not len(units):
            return reasons
        columns = self.columns(units)
        for each in self.followers:
            for row, value in enumerate(columns[each.parameter.name].tolist()):
                try:
                    each.parameter.check(value)
                except InputError as error:
                    reasons[row] = reasons[row] or str(error)
        return reasons


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _has_numbers(table: VariableTable) -> bool:
    """Whether a variable takes numbers, of a range or listed, which do not follow from others."""
    return table.low is not None or (table.values is not None and all(map(_is_number, table.values)))


def make_variables(
    request: OptimisationRequest, simulator: Simulator, base: Mapping[str, Value], varied: Mapping[str, str]
) -> Variables:
    """The variables of a file.

    Args:
        varied: Parameters that differ between the points of a candidate, with the table that varies each.

    Raises:
        InputError: If a parameter is unknown, or a bound, value or formula wrong.
    """
    chosen: list[Variable] = []
    followers: list[Follower] = []
    full = simulator.effective(base) if not request.file.optimisation.function else dict(base)
    for name, table in request.file.variables.items():
        where = f"[variables.{name}]"
        if name not in simulator.parameters:
            raise request.fail(where, f"unknown parameter{near_match(name, simulator.parameters)}")
        parameter = simulator.parameters[name]
        if parameter.group == "numerics":
            raise request.fail(where, f"{name} is no property of a joint, but of its computation; set it in [base]")
        try:
            if table.formula is None:
                chosen.append(_variable(parameter, table))
            else:
                others = [other for other in request.file.variables if other != name]
                earlier = [other for other in others if _has_numbers(request.file.variables[other])]
                earlier += [each.parameter.name for each in followers]
                known = {
                    *earlier,
                    *(other for other, value in full.items() if _is_number(value) and other not in others),
                    *varied,
                } - {name}
                expression = Expression(table.formula, sorted(known))
                _refuse_varied(expression, simulator, base, varied, earlier)
                followers.append(Follower(parameter, expression))
        except InputError as error:
            raise request.fail(where, error) from error
    fixed = {name: value for name, value in full.items() if name not in request.file.variables}
    return Variables(tuple(chosen), tuple(followers), fixed)


def _refuse_varied(
    expression: Expression,
    simulator: Simulator,
    base: Mapping[str, Value],
    varied: Mapping[str, str],
    chosen: list[str],
) -> None:
    """Refuse a formula of what differs between the points of a candidate, or takes the value of what varies."""
    sources = {**dict.fromkeys(chosen, "[variables]"), **varied}
    for name in sorted(expression.used):
        if name in varied:
            raise InputError(f"formula: {varied[name]} varies {name}, which has no single value for a candidate")
        source = simulator.parameters[name].follows
        if source in sources and name not in {*chosen, *base}:
            raise InputError(f"formula: {name} follows {source}, which {sources[source]} varies; set {name} in [base]")


def _variable(parameter: Parameter, table: VariableTable) -> Variable:
    if table.values is not None:
        levels = list(dict.fromkeys(parameter.check(value) for value in table.values))
        if len(levels) < 2:
            raise InputError("values: at least two different ones are needed")
        if all(map(_is_number, levels)):  # neighbours in size are next to each other
            levels.sort(key=lambda level: float(level or 0))
        return Variable(parameter, levels=tuple(levels))
    low, high = float(table.low or 0), float(table.high or 0)
    if parameter.kind == "choice":
        raise InputError(f"give values = [...] from {', '.join(parameter.choices)}")
    if parameter.kind in ("integer", "switch"):
        first, last = math.ceil(low), math.floor(high)
        if last <= first or last - first >= _MOST_LEVELS:
            raise InputError(f"low = {low:g}, high = {high:g}: at least two whole numbers are needed between them")
        parameter.check(first), parameter.check(last)
        return Variable(parameter, levels=tuple(range(first, last + 1)))
    parameter.check(low), parameter.check(high)
    return Variable(parameter, low, high, table.scale == "log")
