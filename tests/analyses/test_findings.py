from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.analyses.findings import find
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.main_effects.main_effects import factor_effects
from tripod_doe.analyses.main_effects.sentences import effects_on, find_effects
from tripod_doe.analyses.registry import findings_of
from tripod_doe.analyses.sensitivity.charts import rotation_charts
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.main_outputs import OutputPart, quantile_text
from tripod_doe.page_parts.main_results import main_effect, responses
from tripod_doe.page_parts.tables import cost_rows
from tripod_doe.page_parts.words import factor_text

LINE = """
[study]
name = "Line"
function = "report_functions:line"
[factors]
x = {{ values = [1, 2, 3, 4] }}
z = {{ values = [0.1, 0.2] }}
[base]
offset = {offset}
"""


def test_dominant_order_is_that_of_the_cube(grid_cube):
    mean = grid_cube["thrust_amplitude"].mean(["joint_angle_deg", "torque_n_m"])
    first = find(grid_cube)[0]
    assert first.startswith("The third order of the thrust force is the largest")
    assert f"{float(mean.sel(order=3)):.3g} N on average" in first
    assert f"ninth order with {float(mean.sel(order=9)):.3g} N" in first


def test_a_mean_over_models_is_that_of_no_joint(grid_cube):
    """Regression: "117 N on average over the study" of six points of one model and six of another."""
    both = xr.concat([grid_cube, grid_cube], "model", data_vars="all", combine_attrs="override")
    both = both.assign_coords(model=["equilibrium", "rollers"])
    factor = xr.DataArray([1.0, 2.0], dims="model")
    both["thrust_amplitude"] = both["thrust_amplitude"] * factor
    mean = float(grid_cube["thrust_amplitude"].sel(order=3).mean())
    ninth = float(grid_cube["thrust_amplitude"].sel(order=9).mean())
    said = find(both)[0]
    assert f"{mean:.3g} to {2 * mean:.3g} N on average over the study, depending on the model" in said
    assert f"ninth order with {ninth:.3g} to {2 * ninth:.3g} N" in said
    amplitude = both[
        "thrust_amplitude"
    ].copy()  # one model has no answer at the smallest angle: means of different points
    amplitude[1, 0] = np.nan
    holes = both.assign(thrust_amplitude=amplitude, outcome=both["outcome"].where(amplitude[..., 0].notnull(), 3))
    mean = float(grid_cube["thrust_amplitude"].sel(order=3).isel(joint_angle_deg=slice(1, None)).mean())
    wanted = f"{mean:.3g} to {2 * mean:.3g} N on average over the points that all models have, depending on the model"
    assert wanted in find(holes)[0]


def test_means_of_models_over_other_points_are_not_said_to_depend_on_the_model(make_cube):
    """Regression: "7.5 to 14.4 N on average over the study, depending on the model", of one at small, one at large angles."""
    text = """
[study]
name = "Listed"
[factors]
joint_angle_deg = {{ values = [4, 6, {last}] }}
model = {{ values = ["equilibrium", "equilibrium", "kinetostatic"] }}
[design]
kind = "zip"
[keep]
outputs = ["thrust_amplitude"]
"""
    assert " N on average, each model over points of its own; the next" in find(make_cube(text.format(last=12)))[0]
    said = find(make_cube(text.format(last=6)))[0]
    assert " N on average over the points that all models have, depending on the model; the next" in said


def test_slope_over_joint_angle_is_that_of_a_fit_to_the_cube(grid_cube):
    mean = grid_cube["thrust_amplitude"].sel(order=3).mean("torque_n_m")
    slope = np.polyfit(grid_cube["joint_angle_deg"], mean, 1)[0]
    assert any(
        f"increases with joint angle by {slope:.3g} N per deg (4 to 12 deg, averaged over torque" in s
        for s in find(grid_cube)
    )


