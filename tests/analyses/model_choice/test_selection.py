"""Choice of model: from pilots whose errors are known to the choice that is right, and how sure it is."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.analyses.model_choice.pilot_errors import pilot_errors
from tripod_doe.analyses.model_choice.selection import choose, without_pilot
from tripod_doe.model_interface import Candidate
from tripod_doe.study.definition.accuracy_table import Accuracy, AutoModel, Quantity

CANDIDATES = (
    Candidate({"model": "cheap"}, 1e-6, 10),
    Candidate({"model": "middle"}, 1e-3, 10),
    Candidate({"model": "full"}, 1.0, 10, full=True),
)


def auto(allowed=0.03, confidence=0.9, floor=0.01, candidates=CANDIDATES):
    return AutoModel(Accuracy((Quantity("a_3", "a", 3, allowed),), floor), confidence, None, candidates)


def pilot(x, misses, numerical=0.0, outcome=None, evaluations=None):
    """A cube of candidates at points x: order 3 is 10 N, off by `misses` (candidate, point) of that; order 1 is 100 N."""
    misses = np.asarray(misses, float)
    candidate, point = (index.ravel() for index in np.indices(misses.shape))
    orders = np.stack(
        [
            np.full(candidate.size, 500.0),
            np.full(candidate.size, 100.0),
            np.zeros(candidate.size),
            10 * (1 + misses.ravel()),
        ],
        1,
    )
    variables = {
        "a": (("point", "order"), orders),
        "a_error": (("point", "order"), np.full(orders.shape, 10 * numerical)),
        "outcome": (
            "point",
            np.zeros(candidate.size, np.int8) if outcome is None else np.ravel(outcome).astype(np.int8),
        ),
    }
    if evaluations is not None:
        variables["force_evaluations"] = ("point", np.ravel(evaluations).astype(float))
    labels = np.array([CANDIDATES[i].values["model"] for i in candidate], dtype=object)
    coords = {"x": ("point", np.asarray(x, float)[point]), "model": ("point", labels), "order": np.arange(4)}
    return xr.Dataset(variables, coords)


X = np.linspace(0, 1, 9)


def models_at(choice):
    return choice["model"].values.astype(str).tolist()


def test_the_cheapest_candidate_that_is_enough_is_taken_at_every_point():
    """Cheap is off by 1 % on the left and 8 % on the right, middle by 1 % everywhere."""
    found = pilot_errors(pilot(X, [np.where(X > 0.55, 0.08, 0.01), 0 * X + 0.01, 0 * X]), ["x"], auto())
    choice = choose(found, {"x": np.array([0.1, 0.3, 0.45, 0.7, 0.9])}, auto())
    assert models_at(choice) == ["cheap", "cheap", "cheap", "middle", "middle"]
    error = choice["error_estimate"].values[:, 0]
    assert error[4] == pytest.approx(0.01)  # the same everywhere: nothing is left to predict
    assert 0.01 < error[0] < 0.011  # and what the jump far away adds
    assert choice["accuracy_met"].values.tolist() == [1] * 5


def test_a_tighter_accuracy_takes_finer_candidates():
    cube = pilot(X, [0 * X + 0.02, 0 * X + 0.01, 0 * X])
    taken = []
    for allowed in (0.03, 0.015, 0.005):
        asked = auto(allowed)
        taken += models_at(choose(pilot_errors(cube, ["x"], asked), {"x": np.array([0.4])}, asked))
    assert taken == ["cheap", "middle", "full"]


def test_candidates_that_cannot_be_predicted_are_not_trusted():
    """Every second point of the cheap candidate is wrong: its neighbours, left out in turn, predict nothing."""
    found = pilot_errors(pilot(X, [np.where(np.arange(9) % 2, 0.05, 0.001), 0 * X + 0.01, 0 * X]), ["x"], auto())
    choice = choose(found, {"x": X}, auto())
    missed = [m == "cheap" for m in np.array(models_at(choice))[1::2]]
    assert not any(missed)
    assert choice.attrs["misses"] == 0


def test_too_few_pilot_points_for_the_confidence_leave_the_reference():
    found = pilot_errors(pilot(X, [0 * X, 0 * X, 0 * X]), ["x"], auto(confidence=0.95))
    assert set(models_at(choose(found, {"x": X}, auto(confidence=0.95)))) == {"full"}
    assert auto(confidence=0.95).least_points == 19
    assert auto(confidence=0.9).least_points == 9


@pytest.mark.slow
def test_the_stated_share_of_points_is_met_on_random_errors():
    """200 studies with smooth random errors, pilots drawn at random like their points: the theorem's own conditions."""
    random, met = np.random.default_rng(1), []
    for _ in range(200):
        places, new = random.random(20), random.random(50)
        wave, turn = random.uniform(1, 12), random.uniform(0, 6)

        def miss(x, wave=wave, turn=turn):
            return 0.03 * (1 + np.sin(wave * x + turn))

        found = pilot_errors(pilot(places, [miss(places), 0 * places + 0.029, 0 * places]), ["x"], auto())
        choice = choose(found, {"x": new}, auto())
        error = np.where(choice["candidate"].values == 0, miss(new), 0.0)
        met.append((error <= 0.03).mean())
    assert np.mean(met) >= 0.9 - 2 * np.std(met) / np.sqrt(len(met))
    assert np.mean(met) < 1  # else the limit would be stricter than it says


def test_the_numerical_error_of_the_reference_counts():
    """3 % allowed: 2.7 % and 2.4 % numerical, half of which is a deviation, are 2.95 % together; with 2.8 % 3.04 %."""
    for numerical, model in ((0.024, "cheap"), (0.028, "full")):
        found = pilot_errors(pilot(X, [0 * X + 0.027, 0 * X + 0.027, 0 * X], numerical), ["x"], auto())
        choice = choose(found, {"x": np.array([0.5])}, auto())
        assert models_at(choice) == [model]


