"""Contributions of several models side by side: what is right and what is missed, by their numbers."""

from __future__ import annotations

import pytest

from tripod_doe.analyses.contribution.contribution import contribution_shares
from tripod_doe.analyses.contribution.side_by_side import find_side_by_side, of_one_ladder, side_by_side_table

CASE_2 = """
[study]
name = "Case 2"
[base]
initial_skew_1_deg = 0.4
initial_skew_2_deg = -0.4
initial_skew_3_deg = 0.4
model = "equilibrium"
relative_tolerance = 1e-11
[design]
kind = "ablation"
combinations = "single"
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""


@pytest.fixture(scope="module")
def ladder(make_cube):
    """Two models that agree but for a second order of half the size, and a needle sliding of its own."""
    cheap = contribution_shares(make_cube(CASE_2))
    fine = cheap.copy(deep=True).assign_attrs(model="needles")
    fine["amplitude"].loc[{"order": 2}] *= 0.5
    fine["share_off"].loc[{"order": 3, "mechanism": "needle_sliding"}] += 5
    return of_one_ladder({"fine": fine, "other": make_cube(CASE_2), "cheap": cheap})


def test_the_coarsest_comes_first_and_one_model_is_no_ladder(ladder):
    assert list(ladder) == ["cheap", "fine"]
    assert of_one_ladder({"cheap": ladder["cheap"]}) == {}
    assert of_one_ladder({"a": ladder["cheap"], "b": ladder["cheap"]}) == {}


def test_what_differs_is_missed_and_the_rest_is_right(ladder):
    right, missed, unseen = find_side_by_side(ladder)
    assert "the third order (14.1 N; equilibrium +0.0 %)" in right
    assert (
        "the shares of groove sliding, groove spinning, groove rolling and needle rolling in the third order "
        "(difference at most 0.0" in right
    )
    assert "the second order (0.111 N; equilibrium +100.0 %)" in missed
    assert "the share of needle sliding in the third order (5.9 %; equilibrium 0.9 %)" in missed
    assert "groove rolling" not in missed
    assert "only needles computes how it changes" in unseen


def test_the_table_has_a_column_a_model_and_the_paper_s_shares(ladder):
    heads, rows = side_by_side_table(ladder)
    assert heads == ["Quantity", "equilibrium", "needles", "paper, 3.5"]
    assert all(len(row) == len(heads) for row in rows)
    table = {row[0]: row[1:] for row in rows}
    assert table["third order, share of needle rolling by switching off (%)"][-1] == "6"
    assert table["third order, share of groove sliding by switching off (%)"] == ["100.0", "100.0", "86 (rest)"]
    assert table["second order, share of needle sliding by switching off (%)"][-1] == ""


def test_other_joints_are_no_ladder_and_have_no_paper_beside_them(ladder):
    """Regression: models at two torques were compared, and coast with the paper's drive."""
    coast = {name: each.assign_attrs(unlike_paper='{"torque_n_m": -50.0}') for name, each in ladder.items()}
    assert of_one_ladder({"cheap": ladder["cheap"], "fine": coast["fine"]}) == {}
    assert not any(row[-1] for row in side_by_side_table(of_one_ladder(coast))[1])
