"""Candidates of model = "auto": a model with its numerics, and its cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tripod_doe.model_interface.parameter import Value


@dataclass(frozen=True)
class Candidate:
    """A model with its numerics that an automatic choice may use, and its cost."""

    values: Mapping[str, Value]  # its parameters, the same ones in all candidates of a simulator
    # recorded CPU seconds per force evaluation: a choice by cost depends on counted work, never on a clock
    evaluation_seconds: float
    evaluations: float  # force evaluations of a usual run, for a cost estimate
    full: bool = False  # whether it contains all effects, so that its only error is numerical
    # whether it changes parameters of a full candidate, for instance nine thick needles for 27: a study that sets these
    # parameters cannot use it
    substitute: bool = False

    @property
    def label(self) -> str:
        """The candidate in words."""
        return ", ".join(f"{name} = {value}" for name, value in self.values.items())

    @property
    def price(self) -> float:
        """CPU seconds of a usual run."""
        return self.evaluations * self.evaluation_seconds
