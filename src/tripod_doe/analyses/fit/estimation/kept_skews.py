"""Needles that keep their initial skew against needles that turn: which of both the records support.

Needles of `kinetostatic` turn while the joint does, as those of `needles` do; those of `rollers` keep their skew. A
joint may do either, and fitted skews differ by half between both, more than the errors on record. So both are
fitted, and compared by the likelihood of what they leave over (Patterson and Thompson 1971). One that is less likely by
more than 1 to 20 is left; else intervals reach over both.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.fit.estimation.error_size import estimate_error_size, improbability
from tripod_doe.analyses.fit.estimation.exploration import first_places, interpolated
from tripod_doe.analyses.fit.estimation.least_squares import Descent, Predict, Problem, distinct
from tripod_doe.analyses.fit.estimation.misfit import Misfit, Rows
from tripod_doe.analyses.fit.estimation.profile_likelihood import Profile
from tripod_doe.analyses.fit.estimation.solution import Skews, Solution, with_verdicts
from tripod_doe.analyses.fit.model_error import Needles, second_of_skews
from tripod_doe.array_types import ComplexArray, FloatArray

UNLIKELY = float(2 * np.log(20))
"""Twice the logarithm of the odds above which the less likely of both is rejected."""

_WEIGHINGS = 2


def with_initial_skews(orders: ComplexArray, needles: Needles, initial: FloatArray) -> tuple[ComplexArray, Needles]:
    """What a model would say of needles that keep their skew: a second order in proportion to the skews at the start.

    What a groove gives beyond its skew comes from needles that turn within a revolution. Compared with `rollers`, this
    second order errs by 5 % in the median, with that rest by 9 % (282 points, benchmarks/RESULTS.md).

    Args:
        orders: Orders 0 to 12, shape (point, order).
        initial: Skews at the start, deg, shape (point, groove).
    """
    second = second_of_skews(needles, initial)
    own = orders.copy()
    own[:, 2] = second.sum(axis=1)
    return own, Needles(second, initial)


def improbability_of(solution: Solution, used: NDArray[np.bool_] | None = None) -> float:
    """Minus twice the logarithm of the restricted likelihood of a fit, but for a constant.

    Args:
        used: Which records count, shape (record,); by default those that it used.
    """
    misfit = solution.problem.misfit
    if used is not None:
        misfit = Misfit(misfit.rows, used, solution.problem.layout.priors())
    return improbability(misfit, solution.best, solution.error_size)


def first_look(
    solution: Solution,
    predict: Predict,
    weigh: Callable[[Descent], Rows],
    alike: Callable[[FloatArray], list[FloatArray]],
    seed: int,
) -> float:
    """Improbability of other needles near the minimum of a fit, by their interpolated model, which costs few points.

    Args:
        solution: The fit.
        predict, weigh, alike, seed: See `solve`; of the other needles.

    Returns:
        Infinity where too few points have an answer.
    """
    layout = solution.problem.layout
    places = first_places(layout, seed)
    between = interpolated(layout, places, predict(places[:, layout.owner]))
    if between is None:
        return np.inf
    used, priors, size = solution.problem.misfit.used, layout.priors(), solution.error_size
    problem = Problem(layout, solution.problem.misfit, between)
    begins = [solution.best.place, *alike(solution.best.place)]
    for _ in range(_WEIGHINGS):
        states = [problem.begin(place) for place in begins]
        best = distinct([problem.descend(state) for state in states if state is not None])[0]
        best = replace(best, slope=problem.slopes(best.place, best.prediction))
        rows = weigh(best)
        size = estimate_error_size(rows, used, priors, best)
        problem = Problem(layout, Misfit(rows.with_errors_times(size.of(rows.order)), used, priors), between)
        begins = [best.place]
    return improbability(problem.misfit, best, size)


def joined(turning: Solution, staying: Solution, turned: float = 0.0) -> Solution:
    """The likelier of two fits; its intervals reach over the other one where that may be the right one, too.

    Args:
        turning, staying: Fits with needles that turn, and with such that keep their skew.
        turned: See `Skews`.
    """
    used = ~(turning.bad | staying.bad)
    lead = improbability_of(staying, used) - improbability_of(turning, used)
    own, other = (staying, turning) if lead < 0 else (turning, staying)
    if abs(lead) > UNLIKELY:
        return replace(own, skews=Skews(lead < 0, abs(lead), None, turned))
    profiles = tuple(_over_both(*both) for both in zip(own.profiles, other.profiles, strict=True))
    minima = [each.place for each in (*own.others, other.best, *other.others)]
    return replace(with_verdicts(own, profiles, minima), skews=Skews(lead < 0, abs(lead), other.best.place, turned))


def _over_both(own: Profile, other: Profile) -> Profile:
    return replace(
        own,
        low=min(own.low, other.low),
        high=max(own.high, other.high),
        open_low=own.open_low or other.open_low,
        open_high=own.open_high or other.open_high,
    )
