"""Sentences about the models of some points: the verdict, their known errors, and the ranges that points leave."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface.known_error import NOTABLE_ERROR, Departure, ModelErrors, ValidRange
from tripod_doe.model_interface.verdict import VerdictCount
from tripod_doe.number_text import count_of, number

_REASONS = 2
"""Reasons for an unknown error that a sentence lists with their counts."""


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


@dataclass
class _Left:
    """A range that some of the points counted so far leave."""

    range: ValidRange
    points: int = 0
    values: tuple[float, float] = (np.inf, -np.inf)

    def add(self, departure: Departure) -> None:
        """Count the points outside."""
        self.points += departure.values.size
        self.values = _widened(self.values, departure.values)

    @property
    def ends(self) -> str:
        """The smallest and the largest value outside."""
        return " to ".join(dict.fromkeys(number(end, digits=2) for end in self.values))


def _widened(ends: tuple[float, float], values: FloatArray) -> tuple[float, float]:
    """Widen a range so that it holds some values."""
    low, high = ends
    return float(values.min(initial=low)), float(values.max(initial=high))


class ModelSummary:
    """The models of many points, counted block by block for the sentences about them, in constant memory.

    Args:
        which: A phrase for the points, which follows the name of a model in a sentence.
    """

    def __init__(self, which: str = "") -> None:
        self._which = f" {which}" * bool(which)
        self._verdicts = VerdictCount()
        self._of = "", ""
        self._errors: dict[str, _KnownErrors] = {}
        self._left: dict[str, dict[str, _Left]] = {}  # ranges that points leave, by model and reason

    def add(self, errors: ModelErrors, numerical: FloatArray | None = None) -> NDArray[np.int8]:
        """Add some points: known errors of their models, and ranges that they leave; return the `Trust` of each.

        Args:
            numerical: Relative numerical error of the same quantity, shape (point,); NaN or None where it is not known.
        """
        self._of = errors.quantity, errors.reference
        for model in dict.fromkeys(errors.models):
            self._errors.setdefault(model, _KnownErrors()).add(errors, errors.models == model)
        for departure in errors.departures:
            if departure.values.size:
                left = self._left.setdefault(departure.model, {}).setdefault(departure.reason, _Left(departure.left))
                left.add(departure)
        return self._verdicts.add(errors, numerical)

    def add_checks(self, models: NDArray[np.object_], prices: Mapping[str, float]) -> None:
        """Count the models that doubtful points can be checked with; see `Simulator.surer_models`."""
        self._verdicts.checks.update(name for name in models.tolist() if name)
        self._verdicts.unchecked |= None in models.tolist()
        self._verdicts.prices |= prices

    @property
    def models(self) -> list[str]:
        """Names of the models in the order of their first points."""
        return list(self._errors)

    @property
    def texts(self) -> list[str]:
        """All sentences: the verdict first, then the errors, then the ranges."""
        return [*self.verdict_texts, *self.error_texts, *self.departure_texts]

    @property
    def verdict_texts(self) -> list[str]:
        """Trust in the points, in one sentence; none without points."""
        return self._verdicts.sentences(self._which)

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
                f"typical error of the {quantity} {_percents(*known.expected)} relative to "
                f"model {reference} (90th percentile {_percents(*known.limit)}), from similar points"
            )
            if known.above:
                share = _share(known.above, known.count)
                yield f"above {_percents(NOTABLE_ERROR, NOTABLE_ERROR)}{share}: use a finer model"
        if known.reasons:
            share = _share(known.count - known.known, known.count)
            said = self._verdicts.main_reason
            reasons = [(reason, count) for reason, count in known.reasons.most_common() if reason != said]
            yield f"error not known{share}" + (f": {_in_words(reasons)}" if reasons else "")

    @property
    def departure_texts(self) -> list[str]:
        """One sentence per model with the ranges that points leave; the main reason of a verdict first."""
        sentences = []
        for model, left in self._left.items():
            count = self._errors[model].count
            order = sorted(left, key=lambda reason: (-self._verdicts.points_by(reason), -left[reason].points))
            first, *others = (left[reason] for reason in order)
            where = _share(first.points, count) or (" here" if count == 1 else f" at all {count:,} points")
            text = f"{first.range.left_by(first.ends)}; {first.range.reason}"
            more = "".join(
                f"; also {each.range.quantity} = {each.ends}{f' at {_points(each.points)}' * (count > 1)}, "
                f"valid {each.range.ends}"
                for each in others
            )
            sentences.append(f"Model {model}{self._which} is outside its valid range{where}: {text}{more}.")
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
