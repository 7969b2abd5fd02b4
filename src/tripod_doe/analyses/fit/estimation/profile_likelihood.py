"""Intervals from profile likelihoods: how far an unknown can go while all others make up for it as well as they can.

A 95 % interval ends where chi squared has grown by the square of Student's factor, times the scatter about the fit
where that is larger than expected. Each step along a profile starts from the farthest one within the interval, with its
derivatives: from beyond it, others may not find back from a bound. A bound or a failing model that comes before that
leaves the interval open. Where chi squared falls below the minimum, the search was not over: it goes on from there, and
all profiles begin again.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.fit.estimation.least_squares import Descent, Problem
from tripod_doe.array_types import FloatArray

_STEPS = 12  # along a profile
_NEAR = 0.05  # of the root of the allowed growth: from so near, a straight line leads to the end of a profile
_BETTER = 0.2  # of chi squared, from which on a lower place is another minimum, where the usual growth is allowed
_USUAL = 3.84
_LEAST = 1e-4  # of a range: a shorter way to a bound is none
_FTOL = 1e-3
_STEEP = 5.0  # times the goal: a larger root of growth says nothing about the way there
_LARGEST = 3.0  # times the last distance: the longest step


class BetterMinimum(Exception):  # noqa: N818 - no error: the search goes on from here
    """A place with a smaller chi squared than the minimum."""

    def __init__(self, descent: Descent) -> None:
        super().__init__("a better minimum")
        self.descent = descent


@dataclass(frozen=True)
class Profile:
    """Chi squared along one scalar, all others at their best."""

    scalar: int  # number of the scalar
    places: FloatArray  # of the scalar, ascending
    growth: FloatArray  # of chi squared above the minimum at these places
    # low, high: places of the ends of the interval; the bound where the interval is open
    low: float
    high: float
    # open_low, open_high: whether the data do not end it on that side
    open_low: bool
    open_high: bool
    failed: bool  # whether failing points ended it
    leans: bool  # whether an end is there only as another scalar has come to its own bound
    helped: bool  # whether all ends that are open would be closed if the other scalars stayed as they are


def profile(problem: Problem, best: Descent, scalar: int, allowed: float, covariance: FloatArray) -> Profile:
    """The profile of one scalar.

    Args:
        allowed: Growth of chi squared at the ends of the interval.
        covariance: Of the scalars at the minimum, by which the first step is guessed.

    Raises:
        BetterMinimum: If a place with a smaller chi squared comes up.
    """
    points = {float(best.place[scalar]): 0.0}
    low, high = (_interval_end(problem, best, scalar, side, allowed, covariance, points) for side in (-1.0, 1.0))
    places = np.array(sorted(points))
    growth = np.array([points[place] for place in places.tolist()])
    return Profile(
        scalar,
        places,
        growth,
        low.place,
        high.place,
        low.is_open,
        high.is_open,
        low.failed or high.failed,
        low.leans or high.leans,
        all(end.helped for end in (low, high) if end.is_open),
    )


@dataclass(frozen=True)
class _End:
    """One end of an interval."""

    place: float
    is_open: bool  # whether the data do not end it
    failed: bool = False  # whether failing points ended it
    leans: bool = False  # whether another scalar has come to its bound there
    helped: bool = False  # whether it is open only since the other scalars make up for this one


def _interval_end(
    problem: Problem,
    best: Descent,
    scalar: int,
    side: float,
    allowed: float,
    covariance: FloatArray,
    points: dict[float, float],
) -> _End:
    """One end of the interval."""
    start, goal = float(best.place[scalar]), float(np.sqrt(allowed))
    most = 1 - start if side > 0 else start
    if most < _LEAST:
        return _End(start, is_open=True)
    variance = max(float(covariance[scalar, scalar]), 1e-12)
    away = min(goal * float(np.sqrt(variance)), most)
    free = np.arange(best.place.size) != scalar
    direction = np.where(free, covariance[:, scalar] / variance, 0.0)
    inner, outer = (0.0, 0.0), (np.inf, np.inf)  # distance and root of growth, below and above the goal
    before = last = inner
    inside, here, failed = best, best, False  # the farthest state within the goal, and the last one
    for _ in range(_STEPS):
        target = inside.place + direction * side * (away - abs(float(inside.place[scalar]) - start))
        target = np.clip(np.where(free, target, start + side * away), 0.0, 1.0)
        descent = _moved(problem, inside, target, free, best.cost + allowed)
        if descent is None:
            failed, outer = True, (away, np.inf)
        else:
            if descent.cost < best.cost - smallest_gain(allowed):
                raise BetterMinimum(descent)
            growth = max(descent.cost - best.cost, 0.0)
            points[float(descent.place[scalar])] = growth
            root, here = float(np.sqrt(growth)), descent
            if root < goal and away >= most * (1 - 1e-12):
                alone = np.where(free, best.place, start + side * most)
                helped = problem.cost(problem.predict(alone[None])[0], alone) - best.cost > allowed
                return _End(start + side * most, is_open=True, helped=helped)
            if root < goal:
                inner, inside = (away, root), here
            else:
                outer = (away, root)
            if abs(root - goal) < _NEAR * goal and root > 0:
                leans = _leans(best, here, free)
                end = _extrapolated(last, (away, root), goal)
                return _End(start + side * min(end, most), is_open=end >= most, leans=leans)
            before, last = last, (away, root)
        if outer[0] - inner[0] < _LEAST:
            break
        away = _next_distance(inner, outer, goal, most, _extrapolated(before, last, goal))
    end = inner[0] if np.isinf(outer[1]) else outer[0]
    is_open = bool(np.isinf(outer[1]))
    return _End(start + side * end, is_open, failed and is_open, not is_open and _leans(best, here, free))


def smallest_gain(allowed: float) -> float:
    """Difference of chi squared from which on two places are not at one minimum."""
    return _BETTER * max(1.0, allowed / _USUAL)


def _leans(best: Descent, there: Descent, free: NDArray[np.bool_]) -> bool:
    """Whether another scalar has come to a bound on the way from the minimum to the end of a profile."""
    edge = np.minimum(there.place, 1 - there.place) < _LEAST * 10
    before = np.minimum(best.place, 1 - best.place) < _LEAST * 10
    return bool((edge & ~before & free).any())


def _extrapolated(last: tuple[float, float], here: tuple[float, float], goal: float) -> float:
    """The distance at which the root of growth reaches the goal: straight on from the last two of a profile."""
    slope = (here[1] - last[1]) / (here[0] - last[0]) if here[0] != last[0] else 0.0
    usual = max(here[1], 1e-9) / max(here[0], 1e-9)
    return here[0] + (goal - here[1]) / (slope if slope > usual / _STEEP else usual)


def _next_distance(
    inner: tuple[float, float], outer: tuple[float, float], goal: float, most: float, straight_on: float
) -> float:
    """The next place to look at: near its goal, the root of growth is nearly a straight line."""
    if np.isinf(outer[0]):
        grown = inner[0] * goal / max(inner[1], 1e-9)
        return float(min(np.clip(grown, 1.1 * inner[0], _LARGEST * inner[0]), most))
    if outer[1] > _STEEP * goal:  # or failed: no straight line
        return (inner[0] + outer[0]) / 2
    part = (straight_on - inner[0]) / (outer[0] - inner[0])
    return float(inner[0] + np.clip(part, 0.1, 0.9) * (outer[0] - inner[0]))


def _moved(
    problem: Problem, here: Descent, target: FloatArray, free: NDArray[np.bool_], enough: float
) -> Descent | None:
    """The best state with one scalar at its target, the others first moved along with it; None where points fail.

    Where that costs more than enough, it may have led them too far, or to where points fail: then they start from where
    they are.
    """
    along = slid(problem, here, target, free)
    if along is not None and along.cost <= enough:
        return along
    stayed = _at(problem, here, np.where(free, here.place, target))
    if stayed is None or (along is not None and along.cost <= stayed.cost):
        return along
    return problem.slide(stayed, free, _FTOL)


def slid(problem: Problem, here: Descent, target: FloatArray, free: NDArray[np.bool_]) -> Descent | None:
    """The best state with one scalar at its target; None where points fail there."""
    there = _at(problem, here, target)
    return None if there is None else problem.slide(there, free, _FTOL)


def _at(problem: Problem, here: Descent, target: FloatArray) -> Descent | None:
    """The state at a place, with derivatives from a state near it; None where points fail there."""
    prediction = problem.predict(target[None])[0]
    cost = problem.cost(prediction, target)
    if not np.isfinite(cost):
        return None
    slope = problem.corrected(here.slope, target - here.place, prediction - here.prediction)
    return replace(here, place=target, prediction=prediction, slope=slope, cost=cost)