def test_proportion_is_distinguished_from_a_straight_line(make_cube):
    assert any("y is proportional to x: 3 per 1 (1 to 4" in s for s in find(make_cube(LINE.format(offset=0))))
    assert any("y increases with x by 3 per 1 (1 to 4" in s for s in find(make_cube(LINE.format(offset=5))))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([9.5, 44.0, 66.0, 87.0, 109.0, 131.0, 152.0], "y increases with x"),
        ([21.0, 44.0, 66.0, 87.0, 109.0, 131.0, 152.0], "y is nearly proportional to x: 109 per 10 (2 to 14, "),
        ([12 + 100 * k for k in range(1, 8)], "proportional to x: 512 per 10 (2 to 14, averaged over z; R2 = 0.99"),
        ([1.0, 1.000001, 1.00002], "from 1 (at 2) to 1.00002 (at 6)"),
    ],
)
def test_a_proportion_holds_at_each_level(make_cube, values, said):
    """Regression: "nearly proportional, 10.9 N per deg" with 9.5 N at 2 deg; "decreases from 113 N to 113 N"."""
    cube = make_cube(LINE.format(offset=0).replace("[1, 2, 3, 4]", str([2 * at + 2 for at in range(len(values))])))
    cube["y"] = cube["y"] * 0 + xr.DataArray(np.array(values), dims="x")
    assert any(said in s for s in find(cube)), find(cube)


def test_drive_is_compared_with_coast(make_cube):
    """Exact: |x - 0.6 |x|| / 10 is 1.6 at 1 and 0.4 at -1 of the same size: four times."""
    cube = make_cube(SIZES.format(values=[-450, -150, 150, 450], bend=0.5))
    x = cube["x"]
    cube["y"] = cube["y"] * 0 + np.abs(x) * (1 + 0.6 * np.sign(x))
    assert any("; at 450 it is 4 times as large as at -450" in s for s in find(cube)), find(cube)


def test_a_single_factor_within_the_numerical_error_names_no_others(make_cube):
    """Regression: "beyond its numerical error (), but at single settings of the other factors the change reaches"."""
    cube = make_cube(LINE.format(offset=0).replace("values = [0.1, 0.2]", "values = [0.1]"))
    cube["y"] = cube["y"] * 0 + xr.DataArray([1.0, 1.2, 1.1, 1.0], dims="x")
    (response,) = (replace(each, error=5.0) for each in responses(cube))
    told = list(find_effects(response, cube, effects_on(response, cube)))
    assert told == ["y changes with x by up to 0.2, not beyond its numerical error."]


def test_means_of_models_are_listed_where_an_error_may_hide_their_difference(make_cube):
    """Regression: "does not depend on model beyond its numerical error": 0, 1.57, 0.03 N, two without an error."""
    cube = make_cube(LINE.format(offset=0)).assign_coords(z=["equilibrium", "rollers"])
    means = xr.DataArray([0.25, 1.57], dims="z")
    cube["y"] = cube["y"] * 0 + means + 4 * (cube["x"] == 1) * xr.DataArray([1, -1], dims="z")
    (response,) = (replace(each, error=5.0) for each in responses(cube))
    said = [s for s in find_effects(response, cube, effects_on(response, cube)) if s.startswith("Over z")]
    assert said
    assert (
        "the mean of y is 1.25 (equilibrium) and 0.57 (rollers), averaged over x; the largest known numerical "
        "error" in said[0]
    )


def test_a_small_effect_is_compared_with_the_value_there_as_well(make_cube):
    """Regression: "change the third order by at most 4 % of its range" where they change it by 58 % at a small angle."""
    cube = make_cube(SIZES.format(values=[2, 8, 14], bend=0.5))
    cube["y"] = cube["y"] * 0 + cube["x"] ** 2 + 2 * (cube["z"] > 0)
    said = [s for s in find(cube) if s.startswith("z ")]
    assert said == [
        "z changes y by at most 2 % of its range, and by up to 34 % of its value there, at any setting of the other "
        "factors that was computed."
    ]
    cube["y"].attrs["units"] = "dB"  # of which no part is known
    assert not any("of its value there" in s for s in find(cube))


SIGNS = """
[study]
name = "signs"
function = "report_functions:cubic"
[factors.x]
values = {values}
"""


def test_values_of_both_signs_are_not_told_as_a_size(make_cube):
    """From -310 to 9 a larger value is a smaller size; of one value of each sign nothing is known in between."""
    two, more = (find(make_cube(SIGNS.format(values=values))) for values in ([-310, 9], [-310, -200, 9]))
    assert any("Over x, y lies between" in s and "(at -310)" in s and "(at 9)" in s for s in two)
    assert not any("creases with x" in s or "proportional" in s for s in two)
    assert any(s.startswith("y increases with x (with its sign), from ") for s in more)


SIZES = """
[study]
name = "sizes"
function = "report_functions:vee"
[factors]
x = {{ values = {values} }}
z = {{ values = [0, {bend}] }}
"""


