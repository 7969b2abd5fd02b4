"""Zeros and symmetries of outputs that their simulator declares, before a surrogate learns them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from tripod_doe.analyses.encoding import Column, Input, encoded, inputs_of, is_numeric
from tripod_doe.analyses.surrogate.gaussian_process import Known, polynomial_error
from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import MIRRORED_BY, ZERO_AT

_NEAR = 0.1  # part of its range within which a factor comes near zero
_ALWAYS, _SOON = 1e9, 0.02  # parts of its largest size up to which an output is in proportion to a factor

Marks = tuple[list[bool], list[int]]
"""Which components vanish, and their parity."""


@dataclass(frozen=True)
class KnownStructure:
    """Zeros and symmetries that matter within the range of the points."""

    # factors that reach zero, where outputs vanish, each with its largest size and the part of that above which an
    # output is no longer in proportion to it
    zeros: dict[str, tuple[float, float]]
    mirrored: list[str]  # factors whose common change of sign mirrors outputs
    inputs: list[Input]

    @property
    def flips(self) -> list[int]:
        """Inputs that change their sign with the mirrored factors."""
        return [at for at, each in enumerate(self.inputs) if each.factor in self.mirrored]

    def places(self, columns: Mapping[str, Column]) -> FloatArray:
        """Points as inputs."""
        return encoded(columns, self.inputs)

    def of(self, columns: Mapping[str, Column], vanishes: list[bool], parity: list[int]) -> Known:
        """What is known of components at some points."""
        envelope = np.ones(len(next(iter(columns.values()))))
        for name, (size, soft) in self.zeros.items():
            envelope = envelope * grown(np.abs(columns[name].astype(float)) / size, soft)
        kept = parity if self.mirrored else [0] * len(parity)
        known = [each and bool(self.zeros) for each in vanishes]
        return Known(envelope, np.array(known), np.array(self.flips, np.int64), np.array(kept, np.int64))

    def fitted(self, columns: Mapping[str, Column], values: FloatArray, marks: Marks, seed: int) -> KnownStructure:
        """The same with the growth of the envelope over each factor by which polynomials predict unseen points best.

        The mirror is left out where they predict better without it.

        Args:
            columns: Values of the factors, shape (point,) each.
            marks: Which of them vanish, and their parity.
        """
        places, best = self.places(columns), self
        error = polynomial_error(places, values, seed, best.of(columns, *marks))
        for name, (size, _) in self.zeros.items():
            other = replace(best, zeros={**best.zeros, name: (size, _SOON)})
            changed = polynomial_error(places, values, seed, other.of(columns, *marks))
            if changed < error:
                best, error = other, changed
        if self.mirrored:  # of motions that have not settled, the mirror is not exact
            other = replace(best, mirrored=[])
            if polynomial_error(places, values, seed, other.of(columns, *marks)) < error:
                return other
        return best


def grown(part: FloatArray, soft: float) -> FloatArray:
    """The envelope over one factor: 0 at 0 and 1 at 1, in proportion to small values, and with less slope above."""
    return part * (1 + soft) / (part + soft)


def known_structure(columns: Mapping[str, Column], cube: xr.Dataset) -> KnownStructure:
    """Zeros and symmetries of the outputs of a cube over these factors.

    Args:
        columns: Values of the factors at the points, shape (point,) each.
        cube: Their cube. Its outputs name the factors that make them zero or mirror them; a mirror counts only where
            every factor of it varies or is fixed at zero.
    """
    attrs = [variable.attrs for variable in cube.data_vars.values()]
    numbers = {name: column.astype(float) for name, column in columns.items() if is_numeric(column)}
    zeros = {
        name: (float(np.abs(numbers[name]).max()), _ALWAYS)
        for name in dict.fromkeys(name for each in attrs for name in str(each.get(ZERO_AT, "")).split())
        if name in numbers and _comes_near_zero(numbers[name])
    }
    fixed = json.loads(str(cube.attrs.get("fixed_parameters", "{}")))
    mirror = list(dict.fromkeys(name for each in attrs for name in str(each.get(MIRRORED_BY, "")).split()))
    varied = [name for name in mirror if name in numbers and np.ptp(numbers[name]) > 0]
    if any(fixed.get(name, np.nan) != 0 for name in mirror if name not in varied):
        varied = []
    inputs = []
    for each in inputs_of(columns):
        size = max(abs(each.low), abs(each.high))
        inputs.append(Input(each.factor, -size, size) if each.factor in varied else each)
        if each.factor in zeros and each.low < 0 < each.high:
            inputs.append(Input(each.factor, sign=True))
    return KnownStructure(zeros, varied, inputs)


def _comes_near_zero(numbers: FloatArray) -> bool:
    """Whether zero is in the range of a factor, or as good as at its end."""
    low, high = float(numbers.min()), float(numbers.max())
    margin = _NEAR * (high - low)
    return high > low and low - margin <= 0 <= high + margin
