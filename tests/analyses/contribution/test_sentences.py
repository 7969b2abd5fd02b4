"""The report of a contribution: shares of every definition, the paper's beside them, and what they mean."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.analyses.contribution.charts import contribution_charts
from tripod_doe.analyses.contribution.contribution import ContributionSettings, contribution_shares
from tripod_doe.analyses.contribution.sentences import contribution_findings, contribution_notes, contribution_table
from tripod_doe.analyses.contribution.share_tables import PAPER_SHARES, contributions, percent, share_rows, signed
from tripod_doe.analyses.findings import find
from tripod_doe.model_interface import Outcome
from tripod_doe.reports.study_report import make_page

CASE_2 = """
[study]
name = "Case 2"
[base]
initial_skew_1_deg = 0.4
initial_skew_2_deg = -0.4
initial_skew_3_deg = 0.4
model = "equilibrium"
relative_tolerance = 1e-11
"""
ABLATION = '[design]\nkind = "ablation"\n[keep]\noutputs = ["thrust_amplitude", "thrust_phase_deg"]\n'
CROSSED = """
[factors.joint_angle_deg]
values = [5, 10]
[design]
kind = "product"
of = ["angles", "switches"]
[design.angles]
factors = ["joint_angle_deg"]
[design.switches]
kind = "ablation"
combinations = "single"
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""


@pytest.fixture(scope="module")
def case_2(make_cube):
    return make_cube(CASE_2 + ABLATION)


@pytest.fixture(scope="module")
def parts(case_2):
    return contributions({"contribution": contribution_shares(case_2)})


@pytest.fixture(scope="module")
def uneven(make_cube):
    text = (
        '[study]\nname = "U"\nfunction = "report_functions:uneven"\n[design]\nkind = "ablation"\nfactors = ["x", "z"]\n'
    )
    return make_cube(text)


def test_the_paper_s_shares_stand_beside_those_of_the_third_order_only(parts):
    third, second = parts
    heads, rows, below = share_rows(third)
    assert heads == ["Mechanism", "switching off", "on alone", "Shapley value", "paper, 3.5"]
    assert [row[-1] for row in rows] == ["86 (rest)", "2", "5", "1", "6"]
    assert all(len(row) == len(heads) for row in [*rows, *below])
    assert share_rows(second)[0][-1] == "Shapley value"


def test_the_paper_s_reading_is_the_definition_with_the_smallest_largest_difference(parts):
    third = parts[0]
    expected = {
        name: max(abs(values[0, third.mechanisms.index(each)] - share) for each, share in PAPER_SHARES.items())
        for name, values in third.shares.items()
    }
    assert third.differences() == pytest.approx(expected)
    assert min(expected, key=expected.get) == "share_off"
    assert (
        f"closest to those by switching off: the largest difference is {expected['share_off']:.1f}"
        in contribution_findings(third)[2]
    )


def test_the_note_says_that_all_thrust_passes_by_groove_sliding(parts):
    third, second = parts
    assert contribution_notes(third)[0].startswith(
        "All of the third order depends on groove sliding: without it, less than 0.5 % is left in the same phase."
    )
    assert contribution_notes(second)[0].startswith("The second order needs groove sliding and needle sliding together")
    assert "groove sliding and groove rolling" in contribution_notes(third)[1]


def test_closure_and_opponents_are_stated(parts):
    third, second = parts
    below = {row[0]: row[1:] for row in share_rows(third)[2]}
    assert below["closure: 100 - sum"][0] == f"{third.closure[0]:.1f}"
    assert float(below["closure: 100 - sum"][2]) == 0
    assert second.shares["share_shapley"][0, second.mechanisms.index("groove_rolling")] < 0
    assert (
        "needle rolling with -0.1 % and groove rolling with -0.1 % oppose the sum" in contribution_findings(second)[1]
    )


def test_the_csv_behind_the_chart_holds_the_shares(parts, read_table):
    third = parts[0]
    data = contribution_charts(third)[0].data.set_index("definition")
    for name, values in third.shares.items():
        assert (data.loc[name, third.mechanisms].to_numpy(float) == values[0]).all()
    assert "needle rolling" in contribution_charts(third)[0].svg()
    assert "paper, 3.5" in contribution_charts(third)[0].svg()