@pytest.mark.parametrize(
    ("values", "bend", "told"),
    [
        ([-6, -2, 2, 6], 1e-6, "Over x, y rises on both sides of zero, symmetrically: 2 at -2 and 2, 6 at -6 and 6, "),
        ([-900, 700, 2200], 1, "Over x, y rises on both sides of zero: 855 at -900, and 735 at 700 to 2310 at 2200, "),
        ([-9, 0, 4], 1, "Over x, y is smallest, 0, at 0 and rises on both sides: 8.55 at -9, 4.2 at 4, "),
    ],
)
def test_between_drive_and_coast_no_value_is_the_smallest(make_cube, values, bend, told):
    """Regression: "smallest, 58.5 N, at 700 N m and grows to both sides: 72.8 N at -900 N m", with none at 0 N m."""
    assert any(s.startswith(told) for s in find(make_cube(SIZES.format(values=values, bend=bend))))


def test_more_of_a_negative_value_is_told_with_its_sign(make_cube):
    """Regression: "the third order decreases with torque" for a joint in coast, where it grows with its size."""
    text = SIZES.replace("values = {values}", "low = -9, high = -1").replace(
        "values = [0, {bend}]", "low = 0, high = 1"
    )
    text += "[design]\nkind = 'saltelli'\nsamples = 8\n"
    (told,) = [s for s in find(make_cube(text.format())) if "alone, y decreases" in s]
    assert "y decreases with x (with its sign), by up to " in told


def test_orders_that_are_nothing_but_error_do_not_compete(grid_cube):
    """Regression: at 8 of 32 points of a straight joint "another order is larger", by 1e-9 N."""
    cube = grid_cube.copy(deep=True)
    amplitude = cube["thrust_amplitude"]
    assert "another order is larger" not in find(cube)[0]
    amplitude[0, 0] = 1e-9 * np.arange(13) * float(amplitude.max())
    assert "another order is larger" not in find(cube)[0]
    amplitude[0, 0] = 1e-3 * np.arange(13) * float(amplitude.max())
    assert "at 1 of" in find(cube)[0]
    cube["thrust_amplitude_error"] = xr.full_like(amplitude, 0.1 * float(amplitude.max()))
    assert "another order is larger" not in find(cube)[0]


def test_factors_with_their_values_read_as_words():
    """Regression: "initial skew 1 2 deg", and "step nan s" where a table leaves it open."""
    cube = xr.Dataset(
        coords={
            "initial_skew_1_deg": ("point", [2.0], {"units": "degree"}),
            "step_s": ("point", [np.nan], {"units": "s"}),
            "torque_n_m": ("point", [50.0], {"units": "N m"}),
        }
    )
    told = [factor_text(cube, str(name), cube[name].item()) for name in cube.coords]
    assert told == ["initial skew 1 = 2 deg", "step not given", "torque 50 N m"]
    assert factor_text(cube, "step_s", "nan") == "step not given"
    assert factor_text(cube, "step_s", "0.001") == "step 0.001 s"


def test_repetitions_are_no_quantity_to_draw_over(make_cube):
    text = '[study]\nname = "r"\nfunction = "report_functions:noisy"\n[factors.replicate]\nvalues = [0, 1, 2]\n'
    cube = make_cube(text)
    assert effect_charts(cube) == []
    assert "y lies between 5 (at replicate 0) and 5.0002 (at replicate 2)." in find(cube)


def test_a_factor_without_effect_is_said_to_have_none(make_cube):
    assert "z has no effect on y, at any setting of the other factors that was computed." in find(
        make_cube(LINE.format(offset=0))
    )


def test_a_user_variable_has_no_article(make_cube):
    assert not any(re.search(r"\b(The|the|a) (y|x|z)\b", s) for s in find(make_cube(LINE.format(offset=0))))


def test_failures_are_counted_and_named(joint_cube):
    found = find(joint_cube)
    at = found.index("12 of 24 points did not finish: 12 jammed.")
    assert found[at : at + 2] == [
        "12 of 24 points did not finish: 12 jammed.",
        "All of them are close together: points fail where needle_count > 28 (12 of the 12 points there, 0 elsewhere).",
    ]


def test_notes_on_finished_points_are_stated(joint_cube):
    noted = xr.where(joint_cube["outcome"] == 0, "it hums", joint_cube["outcome_detail"])
    assert find(joint_cube.assign(outcome_detail=noted))[-1] == (
        "12 points finished with a note (outcome_detail), the first: it hums."
    )


