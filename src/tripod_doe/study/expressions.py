"""Expressions over named columns, parsed and never evaluated as Python: constraints of designs, --where of queries."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError, near_match

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: np.logical_not,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {"abs": np.abs, "min": np.minimum, "max": np.maximum, "sqrt": np.sqrt}
_LONGEST = 4_000  # characters of a condition: the time to parse one may grow faster than its length
_WHOLE = 2**53  # from here on not every whole number is one of float64
_DEEPEST = 100  # operators within each other
_SHOWN = 80  # characters of a condition that a message repeats
_ALLOWED = "names, numbers, 'text', + - * / **, < <= > >= == !=, and or not, abs min max sqrt"


class Expression:
    """A condition over columns, for instance ``initial_skew_1_deg < initial_skew_2_deg and torque_n_m > 25``.

    Parameters
    ----------
    text
        The condition.
    names
        Names that it may use.

    Attributes
    ----------
    text
        The condition, or the beginning of a long one.
    used
        Names that it does use.

    Raises
    ------
    InputError
        If the text does not parse, uses an unknown name, or anything but arithmetic, comparison and logic.
    """

    def __init__(self, text: str, names: Collection[str]) -> None:
        self.text = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
        self.used: set[str] = set()
        self._whole = text
        if len(text) > _LONGEST:
            raise InputError(f"{self.text!r}: {len(text):,} characters; at most {_LONGEST:,} are allowed")
        try:
            self._tree = ast.parse(text, mode="eval").body
        except (SyntaxError, ValueError) as error:
            raise InputError(f"{self.text!r}: not an expression ({getattr(error, 'msg', error)})") from error
        except (RecursionError, MemoryError) as error:
            raise InputError(self._too_deep) from error
        self._check(self._tree, names, 1)

    @property
    def _too_deep(self) -> str:
        return f"{self.text!r}: more than {_DEEPEST} operators within each other"

    def _check(self, node: ast.expr, names: Collection[str], depth: int) -> None:
        if depth > _DEEPEST:
            raise InputError(self._too_deep)
        children: list[ast.expr] = []
        match node:
            case ast.Name(id=name):
                if name not in names:
                    raise InputError(f"{self.text!r}: unknown name {name[:_SHOWN]!r}{near_match(name, names)}")
                self.used.add(name)
            case ast.Constant(value=int() as value) if not _is_exact(value):
                raise InputError(f"{self.text!r}: a whole number beyond {_WHOLE:,} that float64 does not hold")
            case ast.Constant(value=int() | float() | str()):
                pass
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                children = [left, right]
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                children = [operand]
            case ast.BoolOp(values=values):
                children = values
            case ast.Compare(left=left, ops=ops, comparators=others) if all(type(op) in _COMPARE for op in ops):
                children = [left, *others]
            case ast.Call(func=ast.Name(id=function), args=arguments, keywords=[]) if function in _FUNCTIONS:
                if len(arguments) != (1 if function in ("abs", "sqrt") else 2):
                    raise InputError(f"{self.text!r}: wrong number of arguments for {function}")
                children = arguments
            case _:
                wrong = (ast.get_source_segment(self._whole, node) or "")[:_SHOWN]
                raise InputError(f"{self.text!r}: {wrong!r} is not allowed here; use {_ALLOWED}")
        for child in children:
            self._check(child, names, depth + 1)

    def __call__(self, columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
        """Evaluate for every row of the columns, numbers in float64; NaN, and a comparison with it, is false.

        A division by zero or an overflow gives an infinity or NaN, as float64 does.

        Raises
        ------
        InputError
            If values cannot be compared, for instance a number with a text, or whole numbers are too large for float64.
        """
        try:
            values = {name: self._checked(name, columns[name]) for name in self.used}
            with np.errstate(all="ignore"):
                meets = _truth(self._value(self._tree, values))
        except (TypeError, OverflowError, ValueError) as error:
            raise InputError(f"{self.text!r}: {error}") from error
        return np.broadcast_to(meets, np.shape(next(iter(columns.values()))))

    def _refuse_mixed(self, terms: Sequence[Any]) -> None:
        """Refuse a comparison of a number with a text, which would be false in silence."""
        if any(np.asarray(term).dtype.kind in "fb" for term in terms) and any(map(_is_text, terms)):
            raise InputError(f"{self.text!r}: compares a number with a text; write texts in quotes, numbers without")

    def _checked(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        """A column, whole numbers in float64."""
        if column.dtype.kind not in "iu":
            return column
        if column.size and not -_WHOLE <= int(column.min()) <= int(column.max()) <= _WHOLE:
            raise InputError(f"{self.text!r}: {name} has whole numbers beyond {_WHOLE:,} that float64 may not hold")
        return column.astype(np.float64)

    def _value(self, node: ast.expr, columns: Mapping[str, NDArray[Any]]) -> Any:
        match node:
            case ast.Name(id=name):
                return columns[name]
            case ast.Constant(value=str() as value):
                return value
            case ast.Constant(value=(int() | float()) as value):
                return np.float64(value)  # Python's whole numbers grow without bounds: 9**9**9
            case ast.BinOp(left=left, op=op, right=right):
                return _BINARY[type(op)](_number(self._value(left, columns)), _number(self._value(right, columns)))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return np.logical_not(_truth(self._value(operand, columns)))
            case ast.UnaryOp(op=op, operand=operand):
                return _UNARY[type(op)](_number(self._value(operand, columns)))
            case ast.BoolOp(op=op, values=values):
                combine = np.logical_and if isinstance(op, ast.And) else np.logical_or
                return combine.reduce(np.broadcast_arrays(*(_truth(self._value(value, columns)) for value in values)))
            case ast.Compare(left=left, ops=ops, comparators=others):
                terms = [self._value(term, columns) for term in (left, *others)]
                self._refuse_mixed(terms)
                links = [_COMPARE[type(op)](terms[i], terms[i + 1]) for i, op in enumerate(ops)]
                return np.logical_and.reduce(np.broadcast_arrays(*links))
            case ast.Call(func=ast.Name(id=function), args=arguments):
                return _FUNCTIONS[function](*(_number(self._value(argument, columns)) for argument in arguments))
        raise AssertionError(node)


def _truth(value: Any) -> NDArray[np.bool_]:
    """Whether a value counts as true; NaN does not."""
    array = np.asarray(value)
    return (array != 0) & ~np.isnan(array) if array.dtype.kind == "f" else array.astype(bool)


def _is_text(value: Any) -> bool:
    """Whether a value is text, or a column of nothing else."""
    array = np.asarray(value)
    return array.dtype.kind == "U" or (array.dtype == object and all(isinstance(each, str) for each in array.flat))


def _is_exact(value: int) -> bool:
    """Whether float64 holds a whole number."""
    try:
        return int(float(value)) == value
    except OverflowError:
        return False


def _number(value: Any) -> Any:
    """Results of comparisons as numbers 0 and 1 in float64; other values unchanged."""
    return np.asarray(value, np.float64) if np.asarray(value).dtype == np.bool_ else value