def test_the_page_shows_the_joint_with_all_mechanisms_on(case_2):
    page = make_page(case_2, {"contribution": contribution_shares(case_2)})
    whole = float(case_2["thrust_amplitude"].isel(point=0).sel(order=3))
    assert f"of the thrust force is the largest: {whole:.3g} N;" in find(case_2)[0]
    assert '<section id="contribution">' in page
    assert 'href="#contribution"' in page
    assert page.count('class="shares"') == 2
    assert "sensitivity" not in page[page.index("<nav") : page.index("</nav>")]


def test_bars_of_several_operating_points_and_ranges_in_the_table(make_cube):
    cube = make_cube(CASE_2 + CROSSED)
    third = contributions({"c": contribution_shares(cube)})[0]
    assert third.labels == ["5 deg", "10 deg"]
    assert third.points["joint_angle_deg"].tolist() == [5, 10]
    assert list(third.shares) == ["share_off", "share_on"]
    chart = contribution_charts(third)[0]
    assert "by switching off, at 2 operating points" in chart.caption
    assert {"5 deg", "10 deg"} <= {text.split("</text>")[0].split(">")[-1] for text in chart.svg().split("<text")[1:]}
    assert len(chart.data) == 4
    assert " to " in share_rows(third)[1][2][1]
    assert third.like_paper.tolist() == [False, True]
    assert ", at 10 deg, closest to those by switching off" in contribution_findings(third)[2]
    heads, table = contribution_table(contribution_shares(cube))
    assert [row[:2] for row in table] == [
        [f"the {each} order", at] for each in ("third", "second") for at in third.labels
    ]
    assert [row[2] for row in table[:2]] == third.amplitudes
    assert [row[3] for row in table[:2]] == [percent(third.shares[third.leading][at : at + 1, 0]) for at in (0, 1)]
    assert len(heads) == len(table[0])
    assert not any("furthest" in sentence for sentence in contribution_findings(third))
    off = contribution_findings(third)[1]
    first, second = (percent(100 - third.closure[at : at + 1]) for at in (0, 1))
    assert off.endswith(f"; they add up to {first} / {second} (analysis c).")
    assert "(loss without the mechanism), at 5 deg / 10 deg: groove sliding " in off
    assert make_page(cube, {"c": contribution_shares(cube)}).count("at 2 operating points") >= 2


@pytest.mark.parametrize("other", ["torque_n_m = -10", "groove_sliding_friction = 0.02"])
def test_the_paper_s_shares_are_those_of_its_joint_at_its_operating_point(make_cube, other):
    """Regression: the base values were not asked, and its shares stood beside those of coast."""
    for rest in (CROSSED, ABLATION):
        part = contributions({"c": contribution_shares(make_cube(f"{CASE_2}{other}\n{rest}"))})[0]
        assert not part.like_paper.any()
        assert not any("paper" in sentence for sentence in contribution_findings(part))
        assert "paper, 3.5" not in share_rows(part)[0]


def test_a_function_has_no_paper_column(uneven):
    part = contributions({"shares": contribution_shares(uneven, ContributionSettings(output="y"))})[0]
    heads, rows, below = share_rows(part)
    assert heads[-1] == "Shapley value"
    assert [row[0] for row in rows] == ["x", "z"]
    assert not any("paper" in row[0] for row in below)
    assert part.what == "y"
    assert not any("paper" in sentence for sentence in contribution_findings(part) + contribution_notes(part))
    page = make_page(uneven, {"shares": contribution_shares(uneven, ContributionSettings(output="y"))})
    assert "What each mechanism contributes" in page
    notes = page.partition("Notes on these shares</summary>")[2].partition("</details>")[0]
    assert notes.count("<p>") == notes.count('class="why"') > 0


@pytest.mark.parametrize(
    ("lost", "reason"), [(0, "points that they need did not finish or have no value"), (None, "its amplitude is zero")]
)
def test_shares_that_cannot_be_computed_are_explained(uneven, lost, reason):
    cube = uneven.copy(deep=True)
    if lost is None:
        cube["y"][:] = 0
    else:
        cube["outcome"][lost] = Outcome.DIVERGED
        cube["y"][lost] = np.nan
    analyses = {"shares": contribution_shares(cube, ContributionSettings(output="y"))}
    part = contributions(analyses)[0]
    assert reason in contribution_findings(part)[0]
    page = make_page(cube, analyses)
    assert reason in page
    assert 'class="shares"' not in page


