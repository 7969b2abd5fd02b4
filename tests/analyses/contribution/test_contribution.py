"""Contribution: known functions of switches give their known shares, and what is not known is flagged, never wrong."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.contribution.charts import contribution_charts
from tripod_doe.analyses.contribution.contribution import ContributionSettings, contribution_shares
from tripod_doe.analyses.contribution.sentences import contribution_notes, find_in_contribution
from tripod_doe.analyses.contribution.share_tables import contributions
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task, run_task
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.query.query import analyses_with, query, records
from tripod_doe.study.result_directory.open_cube import opened_cube
from tripod_doe.workflow.analyses import check_analyses, run_analyses

FUNCTIONS = """
import numpy as np
import xarray as xr
def additive(a, b, c, load=1.0):
    return {"y": load * (5 * a + 4 * b + c)}
def paired(a, b, c):
    return {"y": 6 * a + 2 * b * c + 2 * c}
def gate(a, b, c):
    return {"y": a * (6 + 4 * b)}
def lonely(a, b, c):
    return {"y": 6 * a}
def offset(a, b, c):
    return {"y": 1 + 12 * a - 3 * b}
def orders(a, b, c, load=1.0):
    z = np.array([0.0, load * (10 * a + 2j * b - 3 * c), 0.0, 1e-9 * a, 1j * b])
    return xr.Dataset(
        {"force_amplitude": ("order", abs(z)), "force_phase_deg": ("order", np.degrees(np.angle(z)))},
        coords={"order": np.arange(5)},
    )
def split(a, b, c, load=1.0):
    parts = load * np.array([[0.0, 6 * a], [0.0, (2 + 2j) * b], [0.0, -c], [0.0, 1.0]])
    whole = parts.sum(axis=0)
    return xr.Dataset(
        {
            "force_amplitude": ("order", abs(whole)), "force_phase_deg": ("order", np.degrees(np.angle(whole))),
            "force_part_amplitude": (("part", "order"), abs(parts)),
            "force_part_phase_deg": (("part", "order"), np.degrees(np.angle(parts))),
        },
        coords={"order": np.arange(2), "part": ["a", "b", "c", "remainder"]},
    )
def split_rms(a, b, c):
    whole = split(a, b, c)
    return whole.assign(force_rms=whole["force_amplitude"] * [1, 0.5**0.5], force=("angle", [1.0 + a, 2.0]))
def patchy(a, b, c, load):
    if (load, a, b, c) in [(2, 0, 1, 1), (3, 0, 1, 1), (3, 1, 1, 1)] or (load > 1 and (a, b, c) == (0, 1, 0)):
        raise ValueError("lost")
    return {"y": load * (5 * a + 4 * b + c + load * a * b)}
def listed(a, b, c, load, d):
    return additive(a, b, c, load)
def failing(a, b, c):
    if (a, b, c) == (1, 0, 1):
        raise ValueError("lost")
    return additive(a, b, c)
