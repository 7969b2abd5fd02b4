"""Accuracy that a study requires of its outputs."""

from __future__ import annotations

from dataclasses import dataclass

_ERROR = "_error"  # output NAME_error holds the numerical error of output NAME


@dataclass(frozen=True)
class Quantity:
    """One quantity and its allowed relative error."""

    name: str  # as the study file writes it: an output, or an output with an order, as in thrust_amplitude_3
    output: str  # name of the output
    label: int | None  # label along the output's only dimension; None for a scalar
    allowed: float  # allowed relative error

    @property
    def error(self) -> str:
        """Name of the output that holds the numerical error of this one, if a simulator gives it."""
        return self.output + _ERROR


@dataclass(frozen=True)
class Accuracy:
    """All quantities with a required accuracy."""

    quantities: tuple[Quantity, ...]
    # share of the largest value along the dimension (the third order): errors of smaller values are relative to this
    # share: a vanishing order could never have a small relative error
    floor: float

    @property
    def text(self) -> str:
        """The accuracy as one line, equal for equal accuracies."""
        return ", ".join([f"{each.name} = {each.allowed!r}" for each in self.quantities] + [f"floor = {self.floor!r}"])
