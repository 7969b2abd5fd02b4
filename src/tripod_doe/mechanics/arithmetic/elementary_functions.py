"""Roots, exponentials, logarithms and sines of floats and lanes (`simd_lanes`), without branches and tables.

They agree with numpy to some units of the last place; the compiler has no vector form of the C library's functions.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from tripod_doe.mechanics.arithmetic.simd_lanes import VECTOR, WIDTH, by_register, fused, select, spread_lanes
from tripod_doe.mechanics.compilation.kernels import inlined_kernel

_INTEGER = ir.IntType(64)


@intrinsic
def _root_guess(_, x, order, offset):
    """First guess of a root of x > 0, by dividing the bits of its logarithm: bits(x) / order + offset, as a float."""

    def guess(builder, value, order, offset):
        kind = value.type
        whole = ir.VectorType(_INTEGER, WIDTH) if kind == VECTOR else _INTEGER
        # a division of integers has no vector form; as floats the bits lose nothing that a guess needs
        scaled = builder.sitofp(builder.bitcast(value, whole), kind)
        if kind == VECTOR:
            order, offset = (spread_lanes(builder, types.float64, v) for v in (order, offset))
        scaled = builder.fadd(builder.fmul(scaled, order), offset)
        return builder.bitcast(builder.fptosi(scaled, whole), kind)

    return x(x, types.float64, types.float64), lambda _, builder, __, values: by_register(guess)(builder, *values)


def _bits(builder: Any, value: Any) -> tuple[Any, Any]:
    """The bits of a float or of lanes as integers, and a function that makes constants of their type."""
    if value.type == VECTOR:
        whole = ir.VectorType(_INTEGER, WIDTH)
        return builder.bitcast(value, whole), lambda number: ir.Constant(whole, [number] * WIDTH)
    return builder.bitcast(value, _INTEGER), lambda number: ir.Constant(_INTEGER, number)


@intrinsic
def _scaled(_, y, shifted):
    """Product of y and 2^k, with k + 1.5 2^52 as `shifted`: shifts and sums of integers, which all machines have."""

    def scaled(builder, *values):
        (whole, _), (power, constant) = (_bits(builder, value) for value in values)
        return builder.bitcast(builder.add(whole, builder.shl(power, constant(52))), values[0].type)

    return y(y, y), lambda _, builder, __, values: by_register(scaled)(builder, *values)


@intrinsic
def _exponent(_, x):
    """The exponent k of x = 2^k m > 0, 1 <= m < 2."""

    def exponent(builder, value):
        whole, constant = _bits(builder, value)
        number = builder.or_(builder.lshr(whole, constant(52)), constant(0x433 << 52))  # 2^52 + 1023 + k
        shift = builder.bitcast(constant(0x433 << 52 | 1023), value.type)
        return builder.fsub(builder.bitcast(number, value.type), shift)

    return x(x), lambda _, builder, __, values: by_register(exponent)(builder, *values)


@intrinsic
def _mantissa(_, x):
    """The mantissa m of x = 2^k m > 0, 1 <= m < 2."""

    def mantissa(builder, value):
        whole, constant = _bits(builder, value)
        number = builder.or_(builder.and_(whole, constant(2**52 - 1)), constant(1023 << 52))
        return builder.bitcast(number, value.type)

    return x(x), lambda _, builder, __, values: by_register(mantissa)(builder, *values)


_BITS_OF_ONE = (1023.0 - 0.05) * 2.0**52
"""The bits of 1.0 read as an integer, minus the correction that minimises the error of `root`'s guess."""


@inlined_kernel
def root(x, order):
    """Third or ninth root of x >= 0, a float or lanes, to 1e-15 relative and without a division.

    A bit trick guesses y = x^(-1/n) so well that 1 - x y^n is between -0.29 and 0.25; two power series follow.
    """
    x, part, other = max(x, 1e-250), 1.0 / order, 1.0 - 1.0 / order
    y = _root_guess(x, -part, (1.0 + part) * _BITS_OF_ONE)
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
