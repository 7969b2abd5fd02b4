"""A number with its derivatives for up to seven variables: a value type of kernels that differentiates laws exactly.

It is a register of `simd_lanes` with its own arithmetic: the first lane is the value, the others are derivatives, and
every operation follows the rules of differentiation (forward mode). Laws for floats and lanes accept it, too; floats
count as constants. Comparisons use its value.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, register_model

from tripod_doe.mechanics.arithmetic.simd_lanes import MASK, WIDTH, Lanes, LanesModel, call, define, spread_lanes

DIRECTIONS = WIDTH - 1
_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(32)
_VECTOR = ir.VectorType(_DOUBLE, WIDTH)


class Derivatives(Lanes):
    """Type of a number with derivatives."""

    def __init__(self) -> None:
        super().__init__(name="derivatives")

    def lift(self, builder: Any, kind: Any, value: Any) -> Any:
        """The number itself, or a float as a constant."""
        if isinstance(kind, Lanes):
            return value
        return builder.insert_element(ir.Constant(_VECTOR, [0.0] * WIDTH), value, ir.Constant(_INDEX, 0))


_KIND = Derivatives()
register_model(Derivatives)(LanesModel)


def _value(builder: Any, a: Any) -> Any:
    """The value in all lanes."""
    first = builder.extract_element(a, ir.Constant(_INDEX, 0))
    return spread_lanes(builder, types.float64, first)


def _slopes(builder: Any, a: Any) -> Any:
    """The derivatives, with zero for the value."""
    return builder.insert_element(a, ir.Constant(_DOUBLE, 0.0), ir.Constant(_INDEX, 0))


def _product(builder: Any, a: Any, b: Any) -> Any:
    left = builder.fmul(a, _value(builder, b))
    return builder.fadd(left, builder.fmul(_value(builder, a), _slopes(builder, b)))


def _quotient(builder: Any, a: Any, b: Any) -> Any:
    whole = _value(builder, b)
    ratio = builder.fdiv(_value(builder, a), whole)
    return builder.fdiv(builder.fsub(a, builder.fmul(ratio, _slopes(builder, b))), whole)


def _root(builder: Any, a: Any) -> Any:
    root = call(builder, "llvm.sqrt.v8f64", _VECTOR, _value(builder, a))
    return builder.fdiv(builder.fmul(a, ir.Constant(_VECTOR, [1.0] + [0.5] * DIRECTIONS)), root)


def _compared(sign: str) -> Any:
    return lambda builder, a, b: builder.fcmp_ordered(sign, _value(builder, a), _value(builder, b))


def _chosen(sign: str) -> Any:
    return lambda builder, a, b: builder.select(_compared(sign)(builder, b, a), b, a)


def _magnitude(builder: Any, a: Any) -> Any:
    positive = builder.fcmp_ordered(">=", _value(builder, a), ir.Constant(_VECTOR, [0.0] * WIDTH))
    return builder.select(positive, a, builder.fneg(a))


for _function, _count, _make in (
    (operator.add, 2, lambda builder, a, b: builder.fadd(a, b)),
    (operator.sub, 2, lambda builder, a, b: builder.fsub(a, b)),
    (operator.mul, 2, _product),
    (operator.truediv, 2, _quotient),
    (max, 2, _chosen(">")),
    (min, 2, _chosen("<")),
    (operator.neg, 1, lambda builder, a: builder.fneg(a)),
    (abs, 1, _magnitude),
    (math.sqrt, 1, _root),
):
    define(_function, _count, _KIND, _make, _KIND)
for _function, _sign in ((operator.gt, ">"), (operator.lt, "<"), (operator.le, "<=")):
    define(_function, 2, MASK, _compared(_sign), _KIND)


@intrinsic
def variable(_, value, place):
    """The variable number `place` (1 to 7): its own derivative is one."""

    def lower(_, builder, sign, values):
        lifted = _KIND.lift(builder, sign.args[0], values[0])
        return builder.insert_element(lifted, ir.Constant(_DOUBLE, 1.0), values[1])

    return _KIND(types.float64, types.int64), lower
