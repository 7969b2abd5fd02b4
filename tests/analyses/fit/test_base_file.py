"""What a fit leaves to paste: no name that a stranger gives becomes a table of it."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.fit.base_file import base_text, tolerance_text
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

GROUP = {"value_of_record": 0.05, "low_of_record": 0.04, "high_of_record": 0.06}
GROUP |= {"verdict_of_record": "found", "group_of_record": "oil A"}
HOSTILE = "x\n[study]\nfunction = 'upload.evil:f'\nname = '''#"


@pytest.fixture
def result():
    names, one = ["groove_sliding_friction"], {"bound_low": 0.03, "bound_high": 0.12, "value": 0.05}
    data = {name: ("unknown", [value]) for name, value in ({"low": 0.04, "high": 0.06} | one).items()}
    data |= {"verdict": ("unknown", ["one-sided"]), "correlation_in_first": (("unknown", "unknown_2"), np.eye(1))}
    return xr.Dataset(data, {"unknown": names, "unknown_2": names}, {"title": HOSTILE})


@pytest.mark.parametrize("text_of", [base_text, tolerance_text])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\u0085", "\u2028", "\x00"])
def test_a_name_stays_in_its_line(result, text_of, end):
    """It was code: tolerance.toml of a fit that was uploaded ran a function from the upload, for whoever ran it."""
    text = text_of(result.assign_attrs(title=HOSTILE.replace("\n", end)), {"torque_n_m": 200.0})
    read = tomllib.loads(text)
    assert "function" not in read.get("study", {})
    assert read["base"]["torque_n_m"] == 200.0


@pytest.mark.parametrize("correlation", [-0.9954, 0.3, 1.0])
def test_correlations_are_those_of_the_fit(result, correlation):
    """Exact but for the sample: the sum of two normal unknowns; regression: 0.98 of it spread -0.9954 twice as far."""
    names = ["groove_sliding_friction", "needle_sliding_friction"]
    two = xr.concat([result.isel(unknown=0, unknown_2=0, drop=True)] * 2, "unknown")
    two = two.assign(correlation_in_first=(("unknown", "unknown_2"), [[1, correlation], [correlation, 1]]))
    two = two.assign_coords(unknown=names, unknown_2=names).assign(verdict=("unknown", ["found", "found"]))
    two["low"], two["high"] = two["value"] - 0.00196, two["value"] + 0.00196
    text = tolerance_text(two.assign_attrs(title="two"), {"torque_n_m": 200.0})
    points = make_points(parse_study(text.replace("samples = 256", "samples = 16384"))).columns
    one, other = (points[name] for name in names)
    assert np.std(one + other) == pytest.approx(0.001 * np.sqrt(2 + 2 * correlation), rel=0.03)


def test_what_differs_between_records_is_correlated_as_in_the_first(result):
    """Regression: it was independent of the others, and the third order scattered twice as far as the fit left open."""
    names = ["groove_sliding_friction", "needle_sliding_friction"]
    two = xr.concat([result.isel(unknown=0, unknown_2=0, drop=True)] * 2, "unknown")
    two = two.assign(correlation_in_first=(("unknown", "unknown_2"), [[1, -0.7], [-0.7, 1]]))
    own = {name: (("unknown", "record"), [[value], [value]]) for name, value in GROUP.items()}
    two = two.assign(own).assign(value=("unknown", [np.nan, 0.05])).assign_coords(unknown=names, unknown_2=names)
    ((first, second, rank),) = tomllib.loads(tolerance_text(two, {}))["design"]["correlation"]
    assert [first, second] == names
    assert rank == pytest.approx(6 / np.pi * np.arcsin(-0.35), rel=1e-6)


@pytest.mark.parametrize("text_of", [base_text, tolerance_text])
def test_values_of_groups_are_comments_to_choose_from(result, text_of):
    """Exact values. Regressions: the study took the default without a word; without a shared unknown, numpy failed, and
    a study that is to be run had no factor."""
    groups = {"value_of_record": [0.07, 0.05, 0.07], "group_of_record": ["oil A", HOSTILE, "oil A"]}
    groups |= {"low_of_record": [0.06, 0.04, 0.06], "high_of_record": [0.08, 0.06, 0.08]}
    groups |= {"verdict_of_record": ["found", "one-sided", "found"]}
    own = result.assign({name: (("unknown", "record"), [values]) for name, values in groups.items()})
    text = text_of(own.assign(value=("unknown", [np.nan])), {"torque_n_m": 200.0})
    assert tomllib.loads(text)["base"] == {"torque_n_m": 200.0}
    assert text.count("\n# groove_sliding_friction = 0.07  # oil A\n") == 1
    assert "# groove_sliding_friction = 0.05  # x\\n[study]" in text
    assert "correlation" not in text
    if text_of is tolerance_text:
        factor = parse_study(text).factors["groove_sliding_friction"].table
        assert (factor.mean, factor.std, factor.low) == (0.07, pytest.approx(0.02 / 3.92, rel=1e-3), 0.03)