"""

NAMES = ["a", "b", "c"]


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("contribution")
    (folder / "contribution_functions.py").write_text(FUNCTIONS)
    return folder


@pytest.fixture(scope="session")
def ablate(folder):
    def make(function: str, design: str = "", more: str = "") -> xr.Dataset:
        """The cube of an ablation of a, b and c."""
        text = f'[study]\nname = "t"\nfunction = "contribution_functions:{function}"\n' + (
            more or f'[design]\nkind = "ablation"\nfactors = ["a", "b", "c"]\n{design}\n'
        )
        study = parse_study(text, folder=StudyFolder(folder))
        points = make_points(study)
        keys = point_keys(study, points)
        result, cpu, wall = run_task(make_task(study, points, np.arange(points.count)))
        return build_cube(study, points, keys, iter([FinishedBlock(keys, result, cpu, wall, "0")]))[0]

    return make


CROSSED = """
[factors]
load = {{ values = [3, -2] }}
{factors}
[design]
kind = "product"
of = ["load", "switches"]
[design.load]
{load}
factors = {names}
[design.switches]
kind = "ablation"
factors = ["a", "b", "c"]
"""


@pytest.mark.parametrize("combinations", ["all", "single"])
def test_an_additive_function_has_its_terms_by_every_definition(ablate, combinations):
    """Exact: 5 a + 4 b + c is 50, 40 and 10 % by any definition, and all adds up."""
    result = contribution_shares(
        ablate("additive", f'combinations = "{combinations}"'), ContributionSettings(output="y")
    )
    assert list(result["mechanism"].values) == NAMES
    for name in ("share_off", "share_on", *(["share_shapley"] if combinations == "all" else [])):
        assert result[name].values == pytest.approx([50, 40, 10])
        assert result[name].attrs["units"] == "percent"
        assert not result[f"{name}_flag"].any()
    assert float(result["closure"]) == pytest.approx(0, abs=1e-12)
    assert float(result["share_none"]) == 0
    assert ("share_shapley" in result) == ("interaction" in result) == (combinations == "all")


def test_a_pair_that_works_only_together_is_split_evenly(ablate):
    """Exact: of 6 a + 2 b c + 2 c = 10, switching off counts the 2 of b and c twice, on alone never, Shapley halves it."""
    result = contribution_shares(ablate("paired"), ContributionSettings(output="y"))
    assert result["share_off"].values == pytest.approx([60, 20, 40])
    assert result["share_on"].values == pytest.approx([60, 0, 20])
    assert result["share_shapley"].values == pytest.approx([60, 10, 30])
    assert float(result["closure"]) == pytest.approx(-20)
    assert result["strongest_pair"].item() == "b + c"
    assert float(result["strongest_interaction"]) == pytest.approx(20)
    assert result["interaction"].sel(pair=["a + b", "a + c"]).values == pytest.approx([0, 0])


@pytest.mark.parametrize(("function", "said"), [("gate", True), ("lonely", False)])
def test_a_joint_contribution_is_divided_only_where_there_is_one(ablate, function, said):
    """Regression: "so the others get about half of their shares", where all others had none."""
    (part,) = contributions({"c": contribution_shares(ablate(function), ContributionSettings(output="y"))})
    (note,) = (note for note in contribution_notes(part) if note.startswith("All of y depends on a"))
    assert ("the others get about half" in note) == said


def test_shapley_values_add_up_to_all_less_none_and_an_opponent_is_negative(ablate):
    """Exact: 1 + 12 a - 3 b = 10."""
    result = contribution_shares(ablate("offset"), ContributionSettings(output="y"))
    assert float(result["share_none"]) == pytest.approx(10)
    assert float(result["share_shapley"].sum()) == pytest.approx(90)
    assert result["share_shapley"].values == pytest.approx([120, -30, 0])
    assert result["share_off"].values == pytest.approx([120, -30, 0])
    assert result["share_on"].values == pytest.approx([130, -20, 10])


@pytest.mark.parametrize(
    ("attributes", "reason"),
    [({"units": "dB"}, "level"), ({"formula": "20 * log10(y)"}, "level"), ({"wraps_at": "+-180 degree"}, "phase")],
)
def test_a_level_and_a_phase_have_no_shares(ablate, attributes, reason):
    """Regression: 6 dB of 12 dB is no half, and a level of nothing, -infinite, was a zero within its error."""
    cube = ablate("offset")
    cube["y"].attrs.update(attributes)
    with pytest.raises(InputError, match=f"'y' is a {reason}, whose zero is arbitrary"):
        contribution_shares(cube, ContributionSettings(output="y"))


def test_a_response_without_a_finite_value_is_missing_and_its_numerical_error_counts(ablate):
    """Exact: of 5 a + 4 b + c the combination without b is infinite; an error of 20 hides the whole."""
    cube = ablate("additive")
    cube["y"] = cube["y"].where(~((cube["a"] == 1) & (cube["b"] == 0) & (cube["c"] == 1)), -np.inf)
    result = contribution_shares(cube, ContributionSettings(output="y"))
    assert result["share_off"].values == pytest.approx([50, np.nan, 10], nan_ok=True)
    assert result["share_off_flag"].values.tolist() == [0, 2, 0]
    cube["y_error"] = xr.full_like(cube["y"], 20.0)
    hidden = contribution_shares(cube, ContributionSettings(output="y"))
    assert float(hidden["amplitude_error"]) == 20
    assert (hidden["share_off_flag"] == 1).all()


def test_shapley_values_add_up_for_any_function(ablate):
    """Invariance: the sum of Shapley values is P(all) - P(none), and interactions are symmetric means of differences."""
    data = ablate("additive")
    data["y"][:] = np.random.default_rng(1).normal(size=8)
    result = contribution_shares(data, ContributionSettings(output="y"))
    assert float(result["share_shapley"].sum()) == pytest.approx(100 - float(result["share_none"]))
    by_order = []
    part = {tuple(int(data[n][i]) for n in NAMES): 100 * float(data["y"][i] / data["y"][0]) for i in range(8)}
    for order in itertools.permutations(range(3)):
        before = [0, 0, 0]
        for which in order:
            value = part[tuple(before)]
            before[which] = 1
            if which == 1:
                by_order.append(part[tuple(before)] - value)
    assert float(result["share_shapley"].sel(mechanism="b")) == pytest.approx(np.mean(by_order))


def test_amplitudes_are_complex_and_zero_ones_are_flagged(ablate):
    """Exact: of A = 10 a + 2i b - 3 c the whole is 7 + 2i; shares are projections on it. An order of zero has none."""
    result = contribution_shares(ablate("orders"), ContributionSettings(output="force_amplitude"))
    assert result["share_off"].dims == ("mechanism", "order")
    whole = 7 + 2j
    expected = [100 * (term * whole.conjugate()).real / abs(whole) ** 2 for term in (10, 2j, -3)]
    for name in ("share_off", "share_on", "share_shapley"):
        assert result[name].sel(order=1).values == pytest.approx(expected)
        assert result[name].sel(order=[0, 2, 3]).isnull().all()
        assert result[f"{name}_flag"].sel(mechanism="a").values.tolist() == [1, 0, 1, 1, 0]
    assert expected[2] < 0
    assert result["amplitude"].sel(order=1).item() == pytest.approx(abs(whole))
    assert not result["amplitude_flag"].any()
    assert result["closure_flag"].attrs["flag_meanings"] == "valid zero_amplitude point_missing"
    assert result["strongest_pair"].sel(order=2).item() == ""


def test_parts_are_of_the_amplitude_also_where_the_effective_value_is_shared_out(ablate):
    """Exact. Regression: parts of an effective value were 1.41 times too large; a waveform beside them was an error."""
    cube = ablate("split_rms")
    shares = [contribution_shares(cube, ContributionSettings(output=f"force_{each}")) for each in ("amplitude", "rms")]
    assert np.isfinite(shares[0]["share_direct"].sel(order=1)).all()
    xr.testing.assert_allclose(shares[0]["share_direct"], shares[1]["share_direct"])
    xr.testing.assert_allclose(shares[0]["direct_remainder"], shares[1]["direct_remainder"])
    of_force = contribution_shares(cube, ContributionSettings(output="force"))
    assert "share_direct" not in of_force
    assert "share_direct" not in of_force.attrs["left_out"]
    assert np.isfinite(of_force["share_off"].isel(angle=0)).all()


def test_models_that_differ_between_combinations_are_stated(ablate):
    """Regression: shares of combinations that retries or a pilot gave other models stood there in silence."""
    text = CROSSED.format(factors="", load="", names='["load"]')
    cube = ablate("orders", more=text)
    words = {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "none coarse fine"}
    one = cube.assign(model_used=("point", np.zeros(16, np.int8), words))
    settings = ContributionSettings(output="force_amplitude")
    result = contribution_shares(one, settings)
    assert result.attrs["model"] == "coarse"
    assert not any("several models" in text for text in find_in_contribution(result, "c"))
    # regression: where a pilot chose one model, an order that it was not chosen for was stated
    chosen = one.assign(
        accuracy_met=("point", np.ones(16, np.int8)),
        thrust_amplitude=one["force_amplitude"],
        thrust_amplitude_3_error_estimate=("point", np.full(16, 0.1)),
    )
    assert contribution_shares(chosen, settings).attrs["orders_asked"] == "3"
    assert "orders_asked" not in contribution_shares(one, settings).attrs
    several = cube.assign(model_used=("point", np.array([0] * 9 + [1] * 7, np.int8), words))
    result = contribution_shares(several, settings)
    assert result.attrs["model"] == ""
    assert find_in_contribution(result, "c")[-1] == (
        "At 1 of 2 operating points the combinations of mechanisms have several models (coarse, fine): shares and "
        "changes there hold what these models differ by, too (analysis c)."
    )
    asked = several.assign(
        accuracy_met=("point", np.ones(16, np.int8)),
        thrust_amplitude=several["force_amplitude"],
        thrust_amplitude_3_error_estimate=("point", np.zeros(16)),
    )
    assert [part.key for part in contributions({"c": contribution_shares(asked, settings)})] == ["c-order-3"]


def test_a_statement_counts_the_operating_points_that_it_is_made_of(ablate):
    """Exact: share_off(a) = 100 (5 + load) / (10 + load) is known at loads 1, 4, 5 and 6, nothing at load 3.

    Regression: six points were said to have the medians, also where one of the three shares was not known.
    """
    text = CROSSED.format(factors="", load="", names='["load"]').replace("[3, -2]", "[1, 2, 3, 4, 5, 6]")
    result = contribution_shares(ablate("patchy", more=text), ContributionSettings(output="y"))
    said = find_in_contribution(result, "c")
    known = [100 * (5 + load) / (10 + load) for load in (1, 4, 5, 6)]
    low, middle, high = np.quantile(known, (0.25, 0.5, 0.75))
    assert f"median (and quartiles) over 4 operating points: a {middle:.1f} % ({low:.1f} to {high:.1f})" in said[1]
    assert "over 4 operating points" in said[0]
    assert said[2].startswith("At 1 of 6 operating points y has no shares, since points that they need")
    assert said[3].startswith("At 1 of 6 operating points y lacks some shares by switching off, since")


def test_zero_and_missing_together_are_both_a_reason(ablate):
    """Regression: an order that is zero at some points, and not known at others, was called unknown at all."""
    cube = ablate("orders", more=CROSSED.format(factors="", load="", names='["load"]'))
    cube["outcome"][0] = Outcome.DIVERGED
    second = contributions({"c": contribution_shares(cube, ContributionSettings(output="force_amplitude"))})[1]
    assert second.missing == (
        "at 1 operating point of 2 its amplitude is zero within its error, at the others points that they need did not "
        "finish or have no value"
    )


def test_an_amplitude_below_its_scatter_is_flagged(ablate):
    data = ablate("orders")
    data["force_amplitude_scatter"] = xr.full_like(data["force_amplitude"], 2.0)  # order 4 is 1
    result = contribution_shares(data, ContributionSettings(output="force_amplitude"))
    assert result["closure_flag"].values.tolist() == [1, 0, 1, 1, 1]


def test_a_failed_point_takes_out_the_shares_that_need_it_and_no_others(ablate):
    result = contribution_shares(ablate("failing"), ContributionSettings(output="y"))
    assert np.isnan(result["share_off"].values).tolist() == [False, True, False]
    assert result["share_off_flag"].values.tolist() == [0, 2, 0]
    assert result["share_off"].values[[0, 2]] == pytest.approx([50, 10])
    assert result["share_on"].values == pytest.approx([50, 40, 10])
    for name in ("share_shapley", "closure", "strongest_interaction"):
        assert result[name].isnull().all()
        assert (result[f"{name}_flag"] == 2).all()
    assert result["strongest_pair"].item() == ""


def test_a_missing_combination_is_named_and_leaves_bounds(ablate):
    """Exact: P of "a + c" may be anything from 0 to 100 %; each mechanism takes part of it with the weight 2! / 3! or
    1 / 3!, b by being added to it, a and c by adding it. The true values lie within the bounds."""
    result = contribution_shares(ablate("failing"), ContributionSettings(output="y"))
    assert result["missing_combinations"].item() == "a + c"
    low, high = result["share_shapley_low"].values, result["share_shapley_high"].values
    assert high - low == pytest.approx([100 / 6, 100 / 3, 100 / 6])
    assert (low <= [50, 40, 10]).all()
    assert (high >= [50, 40, 10]).all()
    whole = contribution_shares(ablate("additive"), ContributionSettings(output="y"))
    assert whole["missing_combinations"].item() == ""
    for name in ("share_shapley_low", "share_shapley_high"):
        assert whole[name].values == pytest.approx(whole["share_shapley"].values)


def test_without_the_whole_nothing_has_a_share(ablate):
    data = ablate("additive")
    data["outcome"][0] = Outcome.DIVERGED
    result = contribution_shares(data, ContributionSettings(output="y"))
    for name in ("share_off", "share_on", "share_shapley", "share_shapley_low", "amplitude", "share_none"):
        assert result[name].isnull().all()
        assert (result[f"{name}_flag"] == 2).all()


def test_operating_points_stand_in_front(ablate):
    text = CROSSED.format(factors="", load="", names='["load"]')
    result = contribution_shares(ablate("orders", more=text), ContributionSettings(output="force_amplitude"))
    assert result["share_shapley"].dims == ("load", "mechanism", "order")
    assert result["load"].values.tolist() == [3, -2]
    assert result["amplitude"].sel(order=1).values == pytest.approx([3 * 53**0.5, 2 * 53**0.5])
    one = contribution_shares(ablate("orders"), ContributionSettings(output="force_amplitude"))
    for load in (3, -2):
        both = [data["share_off"].sel(order=1).values for data in (result.sel(load=load), one)]
        assert both[0] == pytest.approx(both[1])


def test_operating_points_that_fill_no_grid_are_listed(ablate):
    text = CROSSED.format(factors="d = { values = [1, 2] }", load='kind = "zip"', names='["load", "d"]')
    result = contribution_shares(ablate("listed", more=text), ContributionSettings(output="y"))
    assert result["share_off"].dims == ("operating_point", "mechanism")
    assert result["load"].dims == ("operating_point",)
    assert result["d"].values.tolist() == [1, 2]
    assert result["share_off"].values == pytest.approx(np.array([[50, 40, 10], [50, 40, 10]]))


def test_operating_points_with_the_same_open_field_are_one(ablate):
    """Regression: each point with an open field was an operating point of its own, whose shares "did not finish"."""
    text = CROSSED.format(factors="d = { values = [1, 2] }", load='kind = "zip"', names='["load", "d"]')
    cube = ablate("listed", more=text)
    open_fields = cube["d"].variable.copy(data=np.where(cube["d"] == 1, np.nan, cube["d"]))
    result = contribution_shares(cube.assign_coords(d=open_fields), ContributionSettings(output="y"))
    assert result["d"].values == pytest.approx([np.nan, 2], nan_ok=True)
    assert result["share_off"].values == pytest.approx(np.array([[50, 40, 10], [50, 40, 10]]))
    [part] = contributions({"c": result})
    assert part.labels == ["load 3, d not given", "load -2, d 2"]


def test_bars_beside_long_names_stay_bars_and_zeros_are_not_missing(ablate):
    """Regression: five factors in a name left no room for bars; an amplitude of zero was "points are missing"."""
    text = CROSSED.format(factors="d = { values = [1, 2] }", load='kind = "zip"', names='["load", "d"]')
    cube = ablate("listed", more=text.replace("[3, -2]", "[3, 0]"))
    [part] = contributions({"c": contribution_shares(cube, ContributionSettings(output="y"))})
    labels = [f"{label}, groove sliding friction 0.06, groove spin friction 0.02" for label in part.labels]
    chart = contribution_charts(replace(part, labels=labels))[0]
    chart.svg()
    [axes] = chart.figure.axes
    assert axes.get_position().width > 0.4
    texts = [text.get_text() for text in axes.texts]
    assert "no shares: it is zero" in texts
    assert "incomplete: points are missing" not in texts


def test_the_joint_has_all_its_shares(tmp_path):
    """The effective value's shares are the amplitude's; without groove sliding there is no thrust in this model."""
    text = (
        '[study]\nname = "j"\n[base]\ninitial_skew_1_deg = 0.4\n[design]\nkind = "ablation"\n'
        'factors = ["groove_sliding", "groove_rolling", "needle_sliding"]\n[analysis.contribution]\n'
    )
    study = parse_study(text)
    check_analyses(study)
    points = make_points(study)
    keys = point_keys(study, points)
    result, cpu, wall = run_task(make_task(study, points, np.arange(points.count)))
    cube = build_cube(study, points, keys, iter([FinishedBlock(keys, result, cpu, wall, "0")]))[0]
    assert run_analyses(study, cube, tmp_path, lambda: None) == {"contribution": ""}
    assert analyses_with(tmp_path, "share_off") == [tmp_path / "analysis" / "contribution.nc"]
    assert analyses_with(tmp_path, "share") == []
    with opened_cube(tmp_path / "analysis" / "contribution.nc") as stored:
        answer = records(stored, "share_off", ["order=3"])
    assert answer["mechanism"].tolist() == ["groove_sliding", "groove_rolling", "needle_sliding"]
    shares = contribution_shares(cube)
    assert answer["share_off"].tolist() == shares["share_off"].sel(order=3).values.tolist()
    rms = contribution_shares(cube, ContributionSettings(output="thrust_rms"))
    assert rms["share_shapley"].sel(order=3).values == pytest.approx(shares["share_shapley"].sel(order=3).values)
    assert float(shares["share_off"].sel(mechanism="groove_sliding", order=3)) == pytest.approx(100)
    assert float(shares["share_shapley"].sel(order=3).sum()) == pytest.approx(
        100 - float(shares["share_none"].sel(order=3))
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '[design]\nkind="ablation"\n[analysis.contribution]\nouput="y"',
            r"\[analysis.contribution\]: unknown key 'ouput'; did you mean 'output'",
        ),
        (
            '[design]\nkind="ablation"\n[keep]\noutputs=["thrust_amplitude"]\n[analysis.contribution]',
            r"\[analysis.contribution\]: phase: 'thrust_phase_deg' is not kept; add it",
        ),
        (
            '[design]\nkind="morris"\nsamples=4\n[factors.joint_angle_deg]\nlow=4\nhigh=9\n[analysis.morris]\noutputs=["thrust_amplitude_3"]',
            "write 'thrust_amplitude', the answer has all orders",
        ),
        (
            '[design]\nkind="morris"\nsamples=4\n[factors.joint_angle_deg]\nlow=4\nhigh=9\n[analysis.morris]\noutputs=["thrust_amplitud"]',
            "unknown output 'thrust_amplitud'; did you mean 'thrust_amplitude'",
        ),
        (
            "[factors]\nspeed_rpm={values=[1, 2]}\n[analysis.contribution]",
            "contribution needs a design of kind ablation, or a product with one; this study's is grid",
        ),
        (
            '[design]\nkind="product"\n[design.ops]\n[design.off]\nkind="ablation"\n[analysis.contribution]',
            r'\[design\]: a product needs of = \["ops", "off"\], the names of two or more sub-designs',
        ),
        (
            '[design]\nkind="product"\nof=["ops"]\n[design.ops]\n[analysis.contribution]',
            r"a product needs of = \[...\], the names of two or more sub-designs, each with a table",
        ),
        (
            '[design]\nkind="product"\nof=["a", "b"]\n[design.a]\n[design.b]\n[analysis.contribution]',
            "this study's is a product of grid and grid",
        ),
        (
            '[design]\nkind="ablation"\n[analysis.sobol]',
            "sobol needs a design of kind saltelli; this study's is ablation",
        ),
        ('[design]\nkind="ablation"\n[analysis.shares]\nkind="contributions"', "did you mean 'contribution'"),
    ],
)
def test_bad_settings_are_named_before_anything_runs(text, message):
    with pytest.raises(InputError, match=message):
        check_analyses(parse_study('[study]\nname = "b"\n' + text))


def test_a_cube_that_cannot_answer_says_so(ablate):
    data = ablate("additive")
    with pytest.raises(InputError, match="output: 'thrust_amplitude' is not in the cube; allowed: y"):
        contribution_shares(data)
    with pytest.raises(InputError, match="phase: 'p' is not in the cube"):
        contribution_shares(data, ContributionSettings(output="y", phase="p"))
    in_rad = data.assign(p=data["y"].assign_attrs(units="rad"))
    with pytest.raises(InputError, match="phase: 'p' is in rad; give it in degree"):
        contribution_shares(in_rad, ContributionSettings(output="y", phase="p"))
    del data["a"].attrs["role"], data["b"].attrs["role"], data["c"].attrs["role"]
    with pytest.raises(InputError, match="needs the cube of an ablation"):
        contribution_shares(data, ContributionSettings(output="y"))


def test_direct_shares_are_the_projected_parts_with_all_on(ablate):
    """Exact physics: A_all = 8 + 2j of 6, 2 + 2j, -1 and a remainder of 1; where parts are linear, off agrees."""
    result = contribution_shares(ablate("split"), ContributionSettings(output="force_amplitude")).sel(order=1)
    expected = 100 * np.array([48, 20, -8]) / 68
    assert result["share_direct"].values == pytest.approx(expected, rel=1e-12)
    assert float(result["direct_remainder"]) == pytest.approx(100 * 8 / 68, rel=1e-12)
    assert result["share_off"].values == pytest.approx(expected, rel=1e-12)


def test_direct_shares_of_no_amplitude_are_flagged(ablate):
    """Order 0 is zero: there is nothing to share."""
    result = contribution_shares(ablate("split"), ContributionSettings(output="force_amplitude")).sel(order=0)
    assert np.isnan(result["share_direct"]).all()
    assert (result["share_direct_flag"] == 1).all()


def test_cubes_without_parts_have_no_direct_shares(ablate):
    result = contribution_shares(ablate("orders"), ContributionSettings(output="force_amplitude"))
    assert "share_direct" not in result
    with pytest.raises(InputError, match="must keep force_part_amplitude and force_part_phase_deg, under"):
        query(result, "share_direct")
    assert "share_shapley: " not in result.left_out
