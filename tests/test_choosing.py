"""The page that helps to choose takes the cheapest run that is near enough, and the committed one is whole."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from choosing import choosing_page, stability_section
from method_rows import FINE, JOINT, STEPS, by_accuracy, cube_of, fixed

from tripod_doe.analyses.speed_accuracy.speed_accuracy import SpeedAccuracySettings, speed_accuracy
from tripod_doe.analyses.stability.stability import StabilitySettings, stability_borders
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Outcome

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def page():
    """Rollers are 4 % off for a tenth of the price; one of their runs lies nearer by an error of 4 % the other way."""
    rows = []
    for model, off, dear in (("rollers", 0.04, 1e-4), ("needles", 0.0, 1e-3)):
        rows += fixed("implicit-euler", STEPS, lambda h, off=off: off + 10 * h, lambda h, dear=dear: dear / h, model)
        rows += fixed("bdf2", FINE, lambda h, off=off: off + 1e4 * h**2, lambda h, dear=dear: 2 * dear / h, model)
    rows += by_accuracy(0.0, 0.08, "rollers") + by_accuracy(2e-5, 1000.0, "needles")
    rows += fixed("rk4", [1e-2], lambda h: 0.0, lambda h: 1e-6, "rollers")
    accuracy = speed_accuracy({"joint": cube_of(rows, JOINT, "thrust_amplitude")}, SpeedAccuracySettings())
    steps, dims = np.array([1e-6, 1e-5, 1e-4]), ("method", "step_s")
    cube = xr.Dataset(
        {
            "drift_mm": (dims, [[1.0, 1.0, 2.0], [1.0, 1.0, np.nan]]),
            "outcome": (dims, np.array([[0, 0, 0], [0, 0, Outcome.DIVERGED]], np.int8)),
        },
        coords={"method": ["implicit-euler", "bdf2"], "step_s": steps},
    )
    borders = {"needle": stability_borders(cube, StabilitySettings(output="drift_mm"))}
    return choosing_page(accuracy, stability_section(borders, "1a2b3c4"), "1a2b3c4")


def rows_of(page, start):
    return [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith(f"| {start} |")]


def test_cheapest_run_near_enough(page):
    rows = {row[1]: row for row in rows_of(page, "third order of the thrust")}
    assert [rows[within][2] for within in ("10 %", "3 %", "1 %", "0.5 %")] == [
        "rollers",
        "needles",
        "needles",
        "needles",
    ]
    assert "rk4" not in rows["3 %"][3]


def test_the_price_of_the_default_stands_over_that_of_each_choice(page):
    """Exact: needles by accuracy cost 1000, implicit Euler with a step of 1e-4 10; 0.08 of rollers allow 10 %."""
    rows = {row[1]: row for row in rows_of(page, "third order of the thrust")}
    assert rows["0.5 %"][3] == "implicit-euler, step 0.0001"
    assert rows["0.5 %"][5:] == ["10", "100"]


def test_what_breaks_is_counted_by_kind(page):
    implicit, bdf = rows_of(page, "needle")
    assert implicit[1:3] == ["implicit-euler", "10 us to 100 us"]
    assert implicit[-2:] == ["0", "1"]
    assert bdf[-2:] == ["1", "0"]


def test_the_page_says_with_which_version_it_was_measured(page):
    assert "measured with\ncommit 1a2b3c4," in page
    assert "Measured with commit 1a2b3c4." in page


def test_committed_page_tells_every_model_and_method_and_its_version():
    text = (ROOT / "docs" / "explanation" / "choosing.md").read_text(encoding="utf-8")
    assert re.search(r"measured with\scommit [0-9a-f]{7},", text)
    for name in (*MODELS, *METHODS):
        assert name in text, (
            f"{name} is missing: make docs/explanation/choosing.md again, docs/explanation/choosing.py tells how"
        )
    assert "not known |" not in text
