"""Outputs with unit, symbol, meaning and dimensions; cubes, their sizes and labels are made from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Labels = NDArray[Any]

ZERO_AT, MIRRORED_BY = "zero_at", "mirrored_by"
"""Attributes of the variables of a cube with what `Output` says of zeros and mirrors: names of parameters."""


@dataclass(frozen=True, eq=False)
class Dimension:
    """One dimension of outputs, and its labels."""

    name: str  # its name in the cube
    # one label per place along it, shape (length,); or a function of the parameter that sets the length
    labels: Labels | Callable[[int], Labels]
    unit: str = "1"  # UDUNITS spelling; ``"1"`` without dimension, empty for words
    meaning: str = ""  # CF long_name
    length_parameter: str | None = None  # name of the parameter that sets the length; None if fixed
    convention: str = ""  # start and direction of its labels; CF comment

    def labels_of(self, values: Mapping[str, Any]) -> Labels:
        """Labels for a point with these values of its parameters, shape (length,)."""
        if not callable(self.labels):
            return self.labels
        return self.labels(int(values[self.length_parameter or ""]))

    @property
    def attributes(self) -> dict[str, str]:
        """Unit, meaning and convention, as attributes of the coordinate."""
        attributes = {"units": self.unit, "comment": self.convention}
        return {"long_name": self.meaning or self.name.replace("_", " ")} | {k: v for k, v in attributes.items() if v}


@dataclass(frozen=True)
class Output:
    """One result of a simulator: a variable of the cube."""

    name: str  # variable name
    unit: str  # UDUNITS spelling; ``"1"`` without dimension
    symbol: str  # the field's symbol
    meaning: str  # CF long_name
    # dimensions of one point's value, for instance groove and order; empty for a scalar
    dimensions: tuple[Dimension, ...] = ()
    optional: bool = False  # whether some models cannot compute it: their finished points hold NaN
    # what a missing value of a point that finished counts as wherever the output is used
    if_missing: float = math.nan
    on_request: bool = False  # whether it is computed only if a study keeps it by name
    # whether reports show it separately, next to the main results of its simulator; a scalar
    response: bool = False
    convention: str = ""  # meaning of its signs and phases; CF comment
    # parameters that make all its values zero if one of them is zero
    zero_at: tuple[str, ...] = ()
    # parameters whose common change of sign keeps a wave of odd orders and reverses a wave of even orders, once the
    # motion is periodic
    mirrored_by: tuple[str, ...] = ()

    @property
    def unit_text(self) -> str:
        """The unit for people: empty without one."""
        return {"1": "", "degree": "deg"}.get(self.unit, self.unit)

    def given(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of points that finished, with `if_missing` in place of missing ones."""
        return values if math.isnan(self.if_missing) else np.where(np.isnan(values), self.if_missing, values)

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(dimension.name for dimension in self.dimensions)

    def shape(self, values: Mapping[str, Any]) -> tuple[int, ...]:
        """Lengths of the dimensions for a point with these values of its parameters."""
        return tuple(dimension.labels_of(values).size for dimension in self.dimensions)