def test_one_missing_point_leaves_a_chart_that_says_so(uneven):
    cube = uneven.copy(deep=True)
    cube["outcome"][1] = Outcome.DIVERGED
    part = contributions({"shares": contribution_shares(cube, ContributionSettings(output="y"))})[0]
    assert "incomplete" in contribution_charts(part)[0].svg()
    assert share_rows(part)[1][1][1:] == ["not known", f"{100 / 11:.1f}", "not known"]
    assert contribution_findings(part)


def test_the_direct_decomposition_stands_beside_the_ablation_and_says_where_they_agree(make_cube):
    """Regression of the words; the numbers are read off the analysis."""
    names = "thrust_amplitude", "thrust_phase_deg", "thrust_part_amplitude", "thrust_part_phase_deg"
    third = contributions(
        {
            "c": contribution_shares(
                make_cube(CASE_2 + ABLATION.replace(ABLATION.split("outputs = ")[1], f"{[*names]}\n"))
            )
        }
    )[0]
    heads, rows, _ = share_rows(third)
    assert heads[4] == "direct decomposition"
    direct, off = third.shares["share_direct"][0], third.shares["share_off"][0]
    assert rows[0][4] == f"{direct[0]:.1f}"
    (told,) = [note for note in contribution_notes(third) if note.startswith("Direct decomposition")]
    assert f"groove sliding (direct {direct[0]:.1f} %, there {off[0]:.1f} %)" in told
    close = np.abs(direct - off) <= 4
    assert ("groove spinning" in told.split("but not for")[0]) == close[third.mechanisms.index("groove_spinning")]


MANY = """
[study]
name = "Many operating points"
function = "report_functions:mechanisms"
[factors]
a = { values = [1, 2, 3, 4] }
b = { values = [1, 2, 3] }
[design]
kind = "product"
of = ["operating", "switches"]
[design.operating]
factors = ["a", "b"]
[design.switches]
kind = "ablation"
factors = ["x", "z"]
"""


@pytest.fixture(scope="module")
def many(make_cube):
    return contributions({"s": contribution_shares(make_cube(MANY), ContributionSettings(output="y"))})[0]


def test_many_operating_points_are_told_by_median_and_quartiles(many):
    _, first, furthest = contribution_findings(many)
    assert (
        "by Shapley value (mean over all sequences of switching on), "
        "median (and quartiles) over 12 operating points: x 70.8 % (62.5 to 76.2), z" in first
    )
    assert furthest.startswith("The share of x in y differs most from its median at a 4, b 3: 400000.0 %, with a")
    assert share_rows(many)[1][0][1] == "70.8 (62.5 to 76.2)"


def test_operating_points_without_an_amplitude_do_not_take_the_shapley_values_of_all(make_cube):
    """Regression: with two points of a straight joint among eight, shares were told by switching off."""
    cube = make_cube(MANY)
    still = cube["a"] == 4
    cube["y"] = cube["y"].where(~still, 0.0)
    (part,) = contributions({"s": contribution_shares(cube, ContributionSettings(output="y"))})
    _, first, second, *_ = contribution_findings(part)
    assert (
        "by Shapley value (mean over all sequences of switching on), "
        "median (and quartiles) over 9 operating points: x " in first
    )
    assert second == "At 3 of 12 operating points y is zero within its numerical error, and has no shares."
    assert "at 9 operating points" in contribution_charts(part)[0].caption
    cube["outcome"] = cube["outcome"].where(~(still & (cube["b"] == 3)), Outcome.DIVERGED)
    (part,) = contributions({"s": contribution_shares(cube, ContributionSettings(output="y"))})
    assert contribution_findings(part)[2:4] == [
        "At 2 of 12 operating points y is zero within its numerical error, and has no shares.",
        "At 1 of 12 operating points y has no shares, since points that they need did not finish or have no value.",
    ]


