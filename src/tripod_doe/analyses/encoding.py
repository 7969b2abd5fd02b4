"""Encoding of factors: numbers scaled to a range, words as indicator columns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray

Column = NDArray[Any]
"""Values of one factor at some points, shape (point,): numbers or words."""


@dataclass(frozen=True)
class Input:
    """One encoded column: a number scaled from its range, the sign of a number, or the indicator of a word."""

    factor: str
    low: float = 0.0
    high: float = 0.0
    word: str | None = None
    sign: bool = False


def is_numeric(column: Column) -> bool:
    """Whether a factor has numbers, else words."""
    return column.dtype.kind in "biuf"


def scaled(numbers: Column, low: float, high: float) -> FloatArray:
    """Numbers from -1 at `low` to 1 at `high`; 0 where both are the same."""
    return np.asarray((2 * numbers - low - high) / (high - low) if high > low else np.zeros(numbers.size), float)


def as_numbers(column: Column) -> FloatArray:
    """Numbers as they are, words by their place in alphabetical order."""
    return column.astype(float) if is_numeric(column) else np.unique(column, return_inverse=True)[1].astype(float)


def inputs_of(columns: Mapping[str, Column], every_word: bool = False) -> list[Input]:
    """Encoded columns of factors: one for a number; one for each word, but not for the first unless `every_word`."""
    inputs = []
    for name, column in columns.items():
        if is_numeric(column):
            inputs.append(Input(name, float(column.min()), float(column.max())))
        else:
            words = sorted({str(word) for word in column})
            inputs += [Input(name, word=word) for word in words[0 if every_word else 1 :]]
    return inputs


def encoded(
    columns: Mapping[str, Column], inputs: list[Input], scale: Callable[[Column, float, float], FloatArray] = scaled
) -> FloatArray:
    """Points as encoded columns, shape (point, input); numbers from -1 to 1, or by another scale."""

    def column(each: Input) -> FloatArray:
        if each.word is not None:
            return np.asarray(columns[each.factor].astype(str) == each.word, float)
        if each.sign:
            return np.asarray(np.sign(columns[each.factor].astype(float)))
        return scale(columns[each.factor], each.low, each.high)

    parts = [column(each) for each in inputs]
    return np.stack(parts, axis=1) if parts else np.zeros((1, 0))


def _unit(numbers: Column, low: float, high: float) -> FloatArray:
    """Numbers from 0 at `low` to 1 at `high`; 0 where both are the same."""
    return np.asarray((numbers - low) / (high - low) if high > low else np.zeros(numbers.size), float)


def in_unit_cube(columns: Mapping[str, Column], over: Mapping[str, Column]) -> FloatArray:
    """Points as places in the unit cube that other points span, shape (point, coordinate); a coordinate per word."""
    return encoded(columns, inputs_of(over, every_word=True), _unit)