def test_an_infinite_answer_is_counted_and_not_drawn(make_cube):
    """Regression: "internal error", since an axis cannot end at infinity."""
    cube = make_cube(LINE.format(offset=0))
    cube["y"][0, 0], cube["y"][1, 0] = np.inf, np.nan
    told = find(cube)
    assert told[:2] == [
        "y lies between 3 (at x 1, z 0.2) and 12 (at x 4, z 0.1).",
        "y has no finite value at 2 of 8 finished points.",
    ]
    assert effect_charts(cube)


def test_a_region_between_two_values_is_told_as_one(make_cube):
    """Regression: "Most of them ...: points fail where x < 2.65 and x > 0.15 (8 of the 8 points there, 0 elsewhere)"."""
    text = SIZES.format(values=[0, 1, 2, 5, 9, 10], bend="0.5, 1, 2, 3, 4, 5, 6, 7")
    cube = make_cube(text)
    cube["outcome"][2] = td.Outcome.DIVERGED
    cube["y"][2] = np.nan
    told = [s for s in find(cube) if "points fail" in s]
    assert told == [
        "All of them are close together: points fail where 1.5 < x < 3.5 (9 of the 9 points there, 0 elsewhere)."
    ]


def test_failures_come_first_where_they_are_the_rule(make_cube):
    cube = make_cube(LINE.format(offset=0), part=slice(0, 3))
    assert find(cube)[0] == "5 of 8 points are not computed yet."


def test_cells_that_a_constraint_excludes_are_no_failures(make_cube):
    cube = make_cube(LINE.format(offset=0) + '[design]\nconstraints = ["x > 1.5"]\n', part=slice(0, 5))
    assert find(cube)[-1] == "1 of 6 points is not computed yet."


def test_no_finished_point(make_cube):
    cube = make_cube('[study]\nname = "F"\nfunction = "report_functions:failing"\n[factors]\nx = { values = [1, 2] }\n')
    assert find(cube) == ["None of 2 points finished: 2 error."]


def test_one_at_a_time_effects_leave_out_the_points_of_other_factors(make_cube):
    cube = make_cube(
        """
        [study]
        name = "One"
        [factors.torque_n_m]
        values = [25, 50, 100]
        [factors.joint_angle_deg]
        values = [4, 8]
        [design]
        kind = "one-at-a-time"
        [keep]
        outputs = ["thrust_amplitude"]
        """
    )
    third = cube["thrust_amplitude"].sel(order=3)
    own = third.where((cube["varied"] == "torque_n_m") & (cube["torque_n_m"] == 50), drop=True).item()
    effect = main_effect(responses(cube)[0], cube, "torque_n_m")
    assert effect.level == pytest.approx([25, 50, 100])
    assert effect.mean[1] == pytest.approx(own)
    assert any("others at their base values" in sentence for sentence in find(cube))


ZIP = """
[study]
name = "Zip"
[factors]
joint_angle_deg = { values = [5, 10, 15] }
torque_n_m = { values = [400, 200, 100] }
[design]
kind = "zip"
[keep]
outputs = ["thrust_amplitude"]
"""
SKEWS = """
[study]
name = "Skews"
[base]
model = "equilibrium"
[factors]
initial_skew_1_deg = { low = -0.7, high = 0.7, count = 7 }
torque_n_m = { values = [50, 100] }
[keep]
outputs = ["thrust_amplitude"]
"""
ISHIGAMI = """
[study]
name = "Ishigami"
function = "report_functions:ishigami"
[factors]
x1 = { low = -3.14159, high = 3.14159 }
x2 = { low = -3.14159, high = 3.14159 }
x3 = { low = -3.14159, high = 3.14159 }
[design]
kind = "saltelli"
samples = 64
"""


def test_factors_that_change_together_are_not_told_apart(make_cube):
    told = " ".join(find(make_cube(ZIP)))
    assert "Joint angle and torque change together in this design, which does not separate their effects" in told
    assert not re.search(r"(increases|decreases|proportional|averaged)", told)


def test_a_one_way_course_is_stated_at_both_ends(make_cube):
    """Regression: "from 589,000 (at 10 mm/s) to 32,600 (at 233 mm/s)" of values up to 1000 mm/s, level from 233 on."""
    cube = make_cube(SIZES.format(values=[1, 2, 3, 4], bend=1e-9))
    values = np.broadcast_to(np.array([9.0, 2.0, 2.0 + 1e-12, 2.0 + 2e-12])[:, None], cube["y"].shape)
    (told,) = [s for s in find(cube.assign(y=cube["y"].copy(data=values))) if "decreases with x" in s]
    assert told.startswith("y decreases with x, from 9 (at 1) to 2 (at 4)")