def test_one_unusual_operating_point_does_not_set_the_scale(many):
    spread, of_two = contribution_charts(many)
    assert "Beyond the axis (triangles): 2 shares, the most extreme is x at a 4, b 3 with 400000.0 %." in spread.caption
    low, high = spread.figure.axes[0].get_xlim()
    assert -10 < low < high < 110
    assert of_two.name.endswith("-map")
    assert len(of_two.figure.axes) == 4  # two mechanisms, each with its scale
    assert len(of_two.data) == 12 * 3  # full numbers, outlier included


def test_cells_of_a_map_stand_under_their_values(many):
    """Regression: a row at 0.3 deg was a line between those at 0 and 4 deg, and ticks stood where no cell was."""
    uneven = replace(many, points=many.points.assign(a=many.points["a"].map({1: 0.3, 2: -1500, 3: 4, 4: 12})))
    axes = contribution_charts(uneven)[1].figure.axes[0]
    ticks = [[label.get_text() for label in axis.get_ticklabels()] for axis in (axes.xaxis, axes.yaxis)]
    assert ticks == [["1", "2", "3"], ["-1500", "0.3", "4", "12"]]
    assert axes.get_ylim() == (-0.5, 3.5)


def test_operating_points_that_are_no_grid_are_not_laid_out_as_one(many, monkeypatch):
    """Regression: a table of 7,812 sampled places by themselves took half a gigabyte per mechanism."""
    monkeypatch.setattr(pd.DataFrame, "pivot_table", lambda *args, **keys: pytest.fail("a table was made"))
    scattered = many.points.assign(a=np.linspace(0, 1, 12), b=np.linspace(1, 0, 12))
    (spread,) = contribution_charts(replace(many, points=scattered))
    assert not spread.name.endswith("-map")


def test_a_direct_decomposition_beside_nothing_known_is_not_compared(parts):
    third = replace(
        parts[0],
        shares={name: np.full_like(values, np.nan) for name, values in parts[0].shares.items()}
        | {"share_direct": np.full_like(parts[0].shares["share_off"], 20.0)},
    )
    (told,) = [note for note in contribution_notes(third) if note.startswith("Direct")]
    assert "Within" not in told
    assert "need not agree" not in told


def test_shares_of_an_amplitude_within_its_error_are_flagged(case_2):
    scatter = 0.06 * case_2["thrust_amplitude"] * (case_2["thrust_amplitude"]["order"] == 2)
    result = contribution_shares(case_2.assign(thrust_amplitude_scatter=scatter))
    third, second = contributions({"c": result})
    assert "These shares are uncertain: the numerical error of the second order exceeds 5 % of it." in (
        contribution_findings(second)
    )
    assert not any("uncertain" in sentence for sentence in contribution_findings(third))


def test_a_lost_combination_is_named_with_the_bounds_that_are_left(make_cube):
    """x, z and w add 10, 1 and 3 to the amplitude; without the result of x + z their Shapley values have bounds."""
    text = '[study]\nname = "T"\nfunction = "report_functions:three"\n[design]\nkind = "ablation"\n'
    cube = make_cube(text + 'factors = ["x", "z", "w"]\n')
    lost = cube["outcome"].where((cube["x"] == 1) & (cube["z"] == 1) & (cube["w"] == 0), drop=True)
    cube["outcome"][int(lost["point"][0])] = Outcome.DIVERGED
    (part,) = contributions({"shares": contribution_shares(cube, ContributionSettings(output="y"))})
    (note,) = [note for note in contribution_notes(part) if "no result" in note]
    assert note.startswith(
        "There is no result with only these mechanisms on: x + z. Shapley values lie within these bounds"
    )
    for name, true in (("x", 1000 / 14), ("z", 100 / 14), ("w", 300 / 14)):
        low, high = map(float, re.search(rf" {name} ([-\d.]+) to ([-\d.]+) %", note).groups())
        assert low <= true <= high


def test_results_that_record_no_error_of_the_amplitude_have_no_doubtful_shares(uneven):
    """Those of earlier versions can still be reported."""
    result = contribution_shares(uneven, ContributionSettings(output="y"))
    old = result.drop_vars(
        [name for name in result if "amplitude_error" in name or "shapley_" in name or "missing" in name]
    )
    (part,) = contributions({"shares": old})
    assert not part.uncertain.any()
    assert contribution_findings(part)


