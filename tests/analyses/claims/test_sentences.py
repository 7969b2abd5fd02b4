"""Claims in the report: beside the figures that they belong to."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.analyses.claims.sentences import claim_value, claims_of_figures, find_over_skew
from tripod_doe.analyses.claims.verdicts import ClaimsSettings, Verdict, check_claims


@pytest.mark.parametrize(
    ("title", "places"),
    [
        ("Fig. 8(b): loci", {"2.3.3, Fig. 8(b)"}),
        ("Figs. 16 and 17: local orders", {"3.4, Fig. 16", "3.4, Fig. 16(a)", "3.4, Fig. 16(c)", "3.4, Fig. 17"}),
        ("Figs. 11, 13: skew", {"3.2, Fig. 11", "3.2, Fig. 10; 3.3, Fig. 13", "3.3, Fig. 13"}),
        (
            "Figs. 16 to 18",
            {
                "3.4, Fig. 16",
                "3.4, Fig. 16(a)",
                "3.4, Fig. 16(c)",
                "3.4, Fig. 17",
                "3.4, Fig. 18 case 3",
                "3.4, Fig. 18 case 4",
            },
        ),
    ],
)
def test_the_claims_of_a_figure_are_those_whose_place_names_it(title, places):
    table = claims_of_figures(check_claims({}, ClaimsSettings()), title)
    assert table is not None
    assert {row[4] for row in table[1]} == places


@pytest.mark.parametrize("title", ["Fig. 12: measured", "Beat of 10 and 8 N", ""])
def test_other_figures_have_none(title):
    assert claims_of_figures(check_claims({}, ClaimsSettings()), title) is None


def test_a_claim_counts_at_the_skews_at_which_it_is_decided():
    """Exact: one claim holds at both skews, one at the only skew at which it is decided."""
    claims, numbers = check_claims({}, ClaimsSettings()).isel(claim=[0, 1]), ["value", "error", "verdict"]
    table = claims.drop_vars(numbers).merge(claims[numbers].expand_dims(skew_deg=[0.4, 0.8]))
    for last, end in ((Verdict.HOLDS, ","), (Verdict.NOT_DECIDED, " at which they are decided,")):
        table["verdict"] = (("claim", "skew_deg"), np.array([[Verdict.HOLDS, Verdict.HOLDS], [Verdict.HOLDS, last]]))
        assert f"2 of 2 claims hold at every skew{end} 0 at none" in find_over_skew(table)[0]


@pytest.mark.parametrize(
    ("value", "error", "told"),
    [
        (81.996, np.nan, "81.996 %"),
        (82.0, np.nan, "82 %"),
        (90.2, 0.4, "90.2 +- 0.4 %"),
        (85.4321, 0.002, "85.432 +- 0.002 %"),
    ],
)
def test_a_value_is_told_apart_from_the_limits_of_its_claim(value, error, told):
    """Regression: "82 %; required: 82 to 90 %" of a claim that does not hold."""
    row = check_claims({}, ClaimsSettings()).set_index(claim="claim").sel(claim="share_groove_sliding")
    assert claim_value(row.assign(value=value, error=error)) == told
