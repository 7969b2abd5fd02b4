"""Claims in the report: beside the figures that they belong to."""

from __future__ import annotations

import pytest

from tripod_doe.analysis.claims.verdicts import ClaimsSettings, check_claims
from tripod_doe.report.claims.verdicts import claims_of_figures


@pytest.mark.parametrize(
    ("title", "places"),
    [
        ("Fig. 8(b): loci", {"2.3.3, Fig. 8(b)"}),
        ("Figs. 16 and 17: local orders", {"3.4, Fig. 16", "3.4, Fig. 16(a)", "3.4, Fig. 16(c)", "3.4, Fig. 17"}),
        ("Figs. 11, 13: skew", {"3.2, Fig. 11", "3.2, Fig. 10; 3.3, Fig. 13", "3.3, Fig. 13"}),
        ("Figs. 16 to 18", {"3.4, Fig. 16", "3.4, Fig. 16(a)", "3.4, Fig. 16(c)", "3.4, Fig. 17", "3.4, Fig. 18 case 3",
                            "3.4, Fig. 18 case 4"}),
    ],
)  # fmt: skip
def test_the_claims_of_a_figure_are_those_whose_place_names_it(title, places):
    table = claims_of_figures(check_claims({}, ClaimsSettings()), title)
    assert table is not None
    assert {row[4] for row in table[1]} == places


@pytest.mark.parametrize("title", ["Fig. 12: measured", "Beat of 10 and 8 N", ""])
def test_other_figures_have_none(title):
    assert claims_of_figures(check_claims({}, ClaimsSettings()), title) is None
