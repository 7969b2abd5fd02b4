"""Eight numbers at a time: a value type of kernels in one AVX-512 register, or in the registers that the machine has.

Lanes and floats share operators and mix, so that one law or vector formula serves both. Arithmetic follows IEEE 754,
without contraction (which gains nothing), so that symmetric terms cancel. The compiler's own vectorisation of loops
over eight was tried: it is three to five times slower on products of blocks.

Twenty-four numbers (`LANES_OF_THREE`) are three registers with the same operators. Where every operation waits for the
one before it, they cost little more than one.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

WIDTH = 8
_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(32)
VECTOR = ir.VectorType(_DOUBLE, WIDTH)


class Lanes(types.Type):
    """Type of eight floats in one register, or of several registers."""

    def __init__(self, name: str = "lanes", registers: int = 1) -> None:
        self.registers = registers
        super().__init__(name=name)

    def lift(self, builder: Any, kind: Any, value: Any) -> Any:
        """The lanes of a value of this type, or of a float that is mixed with it."""
        return spread_lanes(builder, kind, value)


class Mask(types.Type):
    """Type of a truth value for each of some lanes."""

    def __init__(self, lanes: Lanes) -> None:
        self.registers = lanes.registers
        super().__init__(name=f"{lanes.name}_mask")


LANES, LANES_OF_THREE = Lanes(), Lanes("lanes_of_three", 3)
_MASKS = {kind: Mask(kind) for kind in (LANES, LANES_OF_THREE)}
MASK = _MASKS[LANES]


def _several(register: Any, count: int) -> Any:
    return register if count == 1 else ir.ArrayType(register, count)


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):
    """One register or several."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _several(VECTOR, kind.registers))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _several(ir.VectorType(ir.IntType(1), WIDTH), kind.registers))


def _registers(builder: Any, value: Any, count: int) -> list[Any]:
    """The registers of a value; a single one or a float stands for all."""
    if not isinstance(value.type, ir.ArrayType):
        return [value] * count
    return [builder.extract_value(value, k) for k in range(count)]


def _joined(builder: Any, registers: list[Any]) -> Any:
    """One value of several registers."""
    whole = ir.Constant(ir.ArrayType(registers[0].type, len(registers)), ir.Undefined)
    for k, register in enumerate(registers):
        whole = builder.insert_value(whole, register, k)
    return whole


def by_register(make: Callable[..., Any]) -> Callable[..., Any]:
    """Let a function that makes a register from others make several from several."""

    def made(builder: Any, *values: Any) -> Any:
        count = max((value.type.count for value in values if isinstance(value.type, ir.ArrayType)), default=1)
        if count == 1:
            return make(builder, *values)
        each = zip(*(_registers(builder, value, count) for value in values), strict=True)
        return _joined(builder, [make(builder, *one) for one in each])

    return made


def spread_lanes(builder: Any, kind: Any, value: Any) -> Any:
    """The eight lanes of a value that may be a single float."""
    if isinstance(kind, Lanes):
        return value
    one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), value, ir.Constant(_INDEX, 0))
    return _shuffle(builder, one, one, [0] * WIDTH)


def _shuffle(builder: Any, first: Any, second: Any, places: list[int]) -> Any:
    return builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(_INDEX, len(places)), places))


