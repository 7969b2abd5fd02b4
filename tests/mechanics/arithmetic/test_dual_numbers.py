"""Numbers that carry their derivatives, against derivatives by complex steps (exact mathematics)."""

import math

import numpy as np

from tripod_doe.mechanics.arithmetic.dual_numbers import variable
from tripod_doe.mechanics.arithmetic.simd_lanes import pick, select
from tripod_doe.mechanics.compilation.kernels import kernel
from tripod_doe.mechanics.laws.friction import hyperbolic_tangent


@kernel
def _evaluate(a, b, out):
    x, y = variable(a, 1), variable(b, 7)
    results = (
        2.0 * x + y / 3.0 - 1.0,
        x * y,
        x / y,
        1.0 / y,
        math.sqrt(x * x + y * y),
        -abs(y),
        max(x, y),
        min(x, 0.5),
        select(x > y, x * x, y),
        hyperbolic_tangent(x * y),
        hyperbolic_tangent(30.0 + x),
        y - x,
        3.0 - x,
    )
    for i in range(len(results)):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = (
            pick(results[i], 0),
            pick(results[i], 1),
            pick(results[i], 7),
            pick(results[i], 2),
        )


def _expected(x, y):
    return np.array(
        [
            2 * x + y / 3 - 1,
            x * y,
            x / y,
            1 / y,
            np.sqrt(x * x + y * y),
            y if y.real < 0 else -y,
            x if x.real > y.real else y,
            x if x.real < 0.5 else 0.5,
            x * x if x.real > y.real else y,
            np.tanh(x * y),
            1.0,
            y - x,
            3 - x,
        ]
    )


def test_derivatives_are_exact():
    for a, b in np.random.default_rng(2).normal(size=(20, 2)):
        out = np.full((13, 4), np.nan)
        _evaluate(a, b, out)
        step = 1e-30
        by_x, by_y = _expected(complex(a, step), complex(b)).imag, _expected(complex(a), complex(b, step)).imag
        expected = np.stack([_expected(complex(a), complex(b)).real, by_x / step, by_y / step, np.zeros(13)], axis=1)
        np.testing.assert_allclose(out, expected, rtol=1e-12, atol=1e-13)
