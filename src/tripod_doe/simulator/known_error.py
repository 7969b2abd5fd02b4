"""Known errors of the models and the ranges in which the models hold, as every answer states them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.quantities import count_of, number

NOTABLE_ERROR = 0.05
"""Relative error of a model above which an answer is flagged."""

_REASONS = 2
"""Reasons for an unknown error that a sentence lists with their counts."""


@dataclass(frozen=True)
class ModelErrors:
    """Relative errors of the models at some points; numerical errors are not part of them."""

    quantity: str  # the quantity with the errors, for instance ``third order``
    reference: str  # the model that the others are compared with
    models: NDArray[np.object_]  # the model of every point, shape (point,)
    # median error at points like each that finer models computed, shape (point,); NaN where it is not known
    expected: FloatArray
    limit: FloatArray  # 90th percentile of the error at those points, shape (point,)
    unknown: NDArray[np.object_]  # why the error is not known, shape (point,); empty where it is
    departures: Sequence[Departure] = ()  # the ranges in which these models hold, each with the points that leave it

    def of(self, rows: NDArray[np.bool_]) -> ModelErrors:
        """The errors at some of the points."""
        departures = [
            replace(each, outside=each.outside[rows], values=each.values[rows[each.outside]])
            for each in self.departures
        ]
        return replace(
            self,
            models=self.models[rows],
            expected=self.expected[rows],
            limit=self.limit[rows],
            unknown=self.unknown[rows],
            departures=departures,
        )


@dataclass(frozen=True)
class ValidRange:
    """A range outside which a model does not hold."""

    quantity: str  # a parameter, or a ratio that follows from several
    reason: str  # the neglected effect that matters beyond it
    # low, high: ends of the range; they belong to it
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""  # of the quantity, for people; empty without dimension
    meaning: str = ""  # definition of the quantity, where its name does not say it

    @property
    def text(self) -> str:
        """The range in words: ``swing_ratio (its definition) up to 0.2``."""
        name = f"{self.quantity} ({self.meaning})" if self.meaning else self.quantity
        unit = f" {self.unit}" if self.unit else ""
        if np.isinf(self.high):
            return f"{name} from {self.low:g}{unit}"
        return (
            f"{name} up to {self.high:g}{unit}"
            if np.isinf(self.low)
            else (f"{name} from {self.low:g} to {self.high:g}{unit}")
        )


@dataclass(frozen=True)
class Departure:
    """Points that leave a range of their model."""

    model: str  # name of the model
    left: ValidRange  # the range
    outside: NDArray[np.bool_]  # which points leave it, shape (point,)
    values: FloatArray  # its quantity at these points, shape (points outside,)


@dataclass
class _KnownErrors:
    """Sums over the points of one model counted so far, for the sentence about its error."""

    count: int = 0
    known: int = 0
    above: int = 0
    expected: tuple[float, float] = (np.inf, -np.inf)
    limit: tuple[float, float] = (np.inf, -np.inf)
    reasons: Counter[str] = field(default_factory=Counter)

    def add(self, errors: ModelErrors, own: NDArray[np.bool_]) -> None:
        """Count some points; `own` marks the points of the model."""
        known = own & np.isfinite(errors.expected)
        self.count += int(own.sum())
        self.known += int(known.sum())
        self.above += int((errors.expected[known] > NOTABLE_ERROR).sum())
        self.expected = _widened(self.expected, errors.expected[known])
        self.limit = _widened(self.limit, errors.limit[known])
        self.reasons.update(errors.unknown[own & ~known].tolist())


def _widened(ends: tuple[float, float], values: FloatArray) -> tuple[float, float]:
    """Widen a range so that it holds some values."""
    low, high = ends
    return float(values.min(initial=low)), float(values.max(initial=high))


class ModelSummary:
    """The models of many points, counted block by block for the sentences about them, in constant memory.

    Parameters
    ----------
    which
        A phrase for the points, which follows the name of a model in a sentence.
    """

    def __init__(self, which: str = "") -> None:
        self._which = f" {which}" * bool(which)
        self._of = "", ""
        self._errors: dict[str, _KnownErrors] = {}
        self._outside: Counter[tuple[str, ValidRange]] = Counter()
        self._values: dict[tuple[str, ValidRange], tuple[float, float]] = {}

    def add(self, errors: ModelErrors) -> None:
        """Add some points: known errors of their models, and ranges that they leave."""
        self._of = errors.quantity, errors.reference
        for model in dict.fromkeys(errors.models):
            self._errors.setdefault(model, _KnownErrors()).add(errors, errors.models == model)
        for departure in errors.departures:
            key = departure.model, departure.left
            self._outside[key] += int(departure.outside.sum())
            self._values[key] = _widened(self._values.get(key, (np.inf, -np.inf)), departure.values)

    @property
    def models(self) -> list[str]:
        """Names of the models in the order of their first points."""
        return list(self._errors)

    @property
    def error_texts(self) -> list[str]:
        """One sentence per model: its name, the known error at such points, and its spread."""
        return [
            f"Model {model}{self._which}: {'; '.join(self._parts(known))}." for model, known in self._errors.items()
        ]

    def _parts(self, known: _KnownErrors) -> Iterator[str]:
        """The sentence of one model, part by part."""
        quantity, reference = self._of
        if known.known:
            yield (
                f"typical error of the {quantity} {_percents(*known.expected)} against "
                f"{reference} (90th percentile {_percents(*known.limit)}), from similar points"
            )
            if known.above:
                share = _share(known.above, known.count)
                yield f"above {_percents(NOTABLE_ERROR, NOTABLE_ERROR)}{share}: use a finer model"
        if known.reasons:
            share = _share(known.count - known.known, known.count)
            yield f"error not known{share}: {_in_words(known.reasons.most_common())}"

    @property
    def departure_texts(self) -> list[str]:
        """One sentence per range that points leave."""
        sentences = []
        for (model, left), outside in self._outside.items():
            count = self._errors[model].count
            if outside:
                where = _share(outside, count) or (" here" if count == 1 else f" at all {count:,} points")
                ends = " to ".join(dict.fromkeys(number(end, digits=2) for end in self._values[model, left]))
                text = f"{left.text}, {'here' if count == 1 else 'there'} {ends}"
                sentences.append(f"Model {model}{self._which} is outside its range{where}: {text}; {left.reason}.")
        return sentences


def _in_words(reasons: list[tuple[str, int]]) -> str:
    """The most common reasons with their counts; the others as a number and an example."""
    (first, _), *others = reasons
    if not others:
        return first
    named, rest = (reasons, []) if len(reasons) == _REASONS + 1 else (reasons[:_REASONS], reasons[_REASONS:])
    phrases = [f"{reason} ({_points(some)})" for reason, some in named]
    if rest:
        phrases.append(f"other reasons ({_points(sum(some for _, some in rest))}), most often {rest[0][0]}")
    return "; ".join(phrases)


def _points(some: int) -> str:
    return count_of(some, "point")


def _share(some: int, count: int) -> str:
    """The end of a phrase about some points, `` at 3 of 52 points (5.8 %)``; empty for all points."""
    return "" if some == count else f" at {some:,} of {count:,} points ({number(100 * some / count, digits=2)} %)"


def _percents(low: float, high: float) -> str:
    """A range of relative errors in percent, two digits; one number where its ends are equal."""
    ends = dict.fromkeys(number(100 * end, digits=2) for end in (low, high))
    return f"{' to '.join(ends)} %"
