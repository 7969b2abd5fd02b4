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

from tripod_doe.mechanics.compilation.kernels import inlined_kernel

WIDTH = 8
_DOUBLE, _INTEGER, _INDEX = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_VECTOR = ir.VectorType(_DOUBLE, WIDTH)


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
        super().__init__(manager, kind, _several(_VECTOR, kind.registers))


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


def _by_register(make: Callable[..., Any]) -> Callable[..., Any]:
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
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(_INDEX, 0))
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
    whole = _by_register(make)
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
    define(operator.pow, 2, _kind, lambda builder, a, b: call(builder, "llvm.pow.v8f64", _VECTOR, a, b), _kind)
    define(operator.neg, 1, _kind, lambda builder, a: builder.fneg(a), _kind)
    define(abs, 1, _kind, lambda builder, a: call(builder, "llvm.fabs.v8f64", _VECTOR, a), _kind)
    define(math.sqrt, 1, _kind, lambda builder, a: call(builder, "llvm.sqrt.v8f64", _VECTOR, a), _kind)


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
        return _by_register(lambda builder, *of: builder.select(*of))(builder, values[0], a, b)

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
def root_guess(_, x, order, offset):
    """First guess of a root of x > 0, by dividing the bits of its logarithm: bits(x) / order + offset, as a float."""

    def guess(builder, value, order, offset):
        kind = value.type
        whole = ir.VectorType(_INTEGER, WIDTH) if kind == _VECTOR else _INTEGER
        # a division of integers has no vector form; as floats the bits lose nothing that a guess needs
        scaled = builder.sitofp(builder.bitcast(value, whole), kind)
        if kind == _VECTOR:
            order, offset = (spread_lanes(builder, types.float64, v) for v in (order, offset))
        scaled = builder.fadd(builder.fmul(scaled, order), offset)
        return builder.bitcast(builder.fptosi(scaled, whole), kind)

    return x(x, types.float64, types.float64), lambda _, builder, __, values: _by_register(guess)(builder, *values)


def _bits(builder: Any, value: Any) -> tuple[Any, Any]:
    """The bits of a float or of lanes as integers, and a function that makes constants of their type."""
    if value.type == _VECTOR:
        whole = ir.VectorType(_INTEGER, WIDTH)
        return builder.bitcast(value, whole), lambda number: ir.Constant(whole, [number] * WIDTH)
    return builder.bitcast(value, _INTEGER), lambda number: ir.Constant(_INTEGER, number)


@intrinsic
def fused(_, a, b, c):
    """A b + c, rounded once if the machine can; floats, lanes, or a mixture."""
    own: Any = next((kind for kind in (a, b, c) if isinstance(kind, Lanes)), types.float64)

    def lower(_, builder, sign, values):
        if own is not types.float64:
            values = [own.lift(builder, kind, value) for kind, value in zip(sign.args, values, strict=True)]
        name = "llvm.fmuladd.v8f64" if own is not types.float64 else "llvm.fmuladd.f64"
        return _by_register(lambda builder, *of: call(builder, name, of[0].type, *of))(builder, *values)

    return own(a, b, c), lower


@intrinsic
def _scaled(_, y, shifted):
    """Product of y and 2^k, with k + 1.5 2^52 as `shifted`: shifts and sums of integers, which all machines have."""

    def scaled(builder, *values):
        (whole, _), (power, constant) = (_bits(builder, value) for value in values)
        return builder.bitcast(builder.add(whole, builder.shl(power, constant(52))), values[0].type)

    return y(y, y), lambda _, builder, __, values: _by_register(scaled)(builder, *values)


@intrinsic
def _exponent(_, x):
    """The exponent k of x = 2^k m > 0, 1 <= m < 2."""

    def exponent(builder, value):
        whole, constant = _bits(builder, value)
        number = builder.or_(builder.lshr(whole, constant(52)), constant(0x433 << 52))  # 2^52 + 1023 + k
        shift = builder.bitcast(constant(0x433 << 52 | 1023), value.type)
        return builder.fsub(builder.bitcast(number, value.type), shift)

    return x(x), lambda _, builder, __, values: _by_register(exponent)(builder, *values)


@intrinsic
def _mantissa(_, x):
    """The mantissa m of x = 2^k m > 0, 1 <= m < 2."""

    def mantissa(builder, value):
        whole, constant = _bits(builder, value)
        number = builder.or_(builder.and_(whole, constant(2**52 - 1)), constant(1023 << 52))
        return builder.bitcast(number, value.type)

    return x(x), lambda _, builder, __, values: _by_register(mantissa)(builder, *values)


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
        steps = ir.Constant(_VECTOR, [float(k) for k in range(WIDTH)])
        return builder.fadd(spread_lanes(builder, types.float64, values[0]), steps)

    return LANES(types.float64), lower


@intrinsic
def row(_, a, b, c, d, e, f):
    """Lanes of six floats, and two zeros."""

    def lower(_, builder, sign, values):
        lanes = ir.Constant(_VECTOR, [0.0] * WIDTH)
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
    return [builder.bitcast(builder.gep(start, [_INDEX(WIDTH * k)]), _VECTOR.as_pointer()) for k in range(count)]


