"""Minima of the first search that go on, and those that do not, when the model's errors are known better."""

from dataclasses import replace

import numpy as np
import pytest
from fit_problems import model_of, one_record, real_rows

from tripod_doe.analyses.fit.estimation.identifiability import combinations
from tripod_doe.analyses.fit.estimation.solution import _with_other_minima, solve
from tripod_doe.analyses.fit.estimation.unknowns import Unknown, make_layout

MINIMA = 0.25, 0.75
FIRM = 1e-3  # deviation of a row that both minima explain


@pytest.fixture
def two_minima():
    """Rows of which the first holds the unknown to either minimum, the second votes for one, the third for the other."""
    layout = one_record([(0, 1)])

    def rows(second, third):
        return replace(real_rows(np.array([0.0, MINIMA[1], MINIMA[0]]), FIRM), along=np.array([FIRM, second, third]))

    def predict(b):
        return np.hstack([(b - MINIMA[0]) * (b - MINIMA[1]), b, b])

    return layout, rows, model_of(layout, predict)


def cost_between(second, third):
    """Chi squared of the minimum that the third row votes for, above that of the other."""
    return ((MINIMA[1] - MINIMA[0]) ** 2) * (second**-2 - third**-2)


def test_a_minimum_within_reach_becomes_the_best_by_new_weights(two_minima):  # exact
    layout, rows, model = two_minima
    assert 10 < cost_between(0.1, 0.14) < 30
    weights, stages = iter([rows(0.1, 0.14), rows(0.5, 0.14)]), []
    solution = solve(layout, rows(0.1, 0.14), model, weigh=lambda best: next(weights), tell=stages.append)
    assert float(solution.best.place[0]) == pytest.approx(MINIMA[0], abs=0.01)
    assert "a better minimum" not in stages  # no profile had to come upon it


def test_a_minimum_far_above_the_best_is_not_followed(two_minima):  # exact
    layout, rows, model = two_minima
    assert cost_between(0.01, 0.1) > 1000
    asked, weighed = [], []

    def counted(places):
        asked.extend(places[:, 0].tolist())
        return model(places)

    def weigh(best):
        weighed.append(len(asked))
        return rows(0.01, 0.1)

    solution = solve(layout, rows(0.01, 0.1), counted, weigh=weigh)
    near = np.abs(np.array(asked) - MINIMA[0]) < 0.05
    assert near[: weighed[0]].any()  # the search has seen it
    assert near[weighed[0] :].sum() <= 1  # a look with the new weights, and no descent
    assert float(solution.best.place[0]) == pytest.approx(MINIMA[1], abs=0.01)
    assert not solution.others


def test_new_weights_are_searched_for_other_minima(two_minima):  # exact
    layout, rows, model = two_minima
    solution = solve(layout, rows(0.01, 0.1), model, starts=1, weigh=lambda best: rows(0.5, 0.01))
    assert float(solution.best.place[0]) == pytest.approx(MINIMA[0], abs=0.01)


def test_the_search_begins_at_places_that_look_alike_too(two_minima):  # exact
    layout, rows, model = two_minima
    assert not solve(layout, rows(0.5, 0.5), model, starts=1).others
    solution = solve(layout, rows(0.5, 0.5), model, starts=1, alike=lambda place: [1 - place])
    assert [float(other.place[0]) for other in solution.others] == pytest.approx(
        [1 - float(solution.best.place[0])], abs=0.01
    )
    low, high = solution.profiles[0].low, solution.profiles[0].high
    assert low < MINIMA[0]
    assert MINIMA[1] < high


def test_a_combination_reaches_over_further_minima():
    """Exact: a sum of which records say that it is 0.7 at one minimum and 0.85 at the other, each +- 0.196."""
    layout, jacobian = one_record([(0, 1), (0, 1)]), np.array([[10.0, 10.0]])
    places = [np.array([0.3, 0.4]), np.array([0.35, 0.5])]
    alone = combinations(layout, jacobian, places[:1], [0, 1], 3.84)[0]
    both = combinations(layout, jacobian, places, [0, 1], 3.84)[0]
    half = np.sqrt(3.84) / 10
    assert (alone.value, alone.half) == pytest.approx((0.7, half))
    assert (both.value, both.half) == pytest.approx((0.775, half + 0.075))


@pytest.mark.parametrize(("deviation", "left_out"), [(0.02, 0), pytest.param(0.005, 1, marks=pytest.mark.slow)])
def test_a_record_is_judged_again_with_the_weights_of_the_minimum(deviation, left_out):
    """Exact: six records of one number, one of them 0.04 off: 8 deviations of the first weights, 2 of the later ones."""
    layout = make_layout([Unknown("b", 0, 1)], list("abcdef"), [[""] * 6])
    first = real_rows(np.array([0.5, 0.5, 0.5, 0.5, 0.5, 0.54]), 0.005)
    first = replace(first, record=np.arange(6), free_phase=np.zeros(6, bool), free_sign=np.zeros(6, bool))
    later = replace(first, along=np.full(6, deviation))
    solution = solve(
        layout, first, lambda places: layout.values(places)[..., 0].astype(complex), weigh=lambda best: later
    )
    assert solution.bad.sum() == left_out


def test_intervals_reach_over_places_of_the_same_joint_whatever_chi_squared_says(two_minima):  # exact
    layout, rows, model = two_minima
    exact = rows(0.1, 0.14)
    assert cost_between(0.1, 0.14) > 10
    alone = solve(layout, exact, model, starts=1).profiles[0]
    assert MINIMA[0] < alone.low < MINIMA[1] < alone.high
    both = solve(layout, exact, model, starts=1, same=lambda place: [1 - place])
    assert len(both.others) == 1
    assert both.profiles[0].low < MINIMA[0] < MINIMA[1] < both.profiles[0].high
    below, above = (MINIMA[0] - both.profiles[0].low, both.profiles[0].high - MINIMA[1])
    assert below == pytest.approx(above, rel=0.1)  # as long as at the best one


def test_an_interval_reaches_to_the_end_of_another_one_that_begins_inside(two_minima):  # exact
    layout, rows, model = two_minima
    best = solve(layout, rows(0.5, 0.5), model, starts=1, alike=lambda place: [1 - place])
    own, other = best.profiles[0], best.others[0]
    place = float(other.place[0])
    reached = _with_other_minima(
        best.problem, replace(own, low=place - 1e-3, high=place + 1e-3), [(other, best.allowed)]
    )
    assert 0.003 < place - reached.low < 0.005
    assert 0.003 < reached.high - place < 0.005


def test_places_along_a_flat_valley_are_no_minima_of_their_own():
    """Regression: each was named as a further minimum, and followed with profiles of its own: four times the points."""
    layout, asked = one_record([(0, 1), (0, 1)]), []

    def predict(places):
        asked.append(len(places))
        return model_of(layout, lambda b: b[:, :1] + 0.3 * (b[:, 1:] - 0.2) ** 2)(places)

    solution = solve(layout, real_rows(np.array([0.5]), 0.01), predict)
    assert not solution.others
    low, high = solution.profiles[0].low, solution.profiles[0].high
    assert (low, high) == pytest.approx((0.5 - 0.3 * 0.8**2 - 0.02, 0.52), abs=0.004)
    assert sum(asked) < 200
