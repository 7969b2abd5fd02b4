"""What model = "auto" may choose: a model with its numerics, and what it costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tripod_doe.simulator.parameter import Value

__all__ = ["Candidate"]


@dataclass(frozen=True)
class Candidate:
    """A model with its numerics that an automatic choice may take, and its price.

    Attributes
    ----------
    values
        The parameters that make it; all candidates of a simulator set the same ones.
    evaluation_seconds
        Recorded CPU seconds per force evaluation, so that a choice by price rests on counted work and never on a clock.
    evaluations
        Force evaluations of a usual run, for a price beforehand.
    full
        Whether it leaves nothing out, so that its error is that of its numerics.
    substitute
        Whether it replaces a full one by other values of that one's parameters, such as nine thick needles for 27: it
        is no candidate for a study that sets those parameters itself.
    """

    values: Mapping[str, Value]
    evaluation_seconds: float
    evaluations: float
    full: bool = False
    substitute: bool = False

    @property
    def label(self) -> str:
        """The candidate in words."""
        return ", ".join(f"{name} = {value}" for name, value in self.values.items())

    @property
    def price(self) -> float:
        """CPU seconds of a usual run."""
        return self.evaluations * self.evaluation_seconds
