"""The registry: a result is known by its kind alone, and every row works for studies, workflows and pages."""

from __future__ import annotations

import pytest
import xarray as xr

from tripod_doe.analyses.contribution.contribution import ContributionSettings, contribution_shares
from tripod_doe.analyses.figures import FIGURES
from tripod_doe.analyses.kinds import is_study, kind_of, of_kind
from tripod_doe.analyses.registry import ANALYSES, findings_of, table_of

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
    assert findings_of("sobol", shares)[0].startswith("Of y")
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
