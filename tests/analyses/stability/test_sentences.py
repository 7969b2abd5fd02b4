"""What the page says of stability: counts, silent failures, and every disagreement with its reason."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.registry import draw, findings_of
from tripod_doe.analyses.stability.sentences import stability_table
from tripod_doe.analyses.stability.stability import StabilitySettings, stability_borders
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.charts.outcomes import outcome_charts

STEPS = np.array([1e-8, 2e-8, 4e-8, 8e-8])
MASSES = np.array([1.0, 4.0])


@pytest.fixture(scope="module")
def borders():
    """Symplectic Euler: right up to theory at mass 1, wrong and silent beyond 1e-8 at mass 4; BDF2 always right."""
    right = np.ones((2, STEPS.size, 2), bool)
    right[0] = STEPS[:, None] <= 1e-8
    finished = right.copy()
    finished[0, :, 1] = True
    dims = ("method", "step_s", "needle_mass_factor")
    value = np.where(finished, np.where(right, 2.0, 2.5), np.nan)
    rate = np.broadcast_to(2e8 / MASSES, value.shape)
    cube = xr.Dataset(
        {
            "drift_mm": (dims, value),
            "outcome": (dims, np.where(finished, 0, Outcome.INACCURATE).astype(np.int8)),
            "outcome_detail": (dims, np.where(finished, "", "half the step changes the motion").astype(object)),
            "friction_rate_per_s": (dims, rate),
            "contact_rate_per_s": (dims, 0 * rate),
            "secant_lag_rate_per_s": (dims, 0 * rate),
        },
        coords={"method": ["symplectic-euler", "bdf2"], "step_s": STEPS, "needle_mass_factor": MASSES},
    )
    return stability_borders(cube, StabilitySettings(output="drift_mm"))


def test_sentences(borders):
    found = findings_of("borders", borders)
    assert found[0].startswith("1 of 2 measured stability limits agree with the predicted ones within a factor of 2")
    assert "; in 2 other cases all runs are right, as predicted; " in found[0]
    assert (
        found[1]
        == "Of 6 runs that are not right, 3 did not finish and 3 finished with a wrong result, at worst 25 % off."
    )
    assert found[2] == (
        "symplectic-euler: needle mass factor 4 measured 10 ns to 20 ns, predicted 40 ns. "
        "At needle mass factor 4 the first run beyond it finished with a wrong result."
    )


def test_table(borders):
    heads, rows = stability_table(borders)
    assert len(rows) == 2
    told = dict(zip(heads, rows[0], strict=True))
    assert told["Varied"] == "needle mass factor 1 to 4"
    assert told["Measured limit"] == "10 ns to 20 ns"
    assert told["Predicted limit"] == "10 ns to 40 ns"
    assert told["Agree"] == "1 of 2"
    assert told["First failure"] == "finished 1, inaccurate 1"
    assert told["Wrong, undetected"] == "3"
    assert rows[1][2:5] == ["none up to 80 ns", "none", "nothing"]


def test_map(borders):
    chart = draw("stability-map", {"borders": borders})[0]
    assert [axes.get_title(loc="left") for axes in chart.figure.axes] == ["symplectic-euler"]
    assert "Not drawn, all runs right within the limit: bdf2." in chart.caption
    assert len(chart.data) == 4
    svg = chart.svg()
    assert "finished with a wrong result" in svg
    assert "no reference" not in svg


def test_how_models_end():
    words = ["equilibrium", "rollers"]
    outcome = np.array([[Outcome.FINISHED, Outcome.FINISHED], [Outcome.OUT_OF_RANGE, Outcome.FINISHED]], np.int8)
    amplitude = np.where(outcome == 0, 14.0, np.nan)[..., None] * np.ones(13)
    cube = xr.Dataset(
        {
            "outcome": (("model", "torque_n_m"), outcome),
            "thrust_amplitude": (("model", "torque_n_m", "order"), amplitude, {"units": "N"}),
        },
        coords={"model": words, "torque_n_m": ("torque_n_m", [0.0, 50.0], {"units": "N m"}), "order": range(13)},
    )
    (chart,) = outcome_charts(cube)
    texts = [text.get_text() for text in chart.figure.axes[0].texts]
    assert texts == ["14", "14", "out\nof\nrange", "14"]


@pytest.mark.parametrize("seed", range(8))
def test_defaults_are_measured_against_their_limits(borders, seed):
    """Exact by its meaning: any default lies below, above or between, and a missing one is not named."""
    random = np.random.default_rng(seed)
    defaults = np.where(random.random(2) < 0.2, np.nan, random.choice([3e-9, 1.5e-8, 3e-8, 9e-8], 2))
    defaults[1] = random.choice([3e-9, 9e-8])  # a method without a limit: within, or beyond the steps tried
    told = findings_of("joint_borders", borders.assign(default_setting=("method", defaults)))
    base = borders.isel(case=0)
    for at, default in enumerate(defaults):
        row, method = base.isel(method=at), str(base["method"].values[at])
        low, high = float(row["border_low"]), float(row["border_high"])
        said = next((part for part in told[0].split("; ") if f"{method} " in part), "")
        assert bool(said) == np.isfinite(default)
        if said and default <= low:
            stated = float(re.search(r"([\d.,]+) times ", said)[1])
            assert stated <= low / default * (1 + 1e-9) < 1.1 * stated
            assert ("has no limit up to" in said) == np.isinf(high)
        elif said and np.isinf(high):
            assert "is larger than every step that was tried, up to 80 ns" in said
        elif said:
            assert ("times above it" in said) == (default >= high)
    assert "measured at needle mass factor 1: " in told[0]
    assert all(sentence.startswith("Joint: ") for sentence in told[:3] if "measured" in sentence)
    assert len(set(told)) == len(told)
