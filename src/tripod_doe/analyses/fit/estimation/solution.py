"""The solution of a fit: minima from several starts, records that do not fit, profiles, verdicts, the model asked for.

The search runs on the cheapest model that knows the unknowns. Where a finer one is asked for, its difference from the
cheap one at the minimum is added to the cheap model, and the minimum is looked for again, until it stays: so the finer
model is computed at a few minima only.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, t

from tripod_doe.analyses.fit.estimation.error_size import ErrorSize, estimate_error_size
from tripod_doe.analyses.fit.estimation.exploration import explore, first_places, interpolated
from tripod_doe.analyses.fit.estimation.identifiability import FOUND, Combination, combinations, covariance_of, verdict
from tripod_doe.analyses.fit.estimation.least_squares import Descent, Predict, Problem, distinct, is_same
from tripod_doe.analyses.fit.estimation.misfit import Misfit, Rows
from tripod_doe.analyses.fit.estimation.profile_likelihood import BetterMinimum, Profile, profile, slid, smallest_gain
from tripod_doe.analyses.fit.estimation.unknowns import Layout
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.errors import InputError

CONFIDENCE = 0.95
"""Level of all intervals of a fit."""

_HUBER = 0.99  # probability of a larger chi squared from which on a record counts less in the first search
_BAD = 1e-4  # probability of a larger chi squared, by chance, below which a record is left out
_FEWEST = 4  # records from which on one can be judged by the others
_LOOKS = 16  # descents on the interpolated model
_WEIGHINGS = 2  # by the errors of the model at the minimum so far
_REACH = 30.0  # of chi squared, where an interval ends at 3.84: what new weights may gain, and some more
_RESTARTS = 6  # from better minima
_ALONG = (0.25, 0.5, 0.75)  # of the way between two minima: a wall between them is looked for
_BENT = 0.25  # of that way: farther to the side, another valley begins
_INSIDE = 0.02  # of an interval: another one that ends so little beyond it, by derivatives, is inside
_CORRECTIONS = 5  # of the cheap model by the one asked for
_STAYS = 0.1  # of the standard deviation: a minimum that moves less by a correction stays


@dataclass(frozen=True)
class Skews:
    """Which needles a fit is of, where both were looked at: such that turn or such that keep their skew."""

    stay: bool  # whether its values are of needles that keep their skew
    lead: float  # twice the logarithm of the odds of these needles against the others
    other: FloatArray | None  # places of the scalars with the other needles; None where these are too unlikely
    turned: float = 0.0  # how far the model's needles turn in a record, at most, root mean square over trunnions, deg


@dataclass(frozen=True)
class Solution:
    """Result of a fit, on the unit cube of its scalars."""

    problem: Problem  # the last one: without bad records, with the corrected model
    best: Descent  # its minimum, with derivatives
    jacobian: FloatArray  # whitened, shape (residual, scalar)
    covariance: FloatArray  # of the scalars, scatter included, shape (scalar, scalar)
    scatter: float  # chi squared over degrees of freedom, at least 1
    freedom: int  # degrees of freedom
    error_size: ErrorSize  # of the model's errors, over those on record
    allowed: float  # growth of chi squared at the ends of the intervals
    profiles: tuple[Profile, ...]  # one a scalar
    verdicts: tuple[str, ...]  # one a scalar
    combinations: tuple[Combination, ...]  # known combinations of scalars that are not known one by one
    bad: NDArray[np.bool_]  # records left out as they do not fit the others, shape (record,)
    others: tuple[Descent, ...]  # further minima within the interval
    corrections: int  # how often the model asked for was computed at a minimum
    at_rest: bool  # whether the minimum came to rest by these
    skews: Skews | None = None  # None where only needles that turn were looked at


def solve(
    layout: Layout,
    rows: Rows,
    predict: Predict,
    *,
    finer: Predict | None = None,
    starts: int = 3,
    seed: int = 0,
    robust: bool = True,
    weigh: Callable[[Descent], Rows] | None = None,
    alike: Callable[[FloatArray], list[FloatArray]] = lambda place: [],
    same: Callable[[FloatArray], list[FloatArray]] = lambda place: [],
    sized: bool = False,
    tell: Callable[[str], None] = lambda stage: None,
) -> Solution:
    """Fit the scalars of a layout to measured orders.

    Args:
        finer: The model asked for where `predict` is a cheaper one.
        starts, seed: Descents, and the seed of the places that they begin at.
        robust: Whether records that do not fit the others are left out.
        weigh: Gives the rows with the errors of the model at a minimum.
        alike: Gives places that may fit nearly as well as a minimum, from which the search begins, too.
        same: Gives places that are the same joint as a minimum, so that no record tells them apart whatever the model
            says there; intervals reach over them.
        sized: Whether the size of these errors is estimated.
        tell: Takes the name of each stage as it begins.

    Raises:
        InputError: If no starting place has an answer for all records.
    """
    used = np.ones(rows.records, bool)
    misfit = Misfit(rows, used, layout.priors())
    per_record = max(round(misfit.data / rows.records), 1)
    judged = robust and rows.records >= _FEWEST
    loss = float(chi2.ppf(_HUBER, per_record)) if judged else np.inf
    problem = Problem(layout, misfit, predict, loss)
    tell("initial scan of the whole range")
    places = first_places(layout, seed)
    answers = predict(places[:, layout.owner])
    failed = int((~np.isfinite(answers).all(axis=1)).sum())
    between = interpolated(layout, places, answers)
    if between is None:
        begins = problem.minima(starts, seed)
    else:
        losses = dict.fromkeys((np.inf, loss))
        looks = [Problem(layout, each, between, most) for most in losses for each in misfit.of_each_sign()]
        begins = explore(looks, _LOOKS, starts, seed)
    tell("search")
    descents = distinct([problem.descend(each) for each in _starting_states(problem, begins)[:starts]])
    if not descents:
        raise InputError(f"none of {failed} starting points has an answer for all records; narrow the ranges")
    bad = _bad_records(problem, descents[0], per_record) if judged else ~used
    size = ErrorSize()
    for weighing in range(_WEIGHINGS):
        rows = rows if weigh is None else weigh(descents[0])
        if judged and weighing:  # again, as the first weights were not yet of this minimum
            every = Misfit(rows.with_errors_times(size.of(rows.order)), used, layout.priors())
            bad = _bad_records(Problem(layout, every, predict), descents[0], per_record)
        if sized:
            size = estimate_error_size(rows, ~bad, layout.priors(), descents[0])
        own = rows.with_errors_times(size.of(rows.order))
        plain = Problem(layout, Misfit(own, ~bad, layout.priors()), predict)
        again = [replace(each, cost=plain.cost(each.prediction, each.place)) for each in descents]
        looks = [Problem(layout, each, between or predict) for each in plain.misfit.of_each_sign()]
        if weighing == 0 and between is not None and (weigh is not None or sized):
            # of the first weights the minimum near the hidden values may be none
            again = distinct([*again, *_starting_states(plain, explore(looks, _LOOKS, starts, seed))])
        for look in looks:
            best = _starting_states(look, again)[0].place
            begins = [state for place in alike(best) if (state := look.begin(place))]
            again = distinct([*again, *_starting_states(plain, [look.descend(each) for each in begins])])
        descents = distinct([plain.descend(each) for each in _within_reach(again, plain.misfit.data)])
    corrections, at_rest = 0, True
    if finer is not None:
        tell("refinement")
        plain, descents, corrections, at_rest = _corrected(plain, descents, predict, finer)
    fitted = _with_profiles(plain, descents, bad, size, same, tell)
    return replace(fitted, corrections=corrections, at_rest=at_rest)


def _starting_states(problem: Problem, descents: list[Descent]) -> list[Descent]:
    """States of a problem at places where another one has minima, the best first; without those where a point fails."""
    states = [problem.begin(each.place) for each in descents]
    return sorted((each for each in states if each is not None), key=lambda each: each.cost)


def _within_reach(descents: list[Descent], data: int) -> list[Descent]:
    """Those that may still become the best minimum, or reach into an interval, when all go down once more."""
    least = min(each.cost for each in descents)
    return [each for each in descents if each.cost - least <= _REACH * max(1.0, least / data)]


def _bad_records(problem: Problem, best: Descent, per_record: int) -> NDArray[np.bool_]:
    """Records whose chi squared is far above the others; at most a third of all."""
    own = problem.compare(best.prediction, best.place).chi2
    usual = max(float(np.median(own)) / float(chi2.median(per_record)), 1.0)
    bad = own > usual * float(chi2.isf(_BAD, per_record))
    worst = np.argsort(-own)[: own.size // 3]
    kept = np.zeros(own.size, bool)
    kept[worst] = True
    return np.asarray(bad & kept)


def _corrected(
    problem: Problem, descents: list[Descent], cheap: Predict, finer: Predict
) -> tuple[Problem, list[Descent], int, bool]:
    """The problem with the cheap model corrected at its minimum, its minimum, and whether that converged."""
    best, count, rests = descents[0], 0, False
    for _ in range(_CORRECTIONS):
        offset = np.nan_to_num(finer(best.place[None])[0] - cheap(best.place[None])[0])
        count += 1
        problem = Problem(problem.layout, problem.misfit, _shifted(cheap, offset))
        moved = problem.begin(best.place)
        if moved is None:
            break
        moved = problem.descend(moved)
        jacobian = problem.misfit.jacobian(problem.compare(moved.prediction, moved.place), moved.slope)
        deviation = np.sqrt(np.diag(covariance_of(jacobian)))
        still = np.abs(moved.place - best.place) <= _STAYS * np.minimum(deviation, 1.0)
        best, rests = moved, bool(still.all())
        if rests:
            break
    return problem, [best], count, rests


def _shifted(predict: Predict, offset: ComplexArray) -> Predict:
    def shifted(places: FloatArray) -> ComplexArray:
        return np.asarray(predict(places) + offset, complex)

    return shifted


def _with_profiles(
    problem: Problem,
    descents: list[Descent],
    bad: NDArray[np.bool_],
    size: ErrorSize,
    same: Callable[[FloatArray], list[FloatArray]],
    tell: Callable[[str], None],
) -> Solution:
    """Intervals and verdicts at the best minimum, again from a better one where a profile comes upon it."""
    for left in range(_RESTARTS, -1, -1):
        descents, twins = _with_same_joint(problem, descents, same)
        best = replace(descents[0], slope=problem.slopes(descents[0].place, descents[0].prediction))
        compared = problem.compare(best.prediction, best.place)
        jacobian = problem.misfit.jacobian(compared, best.slope)
        freedom = problem.misfit.data + problem.misfit.expected - problem.misfit.free - problem.layout.count
        scatter = max(best.cost / freedom, 1.0) if freedom > 0 else 1.0
        # deviations that explain the scatter are known but for the size of the model's errors
        known = min(size.freedom, freedom if scatter > 1 else np.inf)
        factor = float(t.ppf((1 + CONFIDENCE) / 2, known))
        allowed = factor**2 * scatter
        covariance = covariance_of(jacobian)
        try:
            profiles = []
            for scalar in range(problem.layout.count):
                tell(f"profile {scalar + 1} of {problem.layout.count}")
                profiles.append(profile(problem, best, scalar, allowed, covariance))
            break
        except BetterMinimum as better:
            if not left:
                raise
            tell("a better minimum")
            descents = distinct([problem.descend(better.descent), *descents])
    # growth that other minima leave; all at those of the same joint, whose chi squared differs by the model's error
    growth_left = [allowed - max(each.cost - best.cost, 0.0) for each in descents[1:]]
    others = [(each, left) for each, left in zip(descents[1:], growth_left, strict=True) if left > 0]
    apart = [(each, left) for each, left in others if all(each is not twin for twin in twins)]
    apart = [(each, left) for each, left in apart if not _is_along(problem, best, each, profiles, allowed)]
    others = [*((each, allowed) for each in twins), *apart]
    profiles = [_with_other_minima(problem, own, others) for own in profiles]
    solution = Solution(
        problem,
        best,
        jacobian,
        covariance * scatter,
        scatter,
        freedom,
        size,
        allowed,
        (),
        (),
        (),
        bad,
        tuple(other for other, _ in others),
        0,
        True,
    )
    return with_verdicts(solution, tuple(profiles), [other.place for other, _ in others])


def with_verdicts(solution: Solution, profiles: tuple[Profile, ...], others: list[FloatArray]) -> Solution:
    """A solution with its profiles, and what follows from them.

    Args:
        others: Places of further minima over which these profiles reach.
    """
    jacobian, allowed, layout = solution.jacobian, solution.allowed, solution.problem.layout
    verdicts = tuple(verdict(own, jacobian, allowed) for own in profiles)
    unclear = [scalar for scalar, word in enumerate(verdicts) if word != FOUND]
    known = combinations(layout, jacobian, [solution.best.place, *others], unclear, allowed)
    return replace(solution, profiles=profiles, verdicts=verdicts, combinations=tuple(known))


def _with_same_joint(
    problem: Problem, descents: list[Descent], same: Callable[[FloatArray], list[FloatArray]]
) -> tuple[list[Descent], list[Descent]]:
    """Minima with those of the same joint as the best one, and the latter alone."""
    for _ in range(_RESTARTS):
        states = [state for place in same(descents[0].place) if (state := problem.begin(place))]
        own, before = [problem.descend(state) for state in states], descents[0]
        descents = distinct([*descents, *own])
        if descents[0] is before:
            break
    return descents, [each for each in descents[1:] if any(is_same(each, twin) for twin in own)]


def _is_along(problem: Problem, best: Descent, other: Descent, profiles: list[Profile], allowed: float) -> bool:
    """Whether another place is no minimum of its own: it lies within all intervals, in one valley with the minimum.

    A descent ends anywhere along a valley whose floor is flat, as where the records say nothing of an unknown.
    """
    inside = [own.low <= place <= own.high for own, place in zip(profiles, other.place.tolist(), strict=True)]
    way = other.place - best.place
    free = np.arange(way.size) != np.argmax(np.abs(way))
    most = max(best.cost, other.cost) + smallest_gain(allowed)
    for part in _ALONG if all(inside) else ():
        floor = slid(problem, best, best.place + part * way, free)
        if floor is None or floor.cost > most:
            return False
        if np.abs(floor.place - best.place - part * way).max() > _BENT * np.abs(way).max():
            return False
    return all(inside)


def _with_other_minima(problem: Problem, own: Profile, others: list[tuple[Descent, float]]) -> Profile:
    """A profile whose interval reaches over further minima, by the growth of chi squared that each may have."""
    for other, left in others:
        place = float(other.place[own.scalar])
        jacobian = problem.misfit.jacobian(problem.compare(other.prediction, other.place), other.slope)
        covariance = covariance_of(jacobian)
        half = float(np.sqrt(left * covariance[own.scalar, own.scalar]))
        margin = _INSIDE * (own.high - own.low)
        if own.low - margin <= max(place - half, 0.0) and min(place + half, 1.0) <= own.high + margin:
            continue
        try:
            beyond = profile(problem, other, own.scalar, max(left, 0.01), covariance)
        except BetterMinimum:
            continue
        if beyond.low < own.low:
            own = replace(own, low=beyond.low, open_low=beyond.open_low)
        if beyond.high > own.high:
            own = replace(own, high=beyond.high, open_high=beyond.open_high)
    return own
