"""All time integration methods by name."""

from __future__ import annotations

from tripod_doe.mechanics.integrators import (
    adaptive_euler,
    bdf2,
    generalized_alpha,
    implicit_euler,
    linearly_implicit_euler,
    rk4,
    rosenbrock,
    scipy_oracle,
    symplectic_euler,
)  # fmt: skip
from tripod_doe.mechanics.integrators.contract import Method

__all__ = ["METHODS"]

METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        symplectic_euler.METHOD,
        rk4.METHOD,
        linearly_implicit_euler.METHOD,
        implicit_euler.METHOD,
        adaptive_euler.METHOD,
        bdf2.METHOD,
        rosenbrock.METHOD,
        generalized_alpha.METHOD,
        *scipy_oracle.METHODS,
    )
}
"""Methods by the name that study files use."""
