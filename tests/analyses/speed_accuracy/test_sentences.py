"""The page on speed and accuracy: sentences, table and charts hold the analysis' numbers, and every failure is drawn."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from method_rows import EXACT, FINE, FIRST, JOINT, SECOND, STEPS, adaptive, cube_of, fixed

from tripod_doe.analyses.registry import draw, findings_of
from tripod_doe.analyses.speed_accuracy.sentences import price_table
from tripod_doe.analyses.speed_accuracy.speed_accuracy import SpeedAccuracySettings, speed_accuracy
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.tables import factor_rows
from tripod_doe.workflow.workflow import load_workflow

ROOT = Path(__file__).parents[3]
WRONG = fixed("symplectic-euler", [1e-6, 1e-7], lambda h: 0, lambda h: 1e-4 / h, outcome=Outcome.INACCURATE)
SLOW = fixed("rk4", [1e-7], lambda h: 0, lambda h: 3e4, outcome=Outcome.EVALUATION_LIMIT)


@pytest.fixture(scope="module")
def roller():
    return speed_accuracy({"roller": cube_of([*FIRST, *SECOND, *EXACT, *WRONG, *SLOW])}, SpeedAccuracySettings())


@pytest.fixture(scope="module")
def joint():
    rows = []
    for model, off in (("rollers", 0.04), ("needles", 0.0)):
        rows += fixed("implicit-euler", STEPS, lambda h, off=off: off + 10 * h, lambda h: 1e-3 / h, model)
        rows += fixed("bdf2", FINE, lambda h, off=off: off + 1e4 * h**2, lambda h: 2e-3 / h, model)
    return speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())


def test_sentences_tell_the_ratio_and_the_failures(roller):
    told = " ".join(findings_of("accuracy", roller))
    assert "the default, bdf2, costs 1.41 times the cheapest, implicit-euler (bdf2" in told
    assert "Ratio to the default: explicit rk4 10,600 (extrapolated, error not known)." in told
    assert (
        "Finished in roller with an undetected error above 5 %: implicit-euler 0.01 (10 %), bdf2 0.01 (100 %)" in told
    )
    assert "Failed in roller: symplectic-euler 1e-6, 1e-7 (inaccurate: it chatters)." in told


def test_sentences_tell_what_a_cheaper_model_is_off_by(joint):
    assert joint["model"].values[0] == "rollers"
    told = findings_of("accuracy", joint.assign(is_default=("run", (joint["setting"].values == 1e-7).astype(np.int8))))
    assert any(
        sentence.startswith("Rollers at its default differs") and "4 % in the third" in sentence for sentence in told
    )


def test_the_table_has_a_row_a_case_and_method(roller):
    heads, rows = price_table(roller)
    assert all(len(row) == len(heads) for row in rows)
    by_method = {row[1]: row for row in rows}
    assert by_method["bdf2 (default)"][3:] == ["1", "interpolated", "4", "0"]
    assert by_method["symplectic-euler"][2:] == ["–", "–", "failed", "0", "2"]
    assert by_method["rk4"][4] == "price only"


def test_a_chart_holds_every_run_and_draws_failures_apart(roller):
    (chart,) = draw("speed-accuracy", {"accuracy": roller})
    table = pd.read_csv(io.StringIO(chart.csv()))
    assert len(table) == roller.sizes["run"]
    assert table["error_percent"].isna().sum() == 3
    axes = chart.figure.axes[0]
    signs = {
        line.get_marker(): line for line in axes.lines if line.get_marker() in ("X", "1") and line.get_xdata().size
    }
    assert sorted(signs["X"].get_xdata()) == pytest.approx([100, 1000])
    assert signs["1"].get_xdata() == pytest.approx([3e4])
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"inaccurate", "evaluation limit", "Pareto front", "default", "bdf2"} <= set(labels)
    assert "<svg" in chart.svg()


def test_models_have_a_chart_of_their_own(joint, roller):
    chart = draw("model-error", {"accuracy": joint.sel(quantity=["third_order"])})[0]
    labels = [text.get_text() for text in chart.figure.axes[0].get_legend().get_texts()]
    assert {"rollers", "needles"} <= set(labels)
    assert draw("model-error", {"accuracy": roller}) == []


@pytest.mark.parametrize("quick", [False, True])
def test_the_workflow_is_sound(quick):
    workflow = load_workflow(ROOT / "workflows" / "speed_accuracy.toml", quick)
    assert {"trunnion", "joint", "accuracy", "charts", "models", "page"} <= set(workflow.steps)


def test_a_study_of_many_methods_lists_them_and_passes_over_open_fields():
    methods = ["bdf2", "rk4", "rosenbrock", "implicit-euler", "symplectic-euler", "adaptive-euler", "generalized-alpha"]
    rows = [row for method in methods for row in fixed(method, [1e-4], lambda h: h, lambda h: 1.0)]
    rows += [
        ("", "rosenbrock", np.nan, tolerance, 0.0, 1.0, Outcome.FINISHED) for tolerance in np.geomspace(1e-9, 1e-2, 8)
    ]
    cube = cube_of(rows)
    for name in ("method", "step_s", "relative_tolerance"):
        cube[name].attrs["source"] = "numerics"
    told = {row.name: row.value for row in factor_rows(cube)}
    assert told["method"] == ", ".join(sorted(methods))
    assert told["step_s"] == "0.0001"
    assert told["relative_tolerance"] == "1e-9 to 0.01 (8 values)"


@pytest.mark.parametrize("seed", range(6))
def test_what_to_use_is_the_cheapest_run_within_each_error(seed):
    """Exact by its meaning, at random prices and errors: no run within the error is cheaper than the one that is named.

    The picture holds the finished runs of all models on its axes; failed ones do not stretch them.
    """
    random = np.random.default_rng(seed)
    rows = []
    for model, off in (
        ("equilibrium", random.uniform(0.02, 0.3)),
        ("rollers", 10 ** random.uniform(-4, -1.5)),
        ("needles", 0),
    ):
        price, slope = 10 ** random.uniform(-3, 1), 10 ** random.uniform(0, 2)
        for method in ("implicit-euler", "bdf2"):
            factor = random.uniform(0.3, 3)
            rows += fixed(method, FINE, lambda h: off + slope * h, lambda h: factor * price / h**0.5, model)  # noqa: B023
    rows += fixed("rk4", [1e-7], lambda h: 0, lambda h: 1e9, "needles", Outcome.EVALUATION_LIMIT)
    result = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    third = result.sel(quantity="third_order")
    told = findings_of("accuracy", result)[0]
    assert told.startswith("What to use in the joint for the third order")
    error, price = third["model_error"].values, third["cpu_per_second"].values
    known = float(third["reference_error"].values[-1])
    for target in (0.1, 0.01, 0.001):
        said = next(part for part in told.split("within ")[1:] if part.startswith(f"{100 * target:g} %"))
        within = np.isfinite(error) & (np.maximum(error, known) <= target)
        if not within.any():
            assert said.startswith(f"{100 * target:g} % none")
            continue
        best = third.isel(run=int(np.flatnonzero(within)[np.argmin(price[within])]))
        assert f"{best['model'].item()} ({best['run_method'].item()}, " in said
    (chart,) = draw("models-and-methods", {"accuracy": result})
    done = np.isfinite(error)
    for panel in chart.figure.axes:
        left, right = panel.get_xlim()
        assert left < price[done].min()
        assert price[done].max() < right < 3 * price[done].max()
        marks = [np.max(line.get_ydata()) for line in panel.lines if line.get_marker() == "x" and len(line.get_ydata())]
        assert 100 * error[done].max() < max(marks) < panel.get_ylim()[1]
        bottom = panel.get_ylim()[0]  # neither far below the reference's error nor far below the smallest that is known
        assert bottom > 0.01 * 100 * error[error > known].min()
    assert "1 evaluation limit" in chart.caption


def test_the_reference_that_errors_are_differences_to_is_the_one_that_there_is():
    """Regression: "by the difference to needles", of which one method ran alone: within 10 % "is reached by none"."""
    rows = fixed("implicit-euler", STEPS, lambda h: 10 * h, lambda h: 1e-3 / h, "rollers")
    rows += fixed("bdf2", FINE, lambda h: 1e4 * h**2, lambda h: 2e-3 / h, "rollers")
    rows += fixed("bdf2", FINE, lambda h: 0.03 + h, lambda h: 1 / h, "needles")
    result = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    first = findings_of("", result)[0]
    assert "the model's difference to rollers there: within 10 % rollers (implicit-euler, " in first


def test_no_run_is_advised_whose_numerical_error_cancels_that_of_its_model():
    """Regression: runs right to 0.1 % by chance, of models 4 and 6 % off, one of which has a single method."""
    rows = adaptive("newton", (0.1, 1e-3, 1e-6), lambda t: 0.06 - 0.59 * t, lambda t: 1e-6 / t, "equilibrium")
    for method in ("implicit-euler", "bdf2"):
        rows += fixed(method, (1e-3, 1e-7, 1e-8), lambda h: 0.04 - 39 * h, lambda h: 1e-6 / h, "rollers")
    rows += fixed("implicit-euler", STEPS, lambda h: 10 * h, lambda h: 1e-3 / h, "needles")
    rows += fixed("bdf2", FINE, lambda h: 1e4 * h**2, lambda h: 2e-3 / h, "needles")
    result = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    first = findings_of("", result)[0]
    assert "within 10 % equilibrium (newton, relative tolerance = 0.001; " in first
    assert "within 1 % needles" in first
    third = result.sel(quantity="third_order")
    for model, total in (("rollers", 0.039 / 1.04 + 0.04), ("equilibrium", 0.059 / 1.06 + 0.06)):
        coarsest = third.isel(run=int(np.flatnonzero(third["model"] == model)[0]))
        assert float(coarsest["model_error"]) == pytest.approx(0.001, rel=0.01)
        assert float(coarsest["total_error"]) == pytest.approx(total, rel=0.01)


@pytest.mark.parametrize("outcome", [Outcome.FINISHED, Outcome.DIVERGED])
def test_sentences_stand_without_peers_and_without_a_finished_run(outcome):
    """Regression: "Ratio to the default: .", and an IndexError where no run finished."""
    rows = [(*row[:6], outcome) for row in FIRST + SECOND]
    result = speed_accuracy({"scene": cube_of(rows)}, SpeedAccuracySettings(target=0.005))
    said = findings_of("", result)
    assert not any("Ratio to the default" in each for each in said)
    assert any("Failed in scene: " in each for each in said) is (outcome is Outcome.DIVERGED)
    assert len(price_table(result)[1]) == 2