SIDES = """
[factors.torque_n_m]
values = [-120, 120]
[design]
kind = "product"
of = ["t", "switches"]
[design.t]
factors = ["torque_n_m"]
[design.switches]
kind = "ablation"
combinations = "single"
halved = true
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""


@pytest.mark.parametrize("seed", range(3))
def test_halved_frictions_are_those_of_half_the_coefficient_on_drive_and_coast(make_cube, seed):
    """Exact: the change in percent is that of two simulated points, one with half of the coefficient.

    Regression: the headline was "the shares by switching off leave a closure of -17.5 %".
    """
    random = np.random.default_rng(seed)
    base = {"model": "equilibrium", "joint_angle_deg": random.uniform(6, 14), "initial_skew_1_deg": 0.5}
    base |= {
        "groove_sliding_friction": random.uniform(0.03, 0.08),
        "needle_sliding_friction": random.uniform(0.01, 0.04),
    }
    table = "".join(f"{name} = {value!r}\n" for name, value in base.items()).replace("'", '"')
    cube = make_cube(f'[study]\nname = "h"\n[base]\n{table}{SIDES}')
    result = contribution_shares(cube)
    for torque in (-120, 120):
        whole = td.simulate(torque_n_m=torque, **base)["thrust_amplitude"]
        for name in ("groove_sliding", "needle_sliding"):
            half = base | {f"{name}_friction": base[f"{name}_friction"] / 2}
            if name == "groove_sliding":
                half["groove_spin_friction"] = base["groove_sliding_friction"]
            changed = td.simulate(torque_n_m=torque, **half)["thrust_amplitude"]
            expected = 100 * (changed / whole - 1).sel(order=[2, 3])
            told = result["change_halved"].sel(mechanism=name, torque_n_m=torque, order=[2, 3])
            assert told.values == pytest.approx(expected.values, abs=1e-3)
    third = contributions({"c": result})[0]
    sentence = contribution_findings(third)[0]
    assert sentence.startswith("With half of one friction alone, the third order (")
    drive, coast = (
        float(result["change_halved"].sel(mechanism="groove_sliding", torque_n_m=t, order=3)) for t in (120, -120)
    )
    assert f"groove sliding {drive:.1f} % (drive) and {coast:.1f} % (coast)" in sentence
    assert sentence.index("groove sliding") < sentence.index("needle sliding")
    assert "closure" not in "".join(contribution_findings(third))


def test_both_ends_of_a_change_have_their_sign():
    assert signed(np.array([3.1, 67.3])) == "+3.1 to +67.3 %"
    assert signed(np.array([-3.1, 0.0, 67.3])) == "-3.1 to +67.3 %"
    assert signed(np.array([0.0])) == "0.0 %"


@pytest.mark.parametrize(
    ("factors", "rest"),
    first_fast(
        [
            (["groove_sliding", "needle_sliding"], "mechanisms that this study does not"),
            (None, "is not due to friction"),
        ],
        1,
    ),
)
def test_the_rest_beside_some_mechanisms_is_not_that_of_no_friction(tmp_path, factors, rest):
    """Regression: 10.8 % were said to be inertia and numerical error, where groove rolling made 7.2 % of them."""
    study = {
        "study": {"name": "some"},
        "base": {"joint_angle_deg": 9, "initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.2},
        "design": {"kind": "ablation"} | ({"factors": factors} if factors else {}),
        "keep": {"outputs": ["thrust_amplitude", "thrust_phase_deg", "thrust_part_amplitude", "thrust_part_phase_deg"]},
        "analysis": {"contribution": {}},
    }
    said = " ".join(td.run(study, tmp_path / "out", workers=0, progress=False).answers)
    assert rest in said


def test_where_all_mechanisms_oppose_the_sum_nothing_stands_before_them(uneven):
    """Regression: "Of y, by ...: ; x with -100.0 % opposes the sum"."""
    (part,) = contributions({"shares": contribution_shares(uneven, ContributionSettings(output="y"))})
    less = replace(part, shares={name: -np.abs(values) - 1 for name, values in part.shares.items()})
    (said,) = (each for each in contribution_findings(less) if each.startswith("Of y"))
    assert ": ;" not in said
    assert "oppose the sum" in said