def test_too_few_points_for_a_regression_is_not_said_to_confound_factors(make_cube):
    """Regression: "does not separate the effects: there are too few points" beside an analysis that does."""
    text = ISHIGAMI.replace('"saltelli"\nsamples = 64', '"plackett-burman"')
    told = find(make_cube(text))
    assert not any("does not separate" in s for s in told)
    assert any(s.endswith("regression on all factors, which would give the effects of x1, x2 and x3.") for s in told)


def test_an_effect_of_both_signs_of_the_skew_is_symmetric(make_cube):
    (told,) = [s for s in find(make_cube(SKEWS)) if "initial skew 1, the second order" in s]
    assert re.match(
        r"Over initial skew 1, the second order is smallest, 0 N, at 0 deg and rises on both sides, "
        r"symmetrically: 0\.\d+ N at -0\.7 deg and 0\.7 deg, averaged over torque\.$",
        told,
    )


def test_few_points_show_a_bend_where_a_trend_is_none(make_cube):
    told = find(
        make_cube(
            """
            [study]
            name = "Vee"
            function = "report_functions:vee"
            [factors]
            x = { low = -1, high = 1 }
            z = { low = -1, high = 1 }
            [design]
            kind = "latin-hypercube"
            samples = 40
            """
        )
    )
    assert any(s.startswith("By regression on all factors, y is curved over x: the ends lie 0.9") for s in told)
    assert any(
        " points resolve no trend or curvature of y over z by a regression that takes interactions for scatter; they "
        in sentence
        for sentence in told
    )


def test_a_factor_that_acts_by_interaction_alone_is_not_said_to_have_no_effect(make_cube):
    """The total index of x3 in the Ishigami function is 0.24, its mean effect zero."""
    (told,) = [s for s in find(make_cube(ISHIGAMI)) if "no single direction" in s]
    assert re.search(r"x3 with its sign \(\d+, \d+ of 256; ", told)


def test_factors_without_a_single_direction_share_a_sentence(make_cube):
    """Regression: a Saltelli study of a joint had twelve sentences of this kind, one per factor and order."""
    (told,) = [s for s in find(make_cube(ISHIGAMI)) if "pairs of points" in s]
    steps, most = r"with its sign \(\d+, \d+ of 256; ([\d.]+)\)", r"by up to ([\d.]+)\)"
    first = (
        r"x1 with its sign \(with a larger value, it increases in \d+ and decreases in \d+ of 256 pairs of points that"
    )
    found = re.fullmatch(
        rf"y has no single direction over {first} differ in this factor alone, {most}, x3 {steps} and x2 {steps}\.",
        told,
    )
    assert found
    assert sorted(map(float, found.groups()), reverse=True) == list(map(float, found.groups()))


def test_changes_within_the_numerical_error_are_told_as_such(make_cube):
    cube = make_cube(ISHIGAMI)
    (response,) = responses(cube)
    far, near = (replace(response, error=error) for error in (1e3, 1e-3))
    (told,) = [s for s in find_effects(far, cube, effects_on(far, cube)[:1]) if "alone" in s]
    assert told.startswith("In 256 pairs")
    assert told.endswith("not beyond its numerical error.")
    (told,) = [s for s in find_effects(near, cube, effects_on(near, cube)[:1]) if "alone" in s]
    assert told.startswith("y has no single direction over x1")


def test_a_change_within_the_numerical_error_is_not_called_no_effect(make_cube):
    """Regression: "speed has no effect on the second order", where one of three models changed it by 10 %."""
    cube = make_cube(SIZES.format(values=[1, 2, 900], bend=0.5))
    (response,) = (replace(each, error=50.0) for each in responses(cube))
    (told,) = [s for s in find_effects(response, cube, effects_on(response, cube)) if s.startswith("z ")]
    assert told == (
        "z changes y by at most 5 % of its range, not beyond its numerical error, at any setting of the other factors "
        "that was computed."
    )


def sobol_result() -> xr.Dataset:
    index = np.array([[0.1, np.nan], [0.7, np.nan]])
    half = np.array([[0.1, np.nan], [0.05, np.nan]])
    dims = "factor", "order"
    return xr.Dataset(
        {"S1": (dims, index), "S1_conf": (dims, half), "ST": (dims, index), "ST_conf": (dims, half)},
        coords={"factor": ["torque_n_m", "joint_angle_deg"], "order": [3, 2]},
        attrs={"analysis_kind": "sobol"},
    )