def call(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    """Call an intrinsic function of the compiler."""
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def define(function: Any, count: int, result: Any, make: Any, own: Lanes = LANES) -> None:
    """Let a function of Python accept lanes: `count` arguments, one or more of type `own`, the others floats."""
    mixtures = [(own,)] if count == 1 else [(own, own), (own, types.float64), (types.float64, own)]
    cases = [signature(result, *kinds) for kinds in mixtures]
    infer_global(function)(type("Mixtures", (ConcreteTemplate,), {"cases": cases}))
    whole = by_register(make)
    for kinds in mixtures:

        def lower(_: Any, builder: Any, sign: Any, values: Any) -> Any:
            return whole(builder, *(own.lift(builder, kind, v) for kind, v in zip(sign.args, values, strict=True)))

        lower_builtin(function, *kinds)(lower)


def _pairwise(name: str) -> Any:
    return lambda builder, a, b: getattr(builder, name)(a, b)


def _comparison(sign: str) -> Any:
    return lambda builder, a, b: builder.fcmp_ordered(sign, a, b)


for _kind, _mask in _MASKS.items():
    for _function, _name in (
        (operator.add, "fadd"),
        (operator.sub, "fsub"),
        (operator.mul, "fmul"),
        (operator.truediv, "fdiv"),
    ):
        define(_function, 2, _kind, _pairwise(_name), _kind)
    for _function, _sign in ((operator.gt, ">"), (operator.lt, "<"), (operator.le, "<=")):
        define(_function, 2, _mask, _comparison(_sign), _kind)
    define(max, 2, _kind, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", b, a), b, a), _kind)
    define(min, 2, _kind, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", b, a), b, a), _kind)
    define(operator.pow, 2, _kind, lambda builder, a, b: call(builder, "llvm.pow.v8f64", VECTOR, a, b), _kind)
    define(operator.neg, 1, _kind, lambda builder, a: builder.fneg(a), _kind)
    define(abs, 1, _kind, lambda builder, a: call(builder, "llvm.fabs.v8f64", VECTOR, a), _kind)
    define(math.sqrt, 1, _kind, lambda builder, a: call(builder, "llvm.sqrt.v8f64", VECTOR, a), _kind)


@intrinsic
def select(_, condition, a, b):
    """`a` where the condition holds, else `b`: for floats, and lane by lane."""
    if not isinstance(condition, Mask):
        kind = types.float64
        return kind(condition, kind, kind), lambda _, builder, __, values: builder.select(*values)

    mixed = next(kind for kind, mask in _MASKS.items() if mask == condition)
    own = next((kind for kind in (a, b) if isinstance(kind, Lanes)), mixed)

    def lower(_, builder, sign, values):
        a, b = (own.lift(builder, kind, value) for kind, value in zip(sign.args[1:], values[1:], strict=True))
        return by_register(lambda builder, *of: builder.select(*of))(builder, values[0], a, b)

    return own(condition, a, b), lower


@intrinsic
def everywhere(_, condition):
    """Whether a condition on lanes holds in all of them."""

    def lower(_, builder, sign, values):
        byte, count = ir.IntType(WIDTH), sign.args[0].registers
        first, *others = (builder.bitcast(one, byte) for one in _registers(builder, values[0], count))
        for other in others:
            first = builder.and_(first, other)
        return builder.icmp_unsigned("==", first, ir.Constant(byte, 2**WIDTH - 1))

    return types.boolean(condition), lower


@intrinsic
def fused(_, a, b, c):
    """A b + c, rounded once if the machine can; floats, lanes, or a mixture."""
    own: Any = next((kind for kind in (a, b, c) if isinstance(kind, Lanes)), types.float64)

    def lower(_, builder, sign, values):
        if own is not types.float64:
            values = [own.lift(builder, kind, value) for kind, value in zip(sign.args, values, strict=True)]
        name = "llvm.fmuladd.v8f64" if own is not types.float64 else "llvm.fmuladd.f64"
        return by_register(lambda builder, *of: call(builder, name, of[0].type, *of))(builder, *values)

    return own(a, b, c), lower


@intrinsic
def spread(_, number):
    """Lanes that all hold the same number."""

    def lower(_, builder, sign, values):
        return spread_lanes(builder, sign.args[0], values[0])

    return LANES(types.float64), lower


@intrinsic
def ramp(_, start):
    """Lanes start, start + 1, ..., start + 7."""

    def lower(_, builder, sign, values):
        steps = ir.Constant(VECTOR, [float(k) for k in range(WIDTH)])
        return builder.fadd(spread_lanes(builder, types.float64, values[0]), steps)

    return LANES(types.float64), lower


@intrinsic
def row(_, a, b, c, d, e, f):
    """Lanes of six floats, and two zeros."""

    def lower(_, builder, sign, values):
        lanes = ir.Constant(VECTOR, [0.0] * WIDTH)
        for k, value in enumerate(values):
            lanes = builder.insert_element(lanes, value, ir.Constant(_INDEX, k))
        return lanes

    return LANES(*[types.float64] * 6), lower


@intrinsic
def pick(_, lanes, place):
    """One number of eight."""

    def lower(_, builder, sign, values):
        return builder.extract_element(*values)

    return types.float64(lanes, types.int64), lower


@intrinsic
def replace(_, lanes, place, number):
    """The lanes with one number exchanged."""

    def lower(_, builder, sign, values):
        return builder.insert_element(values[0], values[2], values[1])

    return LANES(lanes, types.int64, types.float64), lower


def _row_pointer(context: Any, builder: Any, kind: Any, value: Any, row: Any) -> Any:
    """Address of the first number of a row of a contiguous array of two dimensions."""
    array = context.make_array(kind)(context, builder, value)
    columns = cgutils.unpack_tuple(builder, array.shape)[1]
    return builder.gep(array.data, [builder.mul(row, columns)])


def _register_pointers(builder: Any, start: Any, count: int) -> list[Any]:
    """Addresses of registers that follow each other."""
    return [builder.bitcast(builder.gep(start, [_INDEX(WIDTH * k)]), VECTOR.as_pointer()) for k in range(count)]


@intrinsic
def load(_, array, row):
    """First eight numbers of a row of a contiguous array, shape (any, 8 or more)."""

    def lower(context, builder, sign, values):
        pointer = _row_pointer(context, builder, sign.args[0], *values)
        return builder.load(builder.bitcast(pointer, VECTOR.as_pointer()), align=8)

    return LANES(array, types.int64), lower


@intrinsic
def load_three(_, array, row):
    """First 24 numbers of a row of a contiguous array, shape (any, 24 or more)."""

    def lower(context, builder, sign, values):
        pointer = _row_pointer(context, builder, sign.args[0], *values)
        return _joined(builder, [builder.load(one, align=8) for one in _register_pointers(builder, pointer, 3)])

    return LANES_OF_THREE(array, types.int64), lower


@intrinsic
def across(_, array, row):
    """First three numbers of a row of a contiguous array, shape (any, 3 or more): each in all lanes of a register."""

    def lower(context, builder, sign, values):
        pointer = _row_pointer(context, builder, sign.args[0], *values)
        numbers = [builder.load(builder.gep(pointer, [_INDEX(k)])) for k in range(3)]
        return _joined(builder, [spread_lanes(builder, types.float64, number) for number in numbers])

    return LANES_OF_THREE(array, types.int64), lower


@intrinsic
def store(_, array, row, lanes):
    """Write lanes to the first numbers of a row of a contiguous array, shape (any, as many or more)."""

    def lower(context, builder, sign, values):
        pointer, count = _row_pointer(context, builder, sign.args[0], *values[:2]), sign.args[2].registers
        places = _register_pointers(builder, pointer, count)
        for register, place in zip(_registers(builder, values[2], count), places, strict=True):
            builder.store(register, place, align=8)
        return context.get_dummy_value()

    return types.void(array, types.int64, lanes), lower


@intrinsic
def clear(_, array):
    """Set a contiguous array to zero: one instruction, where numba needs seconds for a slice assignment."""

    def lower(context, builder, sign, values):
        array = context.make_array(sign.args[0])(context, builder, values[0])
        size = builder.mul(array.nitems, array.itemsize)
        cgutils.memset(builder, array.data, size, 0)
        return context.get_dummy_value()

    if array.layout != "C":
        return None
    return types.void(array), lower


@intrinsic
def row_of_sums(_, a, b, c, d, e, f):
    """Lanes that hold the sums of six lanes, and two zeros; of each register alone."""
    own = next((kind for kind in (a, b, c, d, e, f) if isinstance(kind, Lanes)), LANES)

    def sums(builder, *values):
        left = [*values, *[ir.Constant(VECTOR, [0.0] * WIDTH)] * 2]
        # neighbours are added in pairs, then pairs of pairs: seven additions for eight sums
        even, odd = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
        left = [_add_shuffled(builder, left[k], left[k + 1], even, odd) for k in range(0, 8, 2)]
        even, odd = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        left = [_add_shuffled(builder, left[k], left[k + 1], even, odd) for k in range(0, 4, 2)]
        even, odd = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        return _add_shuffled(builder, left[0], left[1], even, odd)

    def lower(_, builder, sign, values):
        lifted = (own.lift(builder, kind, value) for kind, value in zip(sign.args, values, strict=True))
        return by_register(sums)(builder, *lifted)

    return own(a, b, c, d, e, f), lower


def _add_shuffled(builder: Any, a: Any, b: Any, first: list[int], second: list[int]) -> Any:
    return builder.fadd(_shuffle(builder, a, b, first), _shuffle(builder, a, b, second))
