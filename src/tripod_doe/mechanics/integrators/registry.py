"""All time integration methods by name. Their kernels are imported when they are first used."""

from __future__ import annotations

from tripod_doe.mechanics.integrators.method_interface import Method

_METHODS = (
    Method(
        "symplectic-euler",
        1,
        "symplectic Euler, explicit, for comparison",
        "symplectic_euler:integrate",
        reach=(2.0, 2.0),
    ),
    Method("rk4", 4, "classical Runge-Kutta, explicit, for comparison", "rk4:integrate", reach=(2.785, 2.828)),
    Method(
        "linearly-implicit-euler",
        1,
        "linearly implicit Euler with secant friction",
        "linearly_implicit_euler:integrate",
        lagged=True,
    ),
    Method("implicit-euler", 1, "implicit Euler with secant iterations", "implicit_euler:integrate"),
    Method(
        "adaptive-euler",
        1,
        "implicit Euler with steps that follow the motion's time scale, halved where one does not converge",
        "adaptive_euler:integrate",
        controlled=True,
    ),
    Method("bdf2", 2, "two-step backward differentiation with secant iterations", "bdf2:integrate"),
    Method(
        "rosenbrock", 3, "Rosenbrock-W method of order 3(2) with step control", "rosenbrock:integrate", controlled=True
    ),
    Method("generalized-alpha", 2, "generalized-alpha, spectral radius 0.8", "generalized_alpha:integrate"),
    Method("scipy-radau", 5, "SciPy's Radau, for comparison", "scipy_oracle:radau", controlled=True, compiled=False),
    Method("scipy-bdf", 5, "SciPy's BDF, for comparison", "scipy_oracle:bdf", controlled=True, compiled=False),
    Method("scipy-lsoda", 5, "SciPy's LSODA, for comparison", "scipy_oracle:lsoda", controlled=True, compiled=False),
    Method("scipy-dop853", 8, "SciPy's DOP853, for comparison", "scipy_oracle:dop853", controlled=True, compiled=False),
)

METHODS: dict[str, Method] = {method.name: method for method in _METHODS}
"""Methods by the name that study files use."""
