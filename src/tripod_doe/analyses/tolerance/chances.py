"""Chances to exceed a limit, with intervals, of points weighted as if their factors scattered otherwise.

The interval belongs to a weighted sum of rare events (gamma distribution, Fay and Feuer 1997), with the mean weight of
a point in place of the largest for one event more (Tiwari and others 2006). Where the values have an error, its
lower end counts the points that exceed in spite of it, its upper end those that may.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray

_MOST_DOUBLINGS = 10
_NORMAL = 1.96  # half width of an interval of 95 % over its standard deviation
_SURE = 1.645  # deviations that nineteen of twenty runs do not exceed to one side


@dataclass(frozen=True)
class Exceeding:
    """Which points exceed the limit of each component, 1 or 0, shape (point, component)."""

    computed: FloatArray  # by the values as they are
    surely: FloatArray  # even if the values are too large by their error
    possibly: FloatArray  # if they are too small by it

    def of(self, components: NDArray[np.bool_]) -> Exceeding:
        """Some components alone."""
        return Exceeding(self.computed[:, components], self.surely[:, components], self.possibly[:, components])


@dataclass(frozen=True)
class Chance:
    """Chances with the ends of their intervals, shape (..., component)."""

    low: FloatArray
    value: FloatArray
    high: FloatArray

    def ends(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lower end, value and upper end."""
        return self.low, self.value, self.high


def density_ratio(other: FloatArray, own: FloatArray) -> FloatArray:
    """Weights of points: their density by another distribution over their own, shape as `other`.

    A point without a density, as one at the end of a triangular distribution, has no weight.
    """
    return np.divide(other, own, out=np.zeros(np.broadcast_shapes(other.shape, own.shape)), where=own > 0)


def exceeding(values: FloatArray, limit: FloatArray, error: FloatArray) -> Exceeding:
    """Which points exceed a limit.

    Args:
        values, error: Shape (point, component); the error in the unit of the value, 0 where none is known.
        limit: Shape (component,); no point exceeds NaN.
    """
    above = (values > limit, values - error > limit, values + error > limit)
    return Exceeding(*(each.astype(float) for each in above))


@dataclass(frozen=True)
class WeightedChances:
    """What an interval of weighted chances needs, shape (..., component) each; `one` is shape (..., 1)."""

    computed: FloatArray  # chances by the values as they are
    surely: tuple[FloatArray, FloatArray]  # chances, and their variance
    possibly: tuple[FloatArray, FloatArray]
    one: FloatArray  # mean weight of a point

    def interval(self, confidence: float, times: int = 1) -> Chance:
        """The chances with their interval, for a given multiple of the number of points."""
        from scipy.special import gammaincinv  # imported where it is used: every study would wait for it

        outside = (1 - confidence) / 2
        (low, low_variance), (high, high_variance) = self.surely, self.possibly
        one = self.one / times
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = low_variance / times / low
            lower = np.where(low > 0, unit * gammaincinv(low / unit, outside), 0.0)
            unit = (high_variance / times + one**2) / (high + one)
            upper = np.minimum(unit * gammaincinv((high + one) / unit, 1 - outside), 1.0)
        return Chance(lower, self.computed, upper)


def weighted_chances(weights: FloatArray, points: Exceeding) -> WeightedChances:
    """Chances to exceed, of weighted points.

    Args:
        weights: Shape (..., point), NaN where a factor has no scatter.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = weights / weights.sum(axis=-1, keepdims=True)
    squares = shares**2
    return WeightedChances(
        shares @ points.computed,
        (shares @ points.surely, squares @ points.surely),
        (shares @ points.possibly, squares @ points.possibly),
        squares.sum(axis=-1, keepdims=True),
    )


def points_to_resolve(chances: WeightedChances, allowed: float, confidence: float) -> FloatArray:
    """How many times as many points resolve that one of some chances is small enough, shape (component,).

    Twice as many as the chances by these points ask for, which are not those of the next run: a run with fewer often
    asks for more. Infinite where a thousand times as many do not. 1 where these points do.

    Args:
        chances: Shape (way, component).
    """
    answers = np.full(chances.computed.shape[-1], np.inf)
    for times in 2 ** np.arange(_MOST_DOUBLINGS, 0, -1):
        enough = (chances.interval(confidence, int(times)).high <= allowed).any(axis=0)
        answers = np.where(enough, 2.0 * times, answers)
    return np.where((chances.interval(confidence).high <= allowed).any(axis=0), 1.0, answers)


def points_to_decide(chance: float, allowed: float, least: int) -> int | None:
    """Points, `least` times a power of two, that decide whether a chance is above or below the allowed one.

    They do in nineteen of twenty runs, if the chance is the true one (Wilson's interval of 95 %). None where a thousand
    times as many do not.
    """
    for doublings in range(_MOST_DOUBLINGS + 1):
        points = least * 2**doublings
        scatter = math.sqrt(chance * (1 - chance) / points)
        # the count of such a run that is nearest to what is allowed, a half more for whole numbers
        worst = chance + math.copysign(_SURE * scatter + 0.5 / points, allowed - chance)
        half = _NORMAL * math.sqrt(max(worst * (1 - worst), 0.0) / points + (_NORMAL / (2 * points)) ** 2)
        middle, norm = worst + _NORMAL**2 / (2 * points), 1 + _NORMAL**2 / points
        if (
            (middle + half <= allowed * norm)
            if chance < allowed
            else (worst > allowed and middle - half > allowed * norm)
        ):
            return points
    return None
