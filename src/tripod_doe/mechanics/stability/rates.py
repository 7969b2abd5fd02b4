"""Rates of a linearised scene, which limit the step of a run, and the outputs that state them; see `linearisation`."""

from __future__ import annotations

from dataclasses import dataclass

from tripod_doe.model_interface import Output

RATE_OUTPUTS = tuple(
    Output(name, "s-1", symbol, meaning, optional=True, on_request=True)
    for name, symbol, meaning in (
        ("contact_rate_per_s", "omega", "angular frequency of the stiffest contact mode on the way"),
        ("friction_rate_per_s", "lambda", "fastest relaxation by friction and damping on the way"),
        (
            "secant_lag_rate_per_s",
            "",
            "relative error by the secant slope of friction in a linearly implicit step, over the step",
        ),
    )
)
"""Rates that limit a run's step, as outputs in the order of `Rates`."""


@dataclass(frozen=True)
class Rates:
    """Rates that limit a step, each per unit of time."""

    contact: float  # angular frequency of the stiffest mode
    friction: float  # fastest relaxation by friction and damping
    lag: float  # relative error of a linearly implicit step with the secant slope, over the step
