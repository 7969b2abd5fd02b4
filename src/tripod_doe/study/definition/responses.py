"""[responses.NAME]: variables of a cube by formula, checked before the run by evaluation at a point of NaN."""

import keyword
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.model_interface import WORK, Simulator, Value
from tripod_doe.names import check_identifier
from tripod_doe.phases import is_phase_name, shorter_way
from tripod_doe.study.definition.study_file_schema import ResponseTable
from tripod_doe.study.expressions import MOST_VALUES, Expression
from tripod_doe.study.named_arrays import NamedArray

ERROR = "_error"
"""End of the name of a variable with the numerical error of another one."""

POINT = "point"
"""Dimension of the points among which a formula is evaluated."""

_MOST_RESPONSES = 200
_MOST_WORK = 2e7  # operations of a formula for a point, which take some 20 ms

_ROUNDING = 1e-9  # of the largest value of an output at a point: what is smaller is rounding
_TAKEN = ("_used", "_error_estimate", ERROR)  # ends of names that cubes give
_FUNCTIONS = frozenset(("abs", "min", "max", "mean", "sum", "sqrt", "log10"))
_LABELS = frozenset(("point", "sample", "varied", "row", "excluded", "selected"))
_RECORDS = frozenset(
    (
        *(
            "outcome",
            "outcome_detail",
            "attempt",
            "first_outcome",
            "first_outcome_detail",
            "accuracy_met",
            "from_pilot",
        ),
        *("model_error", "model_error_limit", "worker", "cpu_seconds", "wall_seconds", *WORK),
    )
)


@dataclass(frozen=True)
class Response:
    """A variable of the cube that follows from outputs of the same point."""

    name: str  # its name in the cube
    expression: Expression  # its formula
    formula: str  # the formula as written
    unit: str  # UDUNITS spelling; ``"1"`` without dimension
    meaning: str  # CF long_name
    outputs: tuple[str, ...]  # outputs of the simulator that the formula uses
    responses: tuple[str, ...]  # responses before it that the formula uses
    size: int = 1  # number of values for a point, if the simulator declares its outputs
    widest: int = 1  # values for a point in the largest intermediate array, if outputs are declared


@dataclass(frozen=True)
class Arrays:
    """Values of the names in formulas, along the points and the dimensions of outputs."""

    arrays: Mapping[str, NamedArray]
    rows: tuple[str, ...] = (POINT,)
    most: int = MOST_VALUES

    def read(self, name: str, whole: bool) -> NamedArray:
        """The values of a name."""
        return self.arrays[name]


class _AnyName(tuple[str, ...]):
    """Names of a function's outputs, which are known from its first answer."""

    def __contains__(self, name: object) -> bool:
        return True


class _Phases(tuple[str, ...]):
    """Names of phases: those of formulas, and all that are named so."""

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or is_phase_name(str(name))


def numeric_parameters(simulator: Simulator) -> list[str]:
    """Names of the parameters that a formula may use: all but choices."""
    return [name for name, parameter in simulator.parameters.items() if parameter.kind != "choice"]


def check_responses(
    simulator: Simulator, tables: Mapping[str, ResponseTable], values: Mapping[str, Value]
) -> tuple[Response, ...]:
    """The responses of a study.

    Args:
        tables: Their tables, in the order of the file: a formula may use the responses before it.

    Raises:
        InputError: If a name is taken or a formula is wrong, with the key and the place in the formula.
    """
    if len(tables) > _MOST_RESPONSES:
        raise InputError(f"[responses]: {len(tables):,} formulas; at most {_MOST_RESPONSES} are allowed")
    responses: list[Response] = []
    arrays = dict(_point_of_nan(simulator, values))
    for name, table in tables.items():
        place = f"[responses.{name}]"
        try:
            _check_name(name, simulator)
            if not table.unit.isprintable() or not table.meaning.isprintable():
                raise InputError("unit and meaning are one line of text each")
        except InputError as error:
            raise error.at(place) from error
        try:
            response, arrays[name] = _response(name, table, simulator, responses, arrays)
            if simulator.outputs and _with_errors((*response.outputs, *response.responses), arrays):
                arrays[f"{name}{ERROR}"] = arrays[name]
        except InputError as error:
            later = [other for other in list(tables)[len(responses) + 1 :] if f"unknown name {other!r}" in str(error)]
            remedy = f"; [responses.{later[0]}] comes after it: put it before" if later else ""
            raise InputError(f"{place}: formula = {error}{remedy}") from error
        responses.append(response)
    return tuple(responses)


