"""The verdict on results: one rule of errors and ranges, stated with its main reason and counts that add up."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tripod_doe.model_interface import Departure, ModelErrors, ModelSummary, Trust, ValidRange
from tripod_doe.model_interface.simulator import model_notes
from tripod_doe.model_interface.verdict import LARGE_ERROR, VerdictCount, verdicts
from tripod_doe.study.definition.simulators import load_simulator


def errors(random, count):
    """Errors of a random block, some of them unknown, some of the finest model, some outside of a range."""
    models = random.choice(np.array(["coarse", "fine"], object), count)
    expected = np.where(random.random(count) < 0.2, np.nan, random.choice([0.0, 0.01, 0.05, 0.06], count))
    expected[models == "fine"] = np.nan
    limit = expected * random.choice([1.0, 3.0, 10.0], count)
    outside = (random.random(count) < 0.2) & (models == "coarse")
    left = Departure("coarse", ValidRange("ratio", "why", high=1), outside, np.full(outside.sum(), 2.0))
    return ModelErrors("third order", "fine", models, expected, limit, np.full(count, "", object), [left])


def expected_trust(expected, limit, outside, model, numerical):
    """The rule, point by point."""
    if outside or numerical > 0.05:
        return Trust.DOUBTFUL
    if model == "fine":
        return Trust.SURE
    if not expected <= 0.05 or not limit <= LARGE_ERROR:
        return Trust.DOUBTFUL
    return Trust.SURE if limit <= 0.05 else Trust.USABLE


@pytest.mark.parametrize("seed", range(20))
def test_the_rule_holds_point_by_point_and_the_sentence_counts_them(seed):
    """Exact by its meaning, at random errors."""
    random = np.random.default_rng(seed)
    blocks = [errors(random, random.integers(1, 40)) for _ in range(3)]
    told, summary = VerdictCount(), ModelSummary()
    trust = []
    for block in blocks:
        numerical = random.choice([np.nan, 0.0, 0.04, 0.06], block.expected.size)
        rows = zip(block.expected, block.limit, block.departures[0].outside, block.models, numerical, strict=True)
        wanted = [expected_trust(*row) for row in rows]
        assert told.add(block, numerical).tolist() == wanted
        assert summary.add(block, numerical).tolist() == wanted
        trust += wanted
    (sentence,) = told.sentences()
    assert summary.texts[0] == sentence
    assert summary.texts[1].startswith("Model ")
    for each in set(trust):
        count = trust.count(each)
        assert f"{each.label} at {count}" in sentence or f"{each.label} at all {count} points" in sentence
    worst = max(trust)
    asked = "check it" if trust.count(worst) == 1 else "check some of these"
    assert (asked in sentence) == (worst is Trust.DOUBTFUL)
    assert "since" in sentence


def test_a_reason_is_that_of_the_worst_points():
    """Regression: a verdict without its reason says nothing to a reader."""
    models, known = np.full(3, "coarse", object), np.array([0.01, 0.01, 0.3])
    block = ModelErrors("third order", "fine", models, known, known * 2, np.full(3, "", object))
    told = VerdictCount()
    told.add(block)
    (sentence,) = told.sentences(" with all mechanisms on")
    assert sentence == (
        "Verdict on the third order: sure at 2, doubtful at 1 of 3 points with all mechanisms on; doubtful since half "
        'of the similar points were off by more than 5 %; check it with model = "fine".'
    )
    assert not VerdictCount().sentences()
    assert re.match("its value is known exactly", verdicts(block).reasons[7])


def test_a_doubtful_verdict_names_the_cheapest_sure_model_and_its_price():
    """Regression: it named the finest model, where one of a tenth of the price was sure."""
    simulator = load_simulator("joint")
    columns = simulator.columns({"torque_n_m": 50.0}, {"joint_angle_deg": np.array([1.0, 8.0, 30.0])}, 3)
    trust = verdicts(simulator.model_errors(columns)).trust
    models, prices = simulator.surer_models(columns, {}, trust)
    assert models.tolist() == ["rollers", "", "needles"]
    assert prices == {model: simulator.recorded_price({"model": model}) for model in ("rollers", "needles")}
    for model in ("rollers", "needles"):  # it is sure, and no cheaper finer one is
        chosen = models == model
        finer = simulator.model_errors(
            {name: column[chosen] for name, column in columns.items()} | {"model": models[chosen]}
        )
        assert (verdicts(finer).trust == Trust.SURE).all()
    sentence, *_ = model_notes(simulator, {name: column[:1] for name, column in columns.items()}, {})
    usual = f"typically {1e3 * prices['rollers']:.0f} ms of CPU time"
    assert sentence.endswith(f'; check it with model = "rollers" (sure there, {usual}).')
    sentence, *_ = model_notes(simulator, columns, {})
    assert 'check some of these with model = "' in sentence
    assert "(sure at 1 of them, typically " in sentence
    same = {name: np.repeat(column[:1], 2) for name, column in columns.items()}
    sentence, *_ = model_notes(simulator, same, {})
    assert f'check some of these with model = "rollers" (sure at all of them, {usual}' in sentence
    larger = {"pitch_radius_mm": 25.5, "roller_radius_mm": 18.5, "groove_sliding_friction": 0.055, "torque_n_m": 40.0}
    columns = simulator.columns(larger, {"joint_angle_deg": np.array([12.7])}, 1)
    sentence, *_ = model_notes(simulator, columns, {"vibrates": np.ones(1)})
    assert "the joint vibrates by itself" in sentence
    assert sentence.endswith("(sure there).")  # such a run costs ten times a usual one, and more


def test_several_reasons_make_one_verdict_with_the_weightiest_first():
    """Regression: a line for each range that points leave, whose first was not that of the verdict."""
    models, unknown = np.full(4, "coarse", object), np.full(4, "", object)
    left = [
        Departure("coarse", ValidRange("crown", "it tilts", high=0), np.array([True, False, True, True]), np.ones(3)),
        Departure(
            "coarse", ValidRange("swing", "it swings", high=3), np.array([True, True, False, False]), np.full(2, 4.0)
        ),
        Departure(
            "coarse", ValidRange("needle", "it holds", high=0.5), np.ones(4, bool), np.array([1.0, 0.6, 1.0, 1.0])
        ),
    ]
    summary = ModelSummary()
    summary.add(ModelErrors("third order", "fine", models, np.full(4, 0.01), np.full(4, 0.01), unknown, left))
    verdict, _, ranges = summary.texts
    assert "mostly since model coarse is valid only for needle up to 0.5 (3 points)" in verdict
    assert ranges == (
        "Model coarse is outside its valid range at all 4 points: needle = 0.6 to 1, valid up to 0.5; it holds; "
        "also swing = 4 at 2 points, valid up to 3; also crown = 1 at 3 points, valid up to 0."
    )


def test_a_joint_that_vibrates_has_one_reason():
    """Regression: the verdict's reason was repeated behind "error not known", and as a share of similar joints."""
    simulator = load_simulator("joint")
    given = {"groove_sliding_friction": np.full(2, 0.15), "joint_angle_deg": np.full(2, 12.0)}
    points = simulator.columns({}, given, 2)
    outside = [each.outside for each in simulator.model_errors(points).departures if "share" in each.left.quantity]
    assert np.all(outside)
    verdict, error, *ranges = model_notes(simulator, points, {"vibrates": np.ones(2)})
    assert "since the joint vibrates by itself" in verdict
    assert error == "Model kinetostatic: error not known."
    assert not any("share" in each for each in ranges)


