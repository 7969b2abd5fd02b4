"""The language of conditions and formulas: constraints of designs, --where of queries, formulas of responses.

Texts are parsed, never evaluated as Python. Names stand for arrays with named dimensions, which are indexed by their
labels, as in ``thrust_amplitude[3]`` and ``thrust[90:180]``, and reduced by max, min, mean and sum.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Collection, Container, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError, near_match
from tripod_doe.phases import JUMPS, shorter_way
from tripod_doe.study.named_arrays import NamedArray, Pick, aligned

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
    ast.NotEq: lambda first, second: np.asarray(first != second) & ~_is_nan(first) & ~_is_nan(second),
}
_ONE: dict[str, Callable[[Any], Any]] = {"abs": np.abs, "sqrt": np.sqrt, "log10": np.log10}
_SEVERAL: dict[str, Callable[[Any, Any], Any]] = {"min": np.minimum, "max": np.maximum}
_REDUCE: dict[str, Callable[..., Any]] = {"min": np.min, "max": np.max, "mean": np.mean, "sum": np.sum}
FUNCTIONS = frozenset(_ONE | _SEVERAL | _REDUCE)
"""Functions that a formula may call."""

_LONGEST = 4_000  # characters of a condition: the time to parse one may grow faster than its length
_WHOLE = 2**53  # from here on not every whole number is one of float64
_DEEPEST = 100  # operators within each other
_ASSIGNMENT = re.compile(r"(?<![=<>!])=(?!=)")
_SHOWN = 80  # characters of a condition that a message repeats
_ALLOWED = (
    "names, numbers, 'text', + - * / **, < <= > >= == !=, and or not, abs min max mean sum sqrt log10, and labels in "
    "brackets, as [3] or [90:180]"
)

MOST_VALUES = 50_000
"""Largest number of intermediate values of a point: it limits formulas that broadcast waveforms over all dimensions."""


class Source(Protocol):
    """Source of the values of names."""

    @property
    def rows(self) -> Collection[str]:
        """Dimensions of the points, which are neither indexed nor reduced."""
        ...

    @property
    def most(self) -> int:
        """Largest number of values that names may be combined to for each point."""
        ...

    def read(self, name: str, whole: bool) -> NamedArray:
        """Values of a name; `whole` if they are indexed or reduced, so that all labels are needed."""
        ...


@dataclass(frozen=True)
class Columns:
    """Plain arrays of one shape as values of names."""

    columns: Mapping[str, NDArray[Any]]
    most: int = MOST_VALUES

    @property
    def rows(self) -> tuple[str, ...]:
        """All dimensions."""
        return tuple(map(str, range(next(iter(self.columns.values())).ndim)))

    def read(self, name: str, whole: bool) -> NamedArray:
        """A column."""
        return NamedArray(self.rows, self.columns[name])


class Expression:
    """A condition or formula, for instance ``initial_skew_1_deg < initial_skew_2_deg and torque_n_m > 25``.

    Attributes:
        text: The condition, or the beginning of a long one.
        used: Names that it does use.
        operations: Number of names, numbers and operators in it.
        widest: Values in the largest array that an evaluation made.
        is_phase: Whether its result is a phase.

    Args:
        words: All texts that names have which are flags; a comparison of one with another text is refused.
        phases: Names that are phases.
        is_condition: Whether it may compare phases as they are in a cube, and calculate with their differences, which
            are by the shorter way.

    Raises:
        InputError: If the text does not parse, uses an unknown name, or anything but arithmetic, comparison, logic and
            labels, or calculates with a phase what depends on where the circle begins.
    """

    def __init__(
        self,
        text: str,
        names: Collection[str],
        words: Mapping[str, Collection[str]] | None = None,
        phases: Container[str] = (),
        is_condition: bool = False,
    ) -> None:
        self.text = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
        self.used: set[str] = set()
        self._divisors = list[ast.expr]()
        self.operations = 0
        self.widest = 1
        self._whole, self._words, self._phases, self._is_condition = text, words or {}, phases, is_condition
        if len(text) > _LONGEST:
            raise InputError(f"{self.text!r}: {len(text):,} characters; at most {_LONGEST:,} are allowed")
        try:
            self._tree = ast.parse(text, mode="eval").body
        except (SyntaxError, ValueError) as error:
            at = f" at character {error.offset}" if isinstance(error, SyntaxError) and error.offset else ""
            why = f"{getattr(error, 'msg', error)}{at}" + "; write == to compare" * bool(_ASSIGNMENT.search(text))
            raise InputError(f"{self.text!r}: not an expression ({why})") from error
        except (RecursionError, MemoryError) as error:
            raise InputError(self._too_deep) from error
        self._check(self._tree, names, 1)
        self.is_phase = self._turns(self._tree)

    @property
    def _too_deep(self) -> str:
        return f"{self.text!r}: operators are nested more than {_DEEPEST} deep"

    def _wrong(self, node: ast.expr, reason: object) -> InputError:
        """An error with its position in the text."""
        before = self._whole.encode()[: node.col_offset] if node.lineno == 1 else b""
        place = f" at character {len(before.decode(errors='replace')) + 1}" if node.lineno == 1 else ""
        return InputError(f"{self.text!r}{place}: {reason}")

    def _check(self, node: ast.expr, names: Collection[str], depth: int) -> None:
        if depth > _DEEPEST:
            raise InputError(self._too_deep)
        self.operations += 1
        children: list[ast.expr] = []
        match node:
            case ast.Name(id=name):
                if name not in names:
                    raise self._wrong(node, f"unknown name {name[:_SHOWN]!r}{near_match(name, names)}")
                self.used.add(name)
            case ast.Constant(value=int() as value) if not _is_exact(value):
                raise self._wrong(node, f"a whole number beyond {_WHOLE:,} that float64 does not hold")
            case ast.Constant(value=int() | float() | str()):
                pass
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                children = [left, right]
                self._divisors += [right] * isinstance(op, ast.Div)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                children = [operand]
            case ast.BoolOp(values=values):
                children = values
            case ast.Compare(left=left, ops=ops, comparators=others) if all(type(op) in _COMPARE for op in ops):
                children = [left, *others]
                self._refuse_other_words(node, children)
            case ast.Call(func=ast.Name(id=function), args=arguments, keywords=[]) if function in (*_ONE, *_REDUCE):
                children, _ = self._arguments(node, function, arguments)
            case ast.Subscript(value=value, slice=index):
                self._picks(index)
                children = [value]
            case _:
                wrong = (ast.get_source_segment(self._whole, node) or "")[:_SHOWN]
                raise self._wrong(node, f"{wrong!r} is not allowed here; use {_ALLOWED}")
        for child in children:
            self._check(child, names, depth + 1)

    def _turns(self, node: ast.AST) -> bool:
        """Whether a part of the formula is a phase: a sum or difference with one, or a whole multiple of one."""
        match node:
            case ast.Name(id=name):
                return name in self._phases
            case ast.Subscript(value=value):
                return self._turns(value)
            case ast.Call(func=ast.Name(id="abs"), args=[value]):  # its distance from zero
                self._turns(value)  # checked, too
                return False
            case ast.UnaryOp(op=ast.USub() | ast.UAdd()) | ast.BinOp(op=ast.Add() | ast.Sub()):
                return sum(self._turns(each) for each in ast.iter_child_nodes(node)) > 0  # all are checked
            case ast.BinOp(left=left, op=ast.Mult(), right=right) if _is_whole(left) or _is_whole(right):
                return self._turns(right if _is_whole(left) else left)
        for each in ast.iter_child_nodes(node):
            if self._turns(each) and isinstance(each, ast.expr) and not self._is_condition:
                what = "sums and differences with it, whole multiples, and abs, its distance from 0"
                raise self._wrong(each, f"{JUMPS}: formulas may use {what}")
        return False

    def _refuse_other_words(self, node: ast.expr, terms: Sequence[ast.expr]) -> None:
        """Refuse a comparison of a flag with a text that it never has, which no cell would meet."""
        texts = [term.value for term in terms if isinstance(term, ast.Constant) and isinstance(term.value, str)]
        for flag in terms:
            known = self._words.get(flag.id) if isinstance(flag, ast.Name) else None
            if wrong := [text for text in texts if known and text not in known]:
                reason = (
                    f"{ast.unparse(flag)} never has the value {wrong[0][:_SHOWN]!r}{near_match(wrong[0], known or ())}"
                )
                raise self._wrong(node, reason)

    def _arguments(self, node: ast.expr, function: str, arguments: list[ast.expr]) -> tuple[list[ast.expr], list[str]]:
        """The values among the arguments of a function, and the dimensions after them that it reduces."""
        dims: list[str] = []
        values = list(arguments)
        while function in _REDUCE and len(values) > 1:
            match values[-1]:
                case ast.Constant(value=str() as dim):
                    dims.insert(0, dim)
                    values.pop()
                case _:
                    break
        if len(values) != 1 and (dims or function not in _SEVERAL or not values):
            known = "values, or one value and names of dimensions" if function in _SEVERAL else "one value"
            if function in ("mean", "sum"):
                known = "one value and names of dimensions"
            raise self._wrong(node, f"wrong number of arguments for {function}, which takes {known}")
        return values, dims

    def _picks(self, index: ast.expr) -> list[Pick]:
        """Labels and ranges between brackets."""
        parts = index.elts if isinstance(index, ast.Tuple) else [index]
        return [self._range(part) if isinstance(part, ast.Slice) else self._label(part) for part in parts]

    def _range(self, part: ast.Slice) -> tuple[float | None, float | None]:
        ends = [None if end is None else self._label(end) for end in (part.lower, part.upper)]
        low, high = ends
        if part.step is not None or isinstance(low, str) or isinstance(high, str):
            raise self._wrong(part, "a range is two numbers, [90:180]")
        return low, high

    def _label(self, part: ast.expr) -> float | str:
        match part:
            case ast.Constant(value=str() as value):
                return value
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and _is_finite(value):
                return float(value)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)) if _is_finite(value):
                return -float(value)
        raise self._wrong(part, "brackets take labels: a number, a 'text', a range as [90:180], or : for all")

    def __call__(self, columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
        """Evaluate for every row of the columns, numbers in float64; NaN, and a comparison with it, is false.

        A division by zero or an overflow gives an infinity or NaN, as float64 does.

        Raises:
            InputError: If values cannot be compared, for instance a number with a text, or whole numbers are too large
                for float64.
        """
        meets = self.truths(Columns(columns))
        return np.broadcast_to(meets.data, np.shape(next(iter(columns.values()))))

    def truths(self, source: Source) -> NamedArray:
        """Evaluate a condition; see `__call__`."""
        result = self._evaluated(source)
        if not self.used and result.data.dtype != np.bool_:
            raise InputError(f"{self.text!r}: not a condition: it names no coordinate or variable and compares nothing")
        if _is_text(result.data):
            raise InputError(f"{self.text!r}: a text is not a condition; compare it, as in name == 'text'")
        return NamedArray(result.dims, _truth(result.data), result.labels)

    def numbers(self, source: Source) -> NamedArray:
        """Evaluate a formula, in float64; InputError if its result is a text, or values cannot be combined."""
        result = self._evaluated(source)
        if not np.issubdtype(np.asarray(result.data).dtype, np.number) and result.data.dtype != np.bool_:
            raise InputError(f"{self.text!r}: its result is a text, not a number")
        data = np.asarray(result.data, np.float64)
        return NamedArray(result.dims, shorter_way(data) if self.is_phase else data, result.labels)

    def divisors(self, source: Source) -> list[NamedArray]:
        """What the formula divides by; see `numbers`."""
        return [self._evaluated(source, each) for each in self._divisors]

    def _evaluated(self, source: Source, part: ast.expr | None = None) -> NamedArray:
        try:
            with np.errstate(all="ignore"):
                return self._value(part or self._tree, source, False)
        except TypeError as error:  # numpy's, whose words are about its own types
            raise InputError(f"{self.text!r}: a text cannot be calculated with; texts can only be compared") from error
        except (OverflowError, ValueError) as error:
            raise InputError(f"{self.text!r}: {error}") from error

    def _refuse_mixed(self, terms: Sequence[Any]) -> None:
        """Refuse a comparison of a number with a text, which would silently be false."""
        if any(np.asarray(term).dtype.kind in "fb" for term in terms) and any(map(_is_text, terms)):
            raise InputError(f"{self.text!r}: compares a number with a text; write texts in quotes, numbers without")

    def _checked(self, name: str, array: NamedArray) -> NamedArray:
        """The values of a name, numbers in float64."""
        values = array.data
        if values.dtype.kind not in "iuf":
            return array
        whole = values.dtype.kind in "iu" and values.size
        if whole and not -_WHOLE <= int(values.min()) <= int(values.max()) <= _WHOLE:
            raise InputError(f"{self.text!r}: {name} has whole numbers beyond {_WHOLE:,} that float64 may not hold")
        return NamedArray(array.dims, values.astype(np.float64, copy=False), array.labels)

    def _value(self, node: ast.expr, source: Source, whole: bool) -> NamedArray:
        match node:
            case ast.Name(id=name):
                array = self._checked(name, source.read(name, whole))
                self.widest = max(self.widest, array.data.size)
                return array
            case ast.Constant(value=str() as value):
                return NamedArray((), np.array(value))
            case ast.Constant(value=(int() | float()) as value):
                return NamedArray((), np.array(value, np.float64))  # Python's whole numbers grow: 9**9**9
            case ast.UnaryOp(op=op, operand=operand):
                inner = self._value(operand, source, whole)
                is_not = isinstance(op, ast.Not)
                data = np.logical_not(_truth(inner.data)) if is_not else _UNARY[type(op)](_number(inner.data))
                return NamedArray(inner.dims, shorter_way(data) if self._turns(node) else data, inner.labels)
            case ast.Subscript(value=value, slice=index):
                inner = self._value(value, source, True)
                try:
                    return inner.picked(self._picks(index), source.rows)
                except InputError as error:
                    raise self._wrong(node, f"{ast.get_source_segment(self._whole, value)}: {error}") from error
            case ast.Call(func=ast.Name(id=function), args=arguments):
                return self._call(node, function, arguments, source, whole)
            case _:
                return self._combined(node, source, whole)

    def _call(
        self, node: ast.expr, function: str, arguments: list[ast.expr], source: Source, whole: bool
    ) -> NamedArray:
        values, dims = self._arguments(node, function, arguments)
        if function in _ONE:
            inner = self._value(values[0], source, whole)
            data = shorter_way(inner.data) if self._turns(values[0]) else _number(inner.data)
            return NamedArray(inner.dims, _ONE[function](data), inner.labels)
        if len(values) > 1:
            terms = self._aligned(node, [self._value(value, source, whole) for value in values], source)
            data = reduce(_SEVERAL[function], (_number(term.data) for term in terms))
            return NamedArray(terms[0].dims, data, terms[0].labels)
        inner = self._value(values[0], source, True)
        own = inner.without(source.rows)
        if unknown := next((dim for dim in dims if dim not in own), None):
            raise self._wrong(node, f"no dimension {unknown!r} here{near_match(unknown, own)}")
        if not own:
            raise self._wrong(node, f"{function} of a single value for each point; leave it out, or compare two values")
        return NamedArray(inner.dims, _number(inner.data), inner.labels).reduced(_REDUCE[function], dims or own)

    def _combined(self, node: ast.expr, source: Source, whole: bool) -> NamedArray:
        """The value of an operator between values."""
        match node:
            case ast.BinOp(left=left, right=right):
                parts = [left, right]
            case ast.BoolOp(values=values):
                parts = values
            case ast.Compare(left=left, comparators=others):
                parts = [left, *others]
            case _:
                raise AssertionError(node)
        arrays = self._aligned(node, [self._value(part, source, whole) for part in parts], source)
        dims, labels, terms = arrays[0].dims, arrays[0].labels, [array.data for array in arrays]
        match node:
            case ast.BinOp(op=op):
                data = np.asarray(_BINARY[type(op)](*map(_number, terms)))
                return NamedArray(dims, shorter_way(data) if self._turns(node) else data, labels)
            case ast.BoolOp(op=op):
                combine = np.logical_and if isinstance(op, ast.And) else np.logical_or
                return NamedArray(dims, np.asarray(reduce(combine, map(_truth, terms))), labels)
            case ast.Compare(ops=ops):
                self._refuse_mixed(terms)
                links = [np.asarray(_COMPARE[type(op)](terms[i], terms[i + 1])) for i, op in enumerate(ops)]
                return NamedArray(dims, np.asarray(reduce(np.logical_and, links)), labels)
        raise AssertionError(node)

    def _aligned(self, node: ast.expr, arrays: list[NamedArray], source: Source) -> list[NamedArray]:
        try:
            terms = aligned(arrays, source.rows, source.most)
        except InputError as error:
            raise self._wrong(node, error) from error
        self.widest = max(self.widest, math.prod(np.broadcast_shapes(*(term.data.shape for term in terms))))
        return terms


def _is_nan(value: Any) -> NDArray[np.bool_]:
    array = np.asarray(value)
    return np.isnan(array) if array.dtype.kind == "f" else np.zeros(array.shape, bool)


def _truth(value: Any) -> NDArray[np.bool_]:
    """Whether a value counts as true; NaN does not."""
    return np.asarray(value).astype(bool) & ~_is_nan(value)


def _is_text(value: Any) -> bool:
    """Whether a value is a text, or a column of texts only."""
    array = np.asarray(value)
    return array.dtype.kind == "U" or (array.dtype == object and all(isinstance(each, str) for each in array.flat))


def _is_exact(value: float) -> bool:
    """Whether float64 holds a whole number."""
    try:
        return int(float(value)) == value or isinstance(value, float)
    except OverflowError:
        return isinstance(value, float)


def _is_whole(node: ast.expr) -> bool:
    """Whether a part of a formula is a whole number."""
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and node.value % 1 == 0


def _is_finite(value: float) -> bool:
    """Whether a label is a number that float64 holds: an infinite one would match any."""
    return _is_exact(value) and math.isfinite(value)


def _number(value: Any) -> Any:
    """Results of comparisons as numbers 0 and 1 in float64; other values unchanged."""
    return np.asarray(value, np.float64) if np.asarray(value).dtype == np.bool_ else value