@intrinsic
def load(_, array, row):
    """First eight numbers of a row of a contiguous array, shape (any, 8 or more)."""

    def lower(context, builder, sign, values):
        pointer = _row_pointer(context, builder, sign.args[0], *values)
        return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)

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
        left = [*values, *[ir.Constant(_VECTOR, [0.0] * WIDTH)] * 2]
        # neighbours are added in pairs, then pairs of pairs: seven additions for eight sums
        even, odd = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
        left = [_add_shuffled(builder, left[k], left[k + 1], even, odd) for k in range(0, 8, 2)]
        even, odd = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
        left = [_add_shuffled(builder, left[k], left[k + 1], even, odd) for k in range(0, 4, 2)]
        even, odd = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        return _add_shuffled(builder, left[0], left[1], even, odd)

    def lower(_, builder, sign, values):
        lifted = (own.lift(builder, kind, value) for kind, value in zip(sign.args, values, strict=True))
        return _by_register(sums)(builder, *lifted)

    return own(a, b, c, d, e, f), lower


def _add_shuffled(builder: Any, a: Any, b: Any, first: list[int], second: list[int]) -> Any:
    return builder.fadd(_shuffle(builder, a, b, first), _shuffle(builder, a, b, second))


_BITS_OF_ONE = (1023.0 - 0.05) * 2.0**52
"""The bits of 1.0 read as an integer, minus the correction that minimises the error of `root`'s guess."""


@inlined_kernel
def root(x, order):
    """Third or ninth root of x >= 0, a float or lanes, to 1e-15 relative and without a division.

    A bit trick guesses y = x^(-1/n) so well that 1 - x y^n is between -0.29 and 0.25; two power series follow.
    """
    x, part, other = max(x, 1e-250), 1.0 / order, 1.0 - 1.0 / order
    y = root_guess(x, -part, (1.0 + part) * _BITS_OF_ONE)
    wrong = 1.0 - _last_power(x, y, order) * y
    y = y * _series(part, wrong)
    nearly = _last_power(x, y, order)
    return nearly * _series(other, 1.0 - nearly * y)


@inlined_kernel
def _last_power(x, y, order):
    """X y^(n - 1)."""
    square = y * y
    if order == 3:
        return x * square
    square = square * square
    return x * (square * square)


@inlined_kernel
def _series(power, x):
    """(1 - x)^-power to the fourth order."""
    third = power * (power + 1.0) * (power + 2.0) / 6.0
    fourth = third * (power + 3.0) / 4.0
    return fused(x, fused(x, fused(x, fused(x, fourth, third), 0.5 * power * (power + 1.0)), power), 1.0)


_MAGIC = 1.5 * 2.0**52
"""A float to which whole numbers are added in its last bits."""


@inlined_kernel
def exponential(x):
    """exp(x) to 1e-15 relative for |x| < 700, a float or lanes."""
    shifted = x * 1.4426950408889634 + _MAGIC
    k = shifted - _MAGIC
    r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    # Taylor's series in short parts, which do not wait for each other, |r| < 0.347
    q = r * r
    q2 = q * q
    low = (1.0 + r) + q * fused(1 / 6, r, 0.5)
    middle = fused(1 / 120, r, 1 / 24) + q * fused(1 / 5040, r, 1 / 720)
    high = fused(1 / 362880, r, 1 / 40320) + q * fused(1 / 39916800, r, 1 / 3628800)
    return _scaled(fused(q2, fused(q2, high + q2 * (1 / 479001600), middle), low), shifted)


@inlined_kernel
def exponentials(x):
    """exp(x) and exp(-x) as by `exponential`, for little more than one: even and odd terms are the same."""
    shifted = x * 1.4426950408889634 + _MAGIC
    k = shifted - _MAGIC
    r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    q = r * r
    q2 = q * q
    even = fused(q, fused(q, 1 / 720, 1 / 24) + q2 * fused(q, 1 / 3628800, 1 / 40320), 0.5)
    even = fused(q2 * q2 * q2, 1 / 479001600, even * q)  # but for 1
    odd = fused(q, fused(q, 1 / 5040, 1 / 120) + q2 * fused(q, 1 / 39916800, 1 / 362880), 1 / 6)
    odd = fused(odd * q, r, r)
    return _scaled((1.0 + odd) + even, shifted), _scaled((1.0 - odd) + even, 2.0 * _MAGIC - shifted)


@inlined_kernel
def logarithm(x):
    """log(x) to 1e-15 (relative where x is far from 1, else of x - 1) for x > 0, a float or lanes."""
    k, m = _exponent(x), _mantissa(x)
    large = m > 1.4142135623730951
    k, m = select(large, k + 1.0, k), select(large, 0.5 * m, m)
    z = (m - 1.0) / (m + 1.0)
    q = z * z  # < 0.0295
    q2 = q * q
    low, middle = fused(q, 1 / 3, 1.0), fused(q, 1 / 7, 1 / 5)
    high = fused(q, 1 / 11, 1 / 9) + q2 * fused(q, 1 / 15, 1 / 13)
    series = fused(q2, fused(q2, high + (q2 * q2) * fused(q, 1 / 19, 1 / 17), middle), low)
    return k * 6.93147180369123816490e-01 + fused(2.0 * z, series, k * 1.90821492927058770002e-10)


@inlined_kernel
def sine_cosine(x):
    """sin(x) and cos(x) to 1e-14 for |x| < 1, a float or lanes; beyond, x counts as this large."""
    x = min(max(x, -1.0), 1.0)
    q = x * x
    q2 = q * q
    q4 = q2 * q2
    sine = fused(q, 1 / 120, -1 / 6) + q2 * fused(q, 1 / 362880, -1 / 5040)
    sine = fused(q4, fused(q, 1 / 6227020800, -1 / 39916800) - q2 * (1 / 1307674368000), sine)
    cosine = fused(q, 1 / 24, -1 / 2) + q2 * fused(q, 1 / 40320, -1 / 720)
    cosine = fused(q4, fused(q, 1 / 479001600, -1 / 3628800) - q2 * (1 / 87178291200), cosine)
    return fused(x * q, sine, x), fused(q, cosine, 1.0)