def test_the_largest_index_is_named_and_orders_without_numbers_are_left_out():
    sentences = findings_of("mine", sobol_result())
    assert len(sentences) == 1
    assert "Total Sobol' indices of the third order: joint angle 0.7 +- 0.05; all others at most 0.2; " in sentences[0]
    assert (
        "the first-order indices add up to 0.8 +- 0.11: interactions explain at least 8 % of the variance"
        in sentences[0]
    )
    assert "(analysis mine)" in sentences[0]


@pytest.mark.parametrize(
    ("first", "half", "said"),
    [
        ((0.1, 0.72), (0.1, 0.2), "interactions may explain up to 41 % of the variance"),
        ((0.1, 0.7), (0.1, 0.05), "interactions explain at least 8 % of the variance"),
        ((0.4, 0.6), (0, 0), "interactions explain nothing"),
        ((0.4, np.nan), (np.nan, np.nan), "what interactions explain is not known"),
    ],
)
def test_what_first_order_indices_leave_to_interactions(first, half, said):
    """Exact: 1 - (0.82 - hypot(0.1, 0.2)) = 0.404, rounded up. Regression: "no interaction shows" of 18 %."""
    result = sobol_result().copy(deep=True)
    for key, numbers in (("S1", first), ("S1_conf", half)):
        result[key].loc[{"order": 3}] = np.array(numbers)
    assert findings_of("mine", result)[0].endswith(f"{said} (analysis mine).")


def test_indices_of_what_does_not_vary_are_told_and_not_drawn():
    """Regression: of a straight joint the analysis said nothing, and its page began with an empty figure."""
    still = sobol_result()
    still = still.where(np.isnan(still)).assign(thrust_ST=(("factor", "rotation_deg"), np.full((2, 9), np.nan)))
    still = still.assign_coords(rotation_deg=np.arange(9.0))
    assert findings_of("mine", still) == [
        "The main outputs are the same at all points: no factor has an index (analysis mine)."
    ]
    assert rotation_charts("mine", still) == []
    assert len(rotation_charts("mine", still.fillna(0.5))) == 1


def test_main_effect_of_a_sampled_factor_is_the_mean_of_its_classes(make_cube):
    cube = make_cube(
        """
        [study]
        name = "Sampled"
        function = "report_functions:uneven"
        [factors]
        x = { low = 0, high = 1 }
        z = { low = 0, high = 1 }
        [design]
        kind = "latin-hypercube"
        samples = 1000
        """
    )
    effect = main_effect(responses(cube)[0], cube, "x")
    assert effect.sampled
    assert effect.count.sum() == 1000
    lowest = cube["y"].values[cube["x"].values < np.quantile(cube["x"], 0.1)]
    assert effect.mean[0] == pytest.approx(lowest.mean())
    assert effect.lower[0] == pytest.approx(np.quantile(lowest, 0.25))


STILL = """
[study]
name = "Speed"
[base]
model = "{model}"
[factors]
speed_rpm = {{ values = [300, 600, 1200] }}
[keep]
outputs = ["thrust_amplitude"]
"""


def test_an_effect_that_the_model_leaves_out_is_told_as_such(make_cube):
    """The third order of `equilibrium` does not change with speed, since it has no inertia; others have it."""
    told = "The effect of speed is incomplete: this model has no inertia."
    assert told in find(make_cube(STILL.format(model="equilibrium")))
    assert told not in find(make_cube(STILL.format(model="kinetostatic")))


def test_a_response_keeps_the_spelling_of_its_name(make_cube):
    """Regression: "The thrust3 kN lies between"."""
    told = find(make_cube(LINE.format(offset=1) + '[responses.thrust3_kN]\nformula = "y / 1000"\n'))
    assert any(sentence.startswith("thrust3_kN lies between") for sentence in told)
    assert any(sentence.startswith("thrust3_kN increases with x") for sentence in told)
    assert not any("thrust3 kN" in sentence for sentence in told)


def test_a_factor_that_the_model_does_not_represent_is_named(make_cube):
    """Regression: a Morris study ranked such factors last, and a page nowhere said that the model leaves them out."""
    told = "Output inertia is not represented by model kinetostatic: all of its values give the same thrust."
    text = STILL.replace("speed_rpm", "output_inertia_kg_m2").replace("300, 600, 1200", "0.01, 0.02")
    assert told in find(make_cube(text.format(model="kinetostatic")))