def _response(
    name: str, table: ResponseTable, simulator: Simulator, before: list[Response], arrays: Mapping[str, NamedArray]
) -> tuple[Response, NamedArray]:
    """A response, and its value at the point of NaN."""
    earlier, parameters = [other.name for other in before], numeric_parameters(simulator)
    known = [*simulator.outputs, *earlier, *parameters] if simulator.outputs else _AnyName((*earlier, *parameters))
    expression = Expression(table.formula, known, phases=_Phases(one.name for one in before if one.expression.is_phase))
    own = sorted(expression.used.difference(earlier, parameters))
    if not expression.used:
        names = f"name one, for instance {_examples(simulator)}"
        raise InputError(f"{expression.text!r}: uses no output and no parameter; {names}")
    size, value = 1, NamedArray((POINT,), np.full(1, np.nan))
    if simulator.outputs:
        value = expression.numbers(Arrays(arrays))
        size = value.data.size
        _refuse_long_work(expression, _with_errors((*own, *_among(earlier, expression)), arrays))
    response = Response(
        name,
        expression,
        table.formula,
        "degree" if (expression.is_phase or is_phase_name(name)) and table.unit in ("", "1") else table.unit or "1",
        table.meaning or table.formula,
        tuple(own),
        tuple(_among(earlier, expression)),
        size,
        expression.widest,
    )
    return response, value


def _among(earlier: list[str], expression: Expression) -> list[str]:
    """The responses that a formula uses."""
    return sorted(expression.used.intersection(earlier))


def _with_errors(inputs: Collection[str], arrays: Mapping[str, NamedArray]) -> int:
    """Number of values with numerical errors among some inputs; 0 if an input has none: then there is no error."""
    known = all(f"{name}{ERROR}" in arrays for name in inputs)
    return sum(arrays[name].data.size for name in inputs) if known else 0


def _refuse_long_work(expression: Expression, with_errors: int) -> None:
    """Refuse a formula that takes longer than most points; each value with an error needs two evaluations."""
    work = expression.operations * expression.widest * (1 + 2 * with_errors)
    if work > _MOST_WORK:
        again = f", {1 + 2 * with_errors:,} times for the errors of its values" if with_errors else ""
        raise InputError(
            f"{expression.text!r}: {expression.operations:,} names, numbers and operators with up to "
            f"{expression.widest:,} values for each point{again}: {work:,} operations; at most {_MOST_WORK:,.0f} are "
            "allowed: index or reduce before you combine"
        )


def _examples(simulator: Simulator) -> str:
    return ", ".join(list(simulator.outputs)[:3]) or "a key of the dict that the function returns"


def _check_name(name: str, simulator: Simulator) -> None:
    check_identifier(name, "a response, written [responses.NAME]")
    if not name.isidentifier() or keyword.iskeyword(name):
        raise InputError("not a name for a response: use letters, digits and _, and begin with no digit")
    dims = {dimension.name for output in simulator.outputs.values() for dimension in output.dimensions}
    if name in simulator.outputs or name in simulator.parameters or name in dims:
        raise InputError("this name is taken by an output, a dimension or a parameter; choose another")
    if name in _LABELS | _RECORDS | _FUNCTIONS or name.endswith(_TAKEN):
        ends = ", ".join(_TAKEN)
        raise InputError(f"this name is reserved for a variable of every cube or a function, or ends as one ({ends})")


def _point_of_nan(simulator: Simulator, values: Mapping[str, Value]) -> Iterator[tuple[str, NamedArray]]:
    """All outputs of a point with these values, NaN each, and its parameters."""
    full = simulator.effective(values)
    for name, output in simulator.outputs.items():
        labels = {dimension.name: dimension.labels_of(full) for dimension in output.dimensions}
        yield name, NamedArray((POINT, *output.dims), np.full((1, *output.shape(full)), np.nan), labels)
    for name in numeric_parameters(simulator):
        yield name, NamedArray((POINT,), np.full(1, np.nan))