def test_a_run_with_a_large_numerical_error_is_sent_to_the_finest_model():
    simulator = load_simulator("joint")
    columns = simulator.columns({}, {"joint_angle_deg": np.array([10.0])}, 1)
    outputs = {"thrust_amplitude": np.full((1, 13), 10.0), "thrust_amplitude_error": np.full((1, 13), 2.0)}
    sentence, *_ = model_notes(simulator, columns, outputs)
    assert sentence.endswith('above 5 %; check it with model = "needles".')


def test_a_verdict_does_not_contradict_the_reason_of_an_unknown_error():
    """Regression: "no similar points were compared", beside "for most of the similar points ... did not finish"."""
    models, unknown = (
        np.array(["coarse"], object),
        np.array(["for most of the similar points one did not finish"], object),
    )
    summary = ModelSummary()
    summary.add(ModelErrors("third order", "fine", models, np.array([np.nan]), np.array([np.nan]), unknown))
    assert "doubtful, since the error of its model is not known there; check it" in summary.texts[0]
    assert "no similar" not in " ".join(summary.texts)


@pytest.mark.parametrize(
    "given", [{"torque_n_m": 0.0}, {"torque_n_m": 0.0, "model": "equilibrium", "needle_crown_um": 3.0}]
)
def test_without_torque_nothing_is_known_exactly(given):
    """Exact physics: inertia presses rollers into their grooves, too; 3,000 rpm and 0.05 N m give 8 N in `rollers`."""
    simulator = load_simulator("joint")
    columns = simulator.columns(given, {"joint_angle_deg": np.array([10.0, 0.0])}, 2)
    errors = simulator.model_errors(columns)
    assert verdicts(errors).trust.tolist() == [Trust.DOUBTFUL, Trust.SURE]
    assert np.isnan(errors.expected[0])
    assert "inertia_ratio" in errors.unknown[0]


@pytest.mark.parametrize("given", [{"torque_n_m": 0.0}, {"settled_needles": 1.0, "joint_angle_deg": 30.0}])
def test_no_model_is_advised_that_refuses_the_point(given):
    """Regression: "check it with model needles (sure there)", which ended as not_applicable."""
    simulator = load_simulator("joint")
    sentence, *_ = model_notes(simulator, simulator.columns(given, {}, 1), {})
    assert sentence.endswith("since the error of its model is not known there.")