def test_steps_across_zero_are_judged_by_the_size_of_the_factor():
    """Regression: "no single direction over torque" of trajectories whose steps cross zero, where both sides grow."""
    torque = np.array([-150.0, 50, -150, 50, -50, 150, -50, 150])
    other = np.array([1.0, 1, 2, 2, 3, 3, 4, 4])
    for least, told in ((0.5, True), (0.1, False)):  # at a tenth, 50 N m of drive give more than 150 of coast
        coast = np.where(other == 1, least, 0.5)
        value = other * np.where(torque < 0, coast, 1.0) * np.abs(torque)
        (effect, _) = factor_effects({"torque": torque, "other": other}, value)
        assert np.isfinite(effect.outward) == told
        assert effect.both_ways != told
        assert not told or (effect.crossing and effect.settings == effect.rising == 4)
    # none of the four pairs is on one side of zero, and a fifth that is makes no rule
    more = np.append(torque, [50.0, 150]), np.append(other, [9.0, 9]), np.append(value, [1.0, 2])
    (effect, _) = factor_effects({"torque": more[0], "other": more[1]}, more[2])
    assert np.isnan(effect.outward)


def test_points_that_repeat_others_are_computed_and_counted_once(make_cube):
    """Regression: costs, averages and notes counted a point of a list twice that was computed once."""
    once = make_cube(ZIP)
    twice = once.isel(point=[0, 1, 2, 2, 2, 2])
    for cube in (once, twice):
        cube["outcome_detail"] = ("point", np.full(cube.sizes["point"], "a note", object))
    assert cost_rows(twice) == cost_rows(once)
    assert [s for s in find(twice) if "largest" in s or "a note" in s] == [
        s for s in find(once) if "largest" in s or "a note" in s
    ]


def test_effects_in_a_multifidelity_study_are_those_of_the_truth(tmp_path):
    """Regression: a mean over 100,000 points of a model without second order and 800 of one with it told of neither."""
    (tmp_path / "two.py").write_text('def f(x, z, level):\n    return {"y": x + z if level == "fine" else 0.0}\n')
    (tmp_path / "two.toml").write_text(
        '[study]\nname = "two"\nquestion = "?"\nfunction = "two:f"\n[factors]\nx = {low = 0, high = 2}\n'
        'z = {low = 0, high = 2}\nlevel = {values = ["rough", "fine"]}\n[design]\nkind = "multifidelity"\nfidelity = "level"\n'
        "samples = 40\nindices = false\nsplit = {rough = 400, fine = 40}\n"
    )
    td.run(tmp_path / "two.toml", tmp_path / "out", workers=0, progress=False)
    with td.open_cube(tmp_path / "out") as cube:
        told = find(cube)
        fine = cube["y"].values[cube["level"].values == "fine"]
    of = "the 40 points by fine, which counts as the truth."
    assert f"Ranges of results, effects of factors and their figures refer to {of}" in told
    assert told[0].startswith(f"y lies between {fine.min():.3g} (at x ")
    assert not [sentence for sentence in told if "over level" in sentence.lower()]
    page = (tmp_path / "out" / "report" / "index.html").read_text(encoding="utf-8")
    assert f"<p>Of {of}</p>" in page


def test_points_of_the_truth_that_failed_are_not_counted(tmp_path):
    """Regression: "the average of the 60 points" of which 45 had finished; and dropped points that were no total."""
    (tmp_path / "part.py").write_text(
        "def f(x, level):\n    if x > 1.5:\n        raise ValueError('no')\n    return {'y': x + (level == 'fine')}\n"
    )
    (tmp_path / "part.toml").write_text(
        '[study]\nname = "part"\nfunction = "part:f"\n[factors]\nx = {low = 0, high = 2}\n'
        'level = {values = ["rough", "other", "fine"]}\n[design]\nkind = "multifidelity"\nfidelity = "level"\n'
        "samples = 40\nindices = false\nsplit = {rough = 80, other = 40, fine = 40}\n"
        "[analysis.multifidelity]\nmost_dropped = 0.5\n"
    )
    td.run(tmp_path / "part.toml", tmp_path / "out", workers=0, progress=False)
    with td.open_cube(tmp_path / "out") as cube:
        total, finished = cube.sizes["point"], int((cube["outcome"].values[cube["level"].values == "fine"] == 0).sum())
        assert 20 < finished < 40
        assert any(f"refer to the {finished} finished points by fine, which counts" in told for told in find(cube))
    with td.open_cube(tmp_path / "out" / "analysis" / "multifidelity.nc") as found:
        assert found.attrs["points_used"] + found.attrs["points_dropped"] == total == 160
        assert found.attrs["points_used"] == int(found["samples"].sum())


