"""The contract of a time integration method.

Every method is a compiled function

    integrate(tables, work, positions, velocities, clock, end, count, settings) -> int

that advances positions and velocities in place from time clock[0] to `end`, in `count` equal steps or, if it controls
its step, in as many as it needs; clock[1:] is the method's own memory between calls (its last step, its next step),
zero at the start. It ends every step with `monitor.accept`, which sets clock[0] and needs the forces, slips and ledger
of the new state (explicit and Rosenbrock methods call `equations_of_motion.settle` for them). It answers with an
outcome.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Method:
    """A time integration method."""

    name: str  # the value of the parameter ``method``
    order: int  # declared order of convergence; with step control, the order of the method's fixed-step form
    meaning: str  # one phrase
    loop: str  # where its time loop is: ``module:function`` of this package
    # whether it chooses its own steps from `relative_tolerance`; else it takes steps of `step_s`
    controlled: bool = False
    # how far its region of stability goes along the negative real and along the imaginary axis: a step beyond the first
    # over the fastest relaxation, or the second over the stiffest mode's angular frequency, is unstable
    reach: tuple[float, float] = (math.inf, math.inf)
    # whether it solves one linear system a step with the secant slope of friction, which is stable and lags
    lagged: bool = False
    compiled: bool = True  # false for SciPy's methods, whose time loop runs in Python

    @cached_property
    def integrate(self) -> Callable[..., Any]:
        """The compiled time loop, or for SciPy's methods a Python function of the same signature."""
        module, _, name = self.loop.partition(":")
        kernel: Callable[..., Any] = getattr(import_module(f"{__package__}.{module}"), name)
        return kernel

    @property
    def explicit(self) -> bool:
        """Whether stiffness limits its step."""
        return self.reach[0] < math.inf
