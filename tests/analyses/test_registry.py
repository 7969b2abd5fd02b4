"""The registry: a result is known by its kind alone, and every row works for studies, workflows and pages."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from published import cube_of

from slow_cases import first_fast
from tripod_doe.analyses import registry
from tripod_doe.analyses.comparison.record_comparison import ComparisonSettings, compare_file
from tripod_doe.analyses.contribution.contribution import ContributionSettings, contribution_shares
from tripod_doe.analyses.kinds import is_study, kind_of, of_kind
from tripod_doe.analyses.registry import ANALYSES, FIGURES, STUDY_FIGURES, draw, findings_of, table_of
from tripod_doe.errors import CubeError, InputError
from tripod_doe.study.definition.study_folder import StudyFolder

KINDS = {
    "sobol",
    "morris",
    "contribution",
    "stability",
    "comparison",
    "choose",
    "speed-accuracy",
    "claims",
    "claims-over-skew",
    "fast",
    "rbd-fast",
    "pawn",
    "delta",
    "dgsm",
    "shapley",
    "effects",
    "tolerance",
    "surrogate",
    "multifidelity",
}


@pytest.fixture(scope="module")
def ablation(make_cube):
    return make_cube(
        '[study]\nname = "A"\nfunction = "report_functions:uneven"\n[design]\nkind = "ablation"\nfactors = ["x", "z"]\n'
    )


def test_every_kind_has_a_row_and_every_figure_a_name():
    assert set(ANALYSES) == KINDS
    assert {name for row in ANALYSES.values() for name in row.figures} <= set(FIGURES)


PLACES = [*STUDY_FIGURES.values()] + [
    place for row in ANALYSES.values() for place in (row.sentences, row.table, *row.figures.values()) if place
]


@pytest.mark.parametrize("place", dict.fromkeys(PLACES))
def test_every_place_that_a_row_names_holds_a_function(place):
    assert callable(registry._load(place))


def test_what_computes_draws_nothing():
    """The registry and all that computes load neither what draws nor what states sentences."""
    script = "import sys, tripod_doe.analyses.registry; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"matplotlib", "matplotlib.figure", "tripod_doe.page_parts.charts.chart"}
    assert not {name for name in loaded if name.startswith("tripod_doe.analyses") and name.endswith("sentences")}


def test_a_figure_of_an_analysis_shows_two_of_them(ablation):
    shares = contribution_shares(ablation, ContributionSettings(output="y"))
    assert len(draw("contribution", {"a": shares, "b": shares})) == 2


def test_a_comparison_needs_one_study(ablation, tmp_path):
    """Regression: the result of an analysis was no InputError, but a KeyError of a variable outcome."""
    shares = contribution_shares(ablation, ContributionSettings(output="y"))
    for cubes, names in (({"a": ablation, "b": ablation}, "a, b"), ({"shares": shares}, "shares")):
        with pytest.raises(InputError, match=f"a comparison needs one study step as its input, not {names}"):
            compare_file(cubes, ComparisonSettings(measurement="m.csv"), StudyFolder(tmp_path))


def test_a_result_carries_its_kind_and_a_study_has_none(ablation):
    shares = contribution_shares(ablation, ContributionSettings(output="y"))
    assert kind_of(shares) == shares.attrs["analysis_kind"] == "contribution"
    assert (kind_of(ablation), is_study(ablation), is_study(shares)) == ("", True, False)
    assert of_kind({"study": ablation, "shares": shares}, "contribution").keys() == {"shares"}


def test_the_kind_alone_decides_what_is_reported(ablation):
    """Invariance: neither a variable of another analysis nor the name of the result changes what it is taken for."""
    shares = contribution_shares(ablation, ContributionSettings(output="y"))
    disguised = shares.assign(ST=xr.ones_like(shares["closure"]), outcome=xr.zeros_like(shares["closure"]))
    assert findings_of("sobol", disguised) == findings_of("sobol", shares)
    assert findings_of("sobol", shares)[0].startswith(
        "With one mechanism alone switched off, y (11) changes by: x -90.9 %"
    )
    assert findings_of("x", xr.Dataset(attrs={"analysis_kind": "unheard"})) == []
    assert table_of(xr.Dataset(attrs={"analysis_kind": "unheard"})) is None
    assert findings_of("study", ablation)[0].startswith("y is 11")


def test_points_that_are_missing_are_counted(ablation):
    shares = contribution_shares(ablation, ContributionSettings(output="y"))
    assert (shares.attrs["points_used"], shares.attrs["points_dropped"]) == (4, 0)
    broken = ablation.copy(deep=True)
    broken["outcome"][1] = 1
    shares = contribution_shares(broken, ContributionSettings(output="y"))
    assert (shares.attrs["points_used"], shares.attrs["points_dropped"]) == (3, 1)


INDICES = ("sobol", "morris", "fast", "rbd-fast", "pawn", "delta", "dgsm", "shapley")


@pytest.mark.parametrize("kind", [kind for kind, row in ANALYSES.items() if row.sentences])
def test_a_result_that_lacks_its_variables_is_said(kind, monkeypatch):
    """Regression: a file of a known kind without its variables was an internal error of the service."""
    monkeypatch.setattr(registry, "MADE", set())
    empty = xr.Dataset(attrs={"analysis_kind": kind})
    if kind in INDICES:  # which state each factor, and here is none
        assert findings_of("a", empty) == []
        return
    with pytest.raises(CubeError, match=f"not a complete result of an analysis of the kind '{kind}': "):
        findings_of("a", empty)


def test_an_error_of_our_own_is_not_called_a_fault_of_the_result(ablation, monkeypatch):
    """Regression: an IndexError in a sentence ended with "make it again", and made again it ended so again."""
    monkeypatch.setattr(registry, "_load", lambda place: lambda result, name: [][0])
    shares = contribution_shares(ablation, ContributionSettings(output="y"))
    with pytest.raises(IndexError):
        findings_of("shares", shares)
    monkeypatch.setattr(registry, "MADE", set())
    with pytest.raises(CubeError, match="out of range; make it again"):
        findings_of("shares", shares)


def curved(x):
    return np.sin(6 * x[:, 0]) + x[:, 1] ** 2 + x[:, 0] * x[:, 2]


DESIGNS = {
    "fast": '"fast"\nsamples = 65',
    "pawn": '"latin-hypercube"\nsamples = 64',
    "morris": '"morris"\nsamples = 32',
    "sobol": '"saltelli"\nsamples = 32',
    "dgsm": '"finite-differences"\nsamples = 32',
    "effects": '"latin-hypercube"\nsamples = 64',
    "delta": '"latin-hypercube"\nsamples = 64',
    "rbd-fast": '"latin-hypercube"\nsamples = 64',
    "tolerance": '"latin-hypercube"\nsamples = 64',
    "shapley": '"latin-hypercube"\nsamples = 64',
    "surrogate": '"latin-hypercube"\nsamples = 30',
}
OTHER = {
    "confidence": 0.8, "resamples": 2000, "seed": 7, "precision": 0.5, "slices": 5, "interactions": False, "squares": False,
    "folds": 3, "probabilities": [0.5], "limits": {"y": 1.0}, "keep": 0.8, "costs": {"torque_n_m": 2.0},
}  # fmt: skip
ELSEWHERE = {"outputs", "holes", "most_dropped", "confirm"}  # other outputs, failed points, and points that a run adds


@pytest.mark.parametrize("kind", first_fast(DESIGNS, 5))
def test_every_setting_of_a_kind_changes_its_answer(kind):
    """Regression: `precision` and `resamples` of pawn, delta and surrogate, and all of fast, did nothing."""
    row, cube = ANALYSES[kind], cube_of(f"kind = {DESIGNS[kind]}", curved)
    usual = {"outputs": ["y"]} | ({"limits": {"y": 0.5}} if kind == "tolerance" else {})
    answer = row.function({kind: cube}, row.settings(**usual), None)
    for key in row.settings.model_fields.keys() - ELSEWHERE:
        other = row.function({kind: cube}, row.settings(**usual | {key: OTHER[key]}), None)
        assert not answer.equals(other), key