@pytest.mark.parametrize(("middle", "taken"), [(0.03, "middle"), (0.05, "full")])
def test_where_not_even_the_reference_is_enough_a_candidate_as_good_does_as_well(middle, taken):
    """The full model is known to 4 % where 3 % are asked for: with 3 % more it is 3.6 %, with 5 % 5.4 %."""
    found = pilot_errors(pilot(X, [0 * X + 0.06, 0 * X + middle, 0 * X], 0.04), ["x"], auto())
    choice = choose(found, {"x": np.array([0.5])}, auto())
    assert (models_at(choice), int(choice["accuracy_met"][0])) == ([taken], 0)
    assert choice.attrs["misses"] == 0
    few = choose(found, {"x": np.array([0.5])}, auto(confidence=0.95))
    assert models_at(few) == ["full"]  # too few pilot points for that: nothing is trusted


def test_a_small_order_is_measured_against_a_share_of_the_largest():
    """10 N beside 100 N: 0.3 N off are 3 % of it, but 0.75 % of 40 N."""
    cube = pilot(X, [0 * X + 0.03, 0 * X, 0 * X])
    error = {floor: float(pilot_errors(cube, ["x"], auto(floor=floor)).errors[0, 0, 0] * 0.03) for floor in (0.01, 0.4)}
    assert error == pytest.approx({0.01: 0.03, 0.4: 0.0075})


def test_where_there_is_no_force_at_all_every_candidate_is_right():
    """Regression: without sliding friction 0 N for 0 N counted as hopeless, and spoiled a study of contributions."""
    cube = pilot(X, [0 * X + 0.01, 0 * X, 0 * X])
    cube["a"][cube["x"].values > 0.5] = 0.0
    found = pilot_errors(cube, ["x"], auto())
    assert np.isfinite(found.errors).all()
    choice = choose(found, {"x": np.array([0.1, 0.9])}, auto())
    assert (models_at(choice), choice["accuracy_met"].values.tolist()) == (["cheap", "cheap"], [1, 1])
    cube["a"][(cube["x"].values > 0.5) & (cube["model"].values == "cheap")] = 1.0
    found = pilot_errors(cube, ["x"], auto())
    assert models_at(choose(found, {"x": np.array([0.1, 0.9])}, auto()))[1] == "middle"


def test_a_candidate_that_fails_somewhere_is_not_taken_there():
    outcome = np.zeros((3, 9))
    outcome[0, 6:] = td.Outcome.DIVERGED
    found = pilot_errors(pilot(X, [0 * X, 0 * X + 0.01, 0 * X], outcome=outcome), ["x"], auto())
    assert models_at(choose(found, {"x": np.array([0.1, 0.9])}, auto())) == ["cheap", "middle"]


def test_prices_are_counted_work_times_recorded_seconds():
    found = pilot_errors(pilot(X, np.zeros((3, 9)), evaluations=np.full((3, 9), 20)), ["x"], auto())
    np.testing.assert_allclose(found.prices, [20e-6, 20e-3, 20.0])
    choice = choose(found, {"x": X}, auto())
    assert choice.attrs["price_pilot_s"] == pytest.approx(9 * 20.02002)
    assert choice.attrs["price_study_s"] == pytest.approx(9 * 20e-6)


def test_the_choice_does_not_depend_on_the_other_points_or_on_timing():
    cube = pilot(X, [np.where(X > 0.55, 0.08, 0.01), 0 * X + 0.01, 0 * X])
    found = pilot_errors(cube, ["x"], auto())
    whole = choose(found, {"x": X}, auto())
    single = [models_at(choose(found, {"x": X[i : i + 1]}, auto()))[0] for i in range(9)]
    assert models_at(whole) == single
    timed = cube.assign(cpu_seconds=("point", np.random.default_rng(0).random(27)))
    assert models_at(choose(pilot_errors(timed, ["x"], auto()), {"x": X}, auto())) == single


def test_what_all_pilot_runs_share_is_read_from_its_attributes():
    cube = pilot(X, np.zeros((3, 9))).assign_attrs(fixed_parameters=json.dumps({"y": 3.0}))
    assert pilot_errors(cube, ["x", "y"], auto()).columns["y"].tolist() == [3.0] * 9
    with pytest.raises(td.InputError, match="the pilot has no z"):
        pilot_errors(cube, ["x", "z"], auto())


def test_a_pilot_that_cannot_serve_is_refused():
    cube = pilot(X, np.zeros((3, 9)))
    with pytest.raises(td.InputError, match="fewer than two candidates"):
        pilot_errors(cube.isel(point=slice(0, 9)), ["x"], auto())
    with pytest.raises(td.InputError, match="no output b"):
        pilot_errors(cube, ["x"], AutoModel(Accuracy((Quantity("b_3", "b", 3, 0.1),), 0.01), 0.9, None, CANDIDATES))
    with pytest.raises(td.InputError, match="a goes from 0 to 3"):
        pilot_errors(cube, ["x"], AutoModel(Accuracy((Quantity("a_7", "a", 7, 0.1),), 0.01), 0.9, None, CANDIDATES))
    failed = pilot(X, np.zeros((3, 9)), outcome=np.repeat([[0], [0], [1]], 9, axis=1))
    with pytest.raises(td.InputError, match="finished at no point"):
        pilot_errors(failed, ["x"], auto())


def test_without_a_pilot_all_points_run_the_full_model_and_nothing_is_promised():
    choice = without_pilot({"x": X[:3]}, auto())
    assert models_at(choice) == ["full"] * 3
    assert choice["accuracy_met"].values.tolist() == [-1] * 3
