"""What is known beforehand of the error that models make, and where they hold: told with every answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.quantities import number

__all__ = ["NOTABLE_ERROR", "Departure", "ModelErrors", "ValidRange", "departure_texts", "model_error_texts"]

FloatArray = NDArray[np.float64]

NOTABLE_ERROR = 0.05
"""Relative error of a model above which an answer is flagged."""

_REASONS = 2
"""Reasons for an unknown error that a sentence names."""


@dataclass(frozen=True)
class ModelErrors:
    """Relative errors of the models of some points, without those of their numerics.

    Attributes
    ----------
    quantity
        What they are errors of, for instance ``third order``.
    reference
        The model that the others are compared with.
    models
        The model of every point, shape (point,).
    expected
        Median error at points like each that finer models computed, shape (point,); NaN where it is not known.
    limit
        90th percentile of the error at those points, shape (point,).
    unknown
        Why the error is not known, shape (point,); empty where it is.
    """

    quantity: str
    reference: str
    models: NDArray[np.object_]
    expected: FloatArray
    limit: FloatArray
    unknown: NDArray[np.object_]

    @classmethod
    def joined(cls, parts: Sequence[ModelErrors]) -> ModelErrors:
        """The errors of several blocks of points, one after the other."""
        return replace(
            parts[0],
            models=np.concatenate([part.models for part in parts]),
            expected=np.concatenate([part.expected for part in parts]),
            limit=np.concatenate([part.limit for part in parts]),
            unknown=np.concatenate([part.unknown for part in parts]),
        )


@dataclass(frozen=True)
class ValidRange:
    """A range outside which a model does not hold.

    Attributes
    ----------
    quantity
        A parameter, or a ratio that follows from several.
    reason
        What the model leaves out that counts beyond.
    low, high
        Ends of the range; they belong to it.
    unit
        Of the quantity, as people write it; empty without dimension.
    meaning
        What the quantity is, where its name does not say it.
    """

    quantity: str
    reason: str
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""
    meaning: str = ""

    @property
    def text(self) -> str:
        """The range in words: ``swing_ratio (what it is) up to 0.2``."""
        name = f"{self.quantity} ({self.meaning})" if self.meaning else self.quantity
        unit = f" {self.unit}" if self.unit else ""
        if np.isinf(self.high):
            return f"{name} from {self.low:g}{unit}"
        return f"{name} up to {self.high:g}{unit}" if np.isinf(self.low) else (
            f"{name} from {self.low:g} to {self.high:g}{unit}"
        )  # fmt: skip


@dataclass(frozen=True)
class Departure:
    """Points that leave a range of their model.

    Attributes
    ----------
    model
        Name of the model.
    left
        The range.
    outside
        Which points leave it, shape (point,).
    """

    model: str
    left: ValidRange
    outside: NDArray[np.bool_]


def departure_texts(departures: Sequence[Departure], models: NDArray[np.object_]) -> list[str]:
    """One sentence per range that points leave.

    Parameters
    ----------
    departures
        What points leave.
    models
        The model of every point, shape (point,).
    """
    told = []
    for departure in departures:
        outside, count = int(departure.outside.sum()), int((models == departure.model).sum())
        if outside:
            where = _share(outside, count) or (" here" if count == 1 else f" at all {count:,} points")
            told.append(
                f"Model {departure.model} is outside its range{where}: {departure.left.text}; {departure.left.reason}."
            )
    return told


def model_error_texts(errors: ModelErrors) -> list[str]:
    """One sentence per model of some points: its name, the error that is known for such points, and its spread."""
    return [
        f"Model {model}: {'; '.join(_parts(errors, errors.models == model))}." for model in dict.fromkeys(errors.models)
    ]


def _parts(errors: ModelErrors, own: NDArray[np.bool_]) -> Iterator[str]:
    """The sentence of one model, part by part; `own` are its points."""
    count, known = int(own.sum()), own & np.isfinite(errors.expected)
    if known.any():
        expected, limit = errors.expected[known], errors.limit[known]
        yield (
            f"typical error of the {errors.quantity} {_percents(expected.min(), expected.max())} against "
            f"{errors.reference} (90th percentile {_percents(limit.min(), limit.max())}), from similar points"
        )
        if above := int((expected > NOTABLE_ERROR).sum()):
            yield f"above {_percents(NOTABLE_ERROR, NOTABLE_ERROR)}{_share(above, count)}: use a finer model"
    reasons = Counter(errors.unknown[own & ~known]).most_common()
    if reasons:
        yield f"error not known{_share(sum(some for _, some in reasons), count)}: {_in_words(reasons)}"


def _in_words(reasons: list[tuple[str, int]]) -> str:
    """The two commonest reasons, each with its count where there are several."""
    (first, _), *others = reasons
    if not others:
        return first
    told = [f"{reason} ({some:,} points)" for reason, some in reasons[:_REASONS]]
    if left := sum(some for _, some in reasons[_REASONS:]):
        told.append(f"other reasons ({left:,} points)")
    return "; ".join(told).replace("(1 points)", "(1 point)")


def _share(some: int, count: int) -> str:
    """The end of a phrase that holds at some points, `` at 3 of 52 points (5.8 %)``; empty where it holds at all."""
    return "" if some == count else f" at {some:,} of {count:,} points ({number(100 * some / count, digits=2)} %)"


def _percents(low: float, high: float) -> str:
    """A range of relative errors in percent, two digits; one number where its ends look alike."""
    ends = dict.fromkeys(number(100 * end, digits=2) for end in (low, high))
    return f"{' to '.join(ends)} %"