def test_a_quantile_says_how_far_the_points_bound_it():
    """Exact: both ends, one, none; without them a quantile of few points reads as if it were known."""
    ends = {
        "quantile": [1.0, 2, 3, 4],
        "quantile_low": [0.5, np.nan, 2, np.nan],
        "quantile_high": [1.5, 2.5, np.nan, np.nan],
    }
    answers = xr.Dataset(
        {key: ("probability", values) for key, values in ends.items()}, {"probability": [0.1, 0.2, 0.9, 0.99]}
    )
    assert quantile_text(OutputPart("y", "y", "N", answers)) == (
        "10 % below 1 N (0.5 to 1.5), 20 % below 2 N (at most 2.5), 90 % below 3 N (at least 2), 99 % below 4 N (too few "
        "points for an interval)"
    )


def test_a_torque_of_two_signs_is_drive_and_coast(make_cube):
    """Regression: "Torque changes the third order by at most 5 %" of its two signs."""
    text = """
[study]
name = "t"
[base]
model = "equilibrium"
[factors]
joint_angle_deg = {values = [3, 6, 9]}
torque_n_m = {values = [-60, 60]}
[keep]
outputs = ["thrust_amplitude"]
"""
    said = " ".join(find(make_cube(text)))
    assert "Drive in place of coast changes the third order by at most " in said
    assert "Torque changes" not in said


def test_steps_of_finite_differences_are_no_small_effects(tmp_path):
    """Regression: "a, b and c change y by at most 2 % of its range" of the factor that causes nearly all of it."""
    (tmp_path / "square.py").write_text("def f(a, b=0.0, c=0.0):\n    return {'y': a * a + b * c}\n")
    factors = "".join(f"[factors.{name}]\nlow = 0\nhigh = 1\n" for name in "abc")
    text = f'[study]\nname = "f"\nfunction = "square:f"\n{factors}[design]\nkind = "finite-differences"\nsamples = 64\n'
    (tmp_path / "s.toml").write_text(text)
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    (said,) = td.find(td.open_cube(tmp_path / "out"))
    assert said.startswith("y lies between ")


@pytest.mark.parametrize(("pairs", "which"), [(1, "the only two points"), (2, "any two points")])
def test_a_pair_is_not_called_any_two_points(pairs, which):
    """Regression: one pair of equal sizes of torque stood for any two points."""
    a = np.arange(4.0)
    columns = {"a": np.r_[a, a[:pairs]], "b": np.r_[5.0 + a, 9.0 + a[:pairs]]}
    cube = xr.Dataset(
        {"y": ("point", columns["a"]), "outcome": ("point", np.zeros(4 + pairs, np.int8))},
        coords={name: ("point", column, {"source": "user function"}) for name, column in columns.items()},
    )
    effects = factor_effects(columns, cube["y"].values)
    (response,) = responses(cube)
    said = list(find_effects(response, cube, [each for each in effects if each.factor == "b"]))
    assert said == [f"b has no effect on y between {which} that differ in it alone."]


def test_maps_name_the_words_of_a_third_factor():
    """Regression: the report of any grid of 3 x 3 numbers and two models ended with an internal error."""
    angles, torques = np.array([5.0, 8, 11]), np.array([40.0, 90, 120])
    third = np.multiply.outer(np.multiply.outer(angles, torques), [1.0, 1.1])
    source = {"source": "this study"}
    cube = xr.Dataset(
        {
            "thrust_amplitude": (
                ("joint_angle_deg", "torque_n_m", "model", "order"),
                third[..., None] * np.array([0, 0, 0.1, 1]),
                {"units": "N"},
            ),
            "outcome": (("joint_angle_deg", "torque_n_m", "model"), np.full(third.shape, Outcome.FINISHED, np.int8)),
        },
        coords={
            "joint_angle_deg": ("joint_angle_deg", angles, {"units": "degree", **source}),
            "torque_n_m": ("torque_n_m", torques, {"units": "N m", **source}),
            "model": ("model", np.array(["kinetostatic", "equilibrium"], object), source),
            "order": np.arange(4),
        },
        attrs={"study": '[study]\nname = "t"\n'},
    )
    titles = [chart.title for group in effect_charts(cube) for chart in group.charts]
    assert {"kinetostatic", "equilibrium"} <= {word for title in titles for word in re.findall(r"\w+", title)}