def stored_outputs(simulator: Simulator, keep: tuple[str, ...], responses: tuple[Response, ...]) -> tuple[str, ...]:
    """Names of the outputs that runs give: those to keep, and those that formulas use, with their errors.

    Empty for a function that keeps all.
    """
    if not keep:
        return ()
    used = [name for response in responses for name in response.outputs]
    errors = [f"{name}{ERROR}" for name in used if f"{name}{ERROR}" in simulator.outputs]
    return tuple(dict.fromkeys([*keep, *used, *errors]))


def evaluated(
    responses: tuple[Response, ...], arrays: Mapping[str, NamedArray], errors: Mapping[str, NDArray[Any]]
) -> Iterator[tuple[Response, NamedArray, NDArray[Any] | None]]:
    """All responses of some points, each with its numerical error.

    Args:
        arrays: Outputs and parameters of the points by name, the points along `POINT`.
        errors: Numerical errors of outputs, in their unit, of the shape of the output each; an output without one is
            missing.

    Yields:
        response, value, error: The error is the sum of the changes by the error of each used value, shape as the value;
            None if one of these errors is unknown. NaN if an output has no value.
    """
    known, wrong = dict(arrays), dict(errors)
    for response in responses:
        inputs = {*response.outputs, *response.responses}
        try:
            value = _with_points(response.expression.numbers(Arrays(known)), known)
            error = None
            if inputs <= wrong.keys():
                error = _error(response, value, known, {name: wrong[name] for name in sorted(inputs)})
        except InputError as refused:
            raise InputError(f"[responses.{response.name}]: formula = {refused}") from refused
        known[response.name] = value
        if error is not None:
            wrong[response.name] = error
        yield response, value, error


def divides_by_rounding(response: Response, arrays: Mapping[str, NamedArray]) -> NDArray[np.bool_]:
    """Points at which a formula divides by rounding, compared with the largest value of an output, shape (point,).

    Args:
        arrays: See `evaluated`.
    """
    found = np.zeros(next(iter(arrays.values())).data.shape[0], bool)
    divisors = response.expression.divisors(Arrays(arrays))
    if not divisors:
        return found
    largest = {name: arrays[name] for name in response.expression.used}
    for name, array in largest.items():
        largest[name] = replace(array, data=np.broadcast_to(_largest(array.data), array.data.shape))
    for one, most in zip(divisors, response.expression.divisors(Arrays(largest)), strict=True):
        if POINT in one.dims:
            size = np.moveaxis(np.abs(one.data), one.dims.index(POINT), 0)
            limit = _ROUNDING * np.moveaxis(np.abs(most.data), most.dims.index(POINT), 0)
            found |= ((size > 0) & (size < limit)).reshape(found.size, -1).all(axis=1)
    return found


def _largest(data: NDArray[Any]) -> NDArray[Any]:
    """The largest magnitude at each point, NaN where there is none; its other dimensions have the length 1."""
    known = np.abs(np.where(np.isfinite(data), data, 0.0))
    return known.max(axis=tuple(range(1, data.ndim)), keepdims=True, initial=0.0)


def _with_points(value: NamedArray, known: Mapping[str, NamedArray]) -> NamedArray:
    """A value with the points as first dimension, also if the formula does not depend on them."""
    if POINT not in value.dims:
        count = next(array.data.shape[0] for array in known.values())
        return NamedArray((POINT, *value.dims), np.repeat(value.data[None], count, axis=0), value.labels)
    axis = value.dims.index(POINT)
    return NamedArray((POINT, *value.without((POINT,))), np.moveaxis(value.data, axis, 0), value.labels)


def _error(
    response: Response, value: NamedArray, known: Mapping[str, NamedArray], errors: Mapping[str, NDArray[Any]]
) -> NDArray[Any]:
    """Change of a formula by the errors of all its values, summed, shape as the value."""
    total = np.zeros(value.data.shape)
    for name, error in errors.items():
        array = known[name]
        for place in np.ndindex(*array.data.shape[1:]):
            at = (slice(None), *place)
            if not np.any(error[at]):
                continue
            changes = []
            for sign in (-1, 1):
                data = array.data.copy()
                data[at] += sign * error[at]
                moved = NamedArray(array.dims, data, array.labels)
                other = _with_points(response.expression.numbers(Arrays({**known, name: moved})), known)
                change = other.data - value.data
                changes.append(np.abs(shorter_way(change) if response.expression.is_phase else change))
            total += np.maximum(*changes)
    return total
