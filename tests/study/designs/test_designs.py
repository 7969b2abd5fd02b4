"""Designs: the points that a study promises, always the same ones."""

from __future__ import annotations

import numpy as np
import pydoe
import pytest
import SALib.sample.morris

from tripod_doe.errors import InputError
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.definition.study_file import load_study, parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points, unit_sample
from tripod_doe.study.fingerprints import point_keys

HEAD = '[study]\nname = "d"\n'


def points_of(text, folder=None):
    return make_points(parse_study(HEAD + text, folder=StudyFolder(folder) if folder else None))


def keys_of(text):
    study = parse_study(HEAD + text)
    return point_keys(study, make_points(study))


def test_grid_runs_in_file_order():
    points = points_of("[factors]\ntorque_n_m = {values = [50, 25]}\njoint_angle_deg = {low = 4, high = 8, count = 3}")
    assert points.dims == ("torque_n_m", "joint_angle_deg")
    assert points.shape == (2, 3)
    assert points.columns["torque_n_m"].tolist() == [50, 50, 50, 25, 25, 25]
    assert points.columns["joint_angle_deg"].tolist() == [4, 6, 8, 4, 6, 8]


@pytest.mark.parametrize(
    ("values", "axis"), [([50, 100, 25, 75], [25, 50, 75, 100]), ([100, 50, 25], [100, 50, 25]), ([7], [7])]
)
def test_the_axes_of_a_grid_are_sorted(values, axis):
    """Regression: a grid that grew had its axis in the order of arrival, and no range could be selected."""
    study = parse_study(
        f'[study]\nname = "g"\n[factors]\ntorque_n_m = {{values = {values}}}\nmodel = {{values = ["rollers", "equilibrium"]}}\n'
    )
    points = make_points(study)
    cube, _ = build_cube(study, points, point_keys(study, points), iter([]))
    assert cube["torque_n_m"].values.tolist() == axis
    assert cube["model"].values.tolist() == ["rollers", "equilibrium"]
    assert points.columns["torque_n_m"].reshape(points.shape)[:, 0].tolist() == axis
    ends = (axis[0], axis[-1])
    assert cube.sel(torque_n_m=slice(*ends)).sizes["torque_n_m"] == len(axis)


def test_logarithmic_levels():
    points = points_of('[factors]\nspeed_rpm = {low = 10, high = 1000, count = 3, scale = "log"}')
    assert points.columns["speed_rpm"] == pytest.approx([10, 100, 1000])


def test_a_logarithmic_scale_is_sampled_log_uniformly():
    """Exact: every decade of 10 .. 1000 gets half of 64 latin hypercube samples."""
    points = points_of(
        '[factors]\nspeed_rpm = {low = 10, high = 1000, scale = "log"}\n'
        '[design]\nkind = "latin-hypercube"\nsamples = 64'
    )
    assert (points.columns["speed_rpm"] < 100).sum() == 32


def test_the_trajectories_of_a_study_are_made_once_for_it_and_its_analysis(monkeypatch):
    made, sample = [], SALib.sample.morris.sample
    monkeypatch.setattr(
        SALib.sample.morris, "sample", lambda *arguments, **named: made.append(1) or sample(*arguments, **named)
    )
    text = (
        HEAD + "[factors]\njoint_angle_deg = {low = 4, high = 12}\ntorque_n_m = {low = 50, high = 150}\n"
        '[design]\nkind = "morris"\nsamples = 5\nseed = '
    )
    for seed in (2701, 2702):
        study = parse_study(f"{text}{seed}")
        points = make_points(study)
        unit = unit_sample(study.file.design, study.file.factors)
        np.testing.assert_allclose(points.columns["joint_angle_deg"], 4 + 8 * unit[:, 0])
    assert len(made) == 2


def test_a_morris_design_meets_the_ends_of_its_ranges():
    """Regression: the ends were moved inwards by 1e-12 of the range, and tables showed 10.00000000009."""
    points = points_of(
        "[factors]\ntorque_n_m = {low = 10, high = 100}\nneedle_count = {low = 20, high = 29}\n"
        'speed_rpm = {low = 10, high = 1000, scale = "log"}\n[design]\nkind = "morris"\nsamples = 8\nlevels = 4'
    )
    assert set(points.columns["torque_n_m"].round(9)) == {10, 40, 70, 100}
    assert {points.columns["torque_n_m"].min(), points.columns["torque_n_m"].max()} == {10, 100}
    assert {points.columns["speed_rpm"].min(), points.columns["speed_rpm"].max()} == {10, 1000}
    assert {points.columns["needle_count"].min(), points.columns["needle_count"].max()} == {20, 29}


def test_zip_pairs_values():
    points = points_of(
        "[factors]\ninitial_skew_1_deg = {values = [1, 0]}\ninitial_skew_2_deg = {values = [-1, 0]}\n"
        '[design]\nkind = "zip"'
    )
    assert points.dims == ("point",)
    assert points.columns["initial_skew_2_deg"].tolist() == [-1, 0]


def test_one_at_a_time_comes_back_to_the_base():
    points = points_of(
        "[base]\ntorque_n_m = 60\n[factors]\njoint_angle_deg = {values = [5, 15]}\nspeed_rpm = {values = [300]}\n"
        '[design]\nkind = "one-at-a-time"'
    )
    assert points.columns["joint_angle_deg"].tolist() == [10, 5, 15, 10]
    assert points.columns["speed_rpm"].tolist() == [600, 600, 600, 300]
    assert points.labels["varied"].tolist() == ["base", "joint_angle_deg", "joint_angle_deg", "speed_rpm"]


def test_one_at_a_time_starts_from_base_values_of_its_factors():
    """Regression: a base value of a varied factor was refused, and defaults were taken without a word."""
    text = (
        "[base]\njoint_angle_deg = 7\n[factors]\njoint_angle_deg = {values = [5, 15]}\nspeed_rpm = {values = [300]}\n"
        '[design]\nkind = "one-at-a-time"'
    )
    points = points_of(text)
    assert points.columns["joint_angle_deg"].tolist() == [7, 5, 15, 7]
    assert points.columns["speed_rpm"].tolist() == [600, 600, 600, 300]
    assert points.notes == ("the base point has default values: speed_rpm = 600.0; set them in [base] for another",)
    assert points_of(text.replace("= 7\n", "= 7\nspeed_rpm = 450\n")).notes == ()
    assert keys_of(text)[0] != keys_of(text.replace("= 7\n", "= 8\n"))[0]


def test_the_base_point_of_a_product_s_part_comes_from_the_base_values():
    points = points_of(
        "[base]\njoint_angle_deg = 7\n[factors]\njoint_angle_deg = {values = [5]}\nspeed_rpm = {values = [300, 600]}\n"
        '[design]\nkind = "product"\nof = ["a", "b"]\n[design.a]\nkind = "one-at-a-time"\nfactors = ["joint_angle_deg"]\n'
        '[design.b]\nkind = "grid"\nfactors = ["speed_rpm"]\n'
    )
    assert points.columns["joint_angle_deg"].tolist() == [7, 7, 5, 5]
    with pytest.raises(InputError, match="speed_rpm is both a base value and a factor"):
        points_of(
            "[base]\nspeed_rpm = 500\n[factors]\njoint_angle_deg = {values = [5]}\nspeed_rpm = {values = [300]}\n"
            '[design]\nkind = "product"\nof = ["a", "b"]\n[design.a]\nkind = "one-at-a-time"\n'
            'factors = ["joint_angle_deg"]\n[design.b]\nkind = "grid"\nfactors = ["speed_rpm"]\n'
        )


def test_a_table_in_a_product_brings_its_own_factors(tmp_path):
    """Regression: each column of the table needed an empty [factors.X], which no page said."""
    (tmp_path / "cases.csv").write_text("joint_angle_deg,torque_n_m\n5,100\n8,300\n")
    points = points_of(
        "[factors]\nspeed_rpm = {values = [300, 600]}\n"
        '[design]\nkind = "product"\nof = ["a", "b"]\n[design.a]\nkind = "table"\ntable = "cases.csv"\n'
        '[design.b]\nkind = "grid"\nfactors = ["speed_rpm"]\n',
        tmp_path,
    )
    assert points.columns["joint_angle_deg"].tolist() == [5, 5, 8, 8]
    assert points.columns["torque_n_m"].tolist() == [100, 100, 300, 300]
    assert points.columns["speed_rpm"].tolist() == [300, 600, 300, 600]


def test_table_reads_its_columns(tmp_path):
    (tmp_path / "cases.csv").write_text("joint_angle_deg,model\n5,equilibrium\n7.5,equilibrium\n")
    points = points_of('[design]\nkind = "table"\ntable = "cases.csv"', tmp_path)
    assert points.columns["joint_angle_deg"].tolist() == [5, 7.5]
    assert points.columns["model"].tolist() == ["equilibrium", "equilibrium"]


@pytest.mark.parametrize("design", ['kind = "one-at-a-time"', 'kind = "table"\ntable = "cases.csv"'])
def test_points_whose_outputs_would_have_different_lengths_are_refused(tmp_path, design):
    """Regression: the base point of a one-at-a-time design, and columns of a table, were seen only when the study ran."""
    (tmp_path / "cases.csv").write_text("samples_per_revolution\n60\n360\n")
    text = f'[keep]\noutputs = ["{{}}"]\n[design]\n{design}\n'
    if "table" not in design:
        text += "[factors]\nsamples_per_revolution = {{values = [60]}}\n"  # 360 at the base point
    refused = r"\[design\]: samples_per_revolution takes 60 and 360, so thrust would have different lengths"
    with pytest.raises(InputError, match=refused):
        points_of(text.format("thrust"), tmp_path)
    assert points_of(text.format("thrust_amplitude"), tmp_path).count == 2


def test_the_choice_of_the_model_does_not_replace_columns_of_a_table(tmp_path):
    """Regression: joints of 11 needles ran with the 27 of the full model, beside a column that said 11."""
    (tmp_path / "joints.csv").write_text("needle_count,joint_angle_deg\n11,6\n20,8\n")
    text = '[base]\nmodel = "auto"\n[accuracy]\nthrust_amplitude_3 = 0.03\n{}[design]\nkind = "table"\ntable = "joints.csv"'
    with pytest.raises(InputError, match=r"would replace needle_count; .* add \[factors.needle_count\] without keys"):
        points_of(text.format(""), tmp_path)
    points = points_of(text.format("[factors.needle_count]\n"), tmp_path)
    assert points.columns["needle_count"].tolist() == [11, 20]


def test_an_empty_field_of_a_table_leaves_a_parameter_open(tmp_path):
    (tmp_path / "runs.csv").write_text("method,step_s,relative_tolerance\nbdf2,1e-5,\n,,1e-3\n")
    points = points_of('[base]\nmodel = "rollers"\n[design]\nkind = "table"\ntable = "runs.csv"', tmp_path)
    assert points.columns["method"].tolist() == ["bdf2", None]
    assert np.array_equal(points.columns["step_s"], [1e-5, np.nan], equal_nan=True)
    assert np.array_equal(points.columns["relative_tolerance"], [np.nan, 1e-3], equal_nan=True)
    (tmp_path / "runs.csv").write_text('torque_n_m\n50\n""\n')
    with pytest.raises(InputError, match="line 3: torque_n_m: this field is empty; its default would be 50"):
        points_of('[design]\nkind = "table"\ntable = "runs.csv"', tmp_path)


@pytest.mark.parametrize("kind", ["latin-hypercube", "sobol"])
def test_samples_fill_their_ranges_and_repeat(kind):
    text = (
        "[factors]\njoint_angle_deg = {low = 4, high = 14}\nneedle_count = {low = 20, high = 23}\n"
        f'[design]\nkind = "{kind}"\nsamples = 256\nseed = 5'
    )
    points, again = points_of(text), points_of(text)
    angle, needles = points.columns.values()
    assert np.array_equal(angle, again.columns["joint_angle_deg"])
    assert angle.min() >= 4
    assert angle.max() <= 14
    assert np.histogram(angle, 16, (4, 14))[0].tolist() == [16] * 16
    assert sorted(set(needles)) == [20, 21, 22, 23]


def test_sobol_sequence_keeps_its_points_when_it_grows():
    text = '[factors]\njoint_angle_deg = {low = 4, high = 14}\n[design]\nkind = "sobol"\nsamples = '
    assert np.array_equal(keys_of(text + "64")[:16], keys_of(text + "16"))


def test_distributions_have_their_moments():
    text = (
        '[factors]\ntorque_n_m = {distribution = "normal", mean = 50, std = 5}\n'
        'joint_angle_deg = {distribution = "truncated-normal", mean = 10, std = 5, low = 8, high = 12}\n'
        'speed_rpm = {distribution = "log-uniform", low = 10, high = 1000}\n'
        'groove_sliding_friction = {distribution = "triangular", low = 0.02, high = 0.08, mode = 0.05}\n'
        'needle_sliding_friction = {distribution = "discrete", values = [0.01, 0.03], weights = [1, 3]}\n'
        '[design]\nkind = "sobol"\nsamples = 1024'
    )
    columns = points_of(text).columns
    assert columns["torque_n_m"].mean() == pytest.approx(50, abs=0.05)
    assert columns["torque_n_m"].std() == pytest.approx(5, rel=0.02)
    assert 8 <= columns["joint_angle_deg"].min() < columns["joint_angle_deg"].max() <= 12
    assert np.log10(columns["speed_rpm"]).mean() == pytest.approx(2, abs=0.01)
    assert columns["groove_sliding_friction"].mean() == pytest.approx(0.05, abs=1e-4)
    assert (columns["needle_sliding_friction"] == 0.03).mean() == pytest.approx(0.75, abs=0.01)


def test_product_crosses_its_parts():
    points = points_of(
        "[factors]\njoint_angle_deg = {values = [5, 10]}\ninitial_skew_1_deg = {values = [1, 0]}\n"
        'initial_skew_2_deg = {values = [-1, 0]}\n[design]\nkind = "product"\nof = ["angle", "skew"]\n'
        '[design.angle]\nfactors = ["joint_angle_deg"]\n'
        '[design.skew]\nkind = "zip"\nfactors = ["initial_skew_1_deg", "initial_skew_2_deg"]'
    )
    rows = list(zip(*points.columns.values(), strict=True))
    assert rows == [(5, 1, -1), (5, 0, 0), (10, 1, -1), (10, 0, 0)]
    assert points.labels["skew_row"].tolist() == [0, 1, 0, 1]


def test_constraints_leave_points_out():
    grid = points_of(
        "[factors]\njoint_angle_deg = {values = [5, 10]}\ntorque_n_m = {values = [25, 50]}\n"
        '[design]\nconstraints = ["joint_angle_deg * torque_n_m < 400"]'
    )
    assert grid.allowed.tolist() == [True, True, True, False]
    sampled = points_of(
        "[factors]\njoint_angle_deg = {low = 5, high = 10}\ntorque_n_m = {low = 25, high = 50}\n"
        '[design]\nkind = "sobol"\nsamples = 64\nconstraints = ["joint_angle_deg > 7.5"]'
    )
    assert 20 < sampled.count < 44
    assert sampled.columns["joint_angle_deg"].min() > 7.5


def test_keys_know_a_point_by_its_values():
    base = keys_of("[base]\ntorque_n_m = 50\n[factors]\njoint_angle_deg = {values = [5]}")
    factor = keys_of("[factors]\njoint_angle_deg = {values = [5]}\ntorque_n_m = {values = [50, 60]}")
    assert base[0] == factor[0] != factor[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '[factors]\nspeed_rpm={values=[1,2]}\ntorque_n_m={values=[1]}\n[design]\nkind="zip"',
            "speed_rpm has 2, torque_n_m has 1",
        ),
        ("[factors]\nspeed_rpm={values=[1,1]}", "twice"),
        ("[factors]\nspeed_rpm={low=1,high=2}", "needs levels"),
        ('[factors]\nspeed_rpm={values=[1,2]}\n[design]\nkind="sobol"\nsamples=4', "samples; give low and high"),
        ('[factors]\nspeed_rpm={low=1,high=2}\n[design]\nkind="sobol"', "needs samples"),
        ('[factors]\nspeed_rpm={low=1,high=2}\n[design]\nkind="saltelli"\nsamples=100', "128"),
        (
            '[factors]\nspeed_rpm={distribution="normal",mean=1,std=1}\n[design]\nkind="sobol"\nsamples=64',
            "truncated-normal",
        ),
        ('[factors]\ntorque_n_m={distribution="normal",mean=1,std=1}\n[design]\nkind="morris"\nsamples=4', "bounded"),
        (
            '[factors]\ntorque_n_m={distribution="discrete",values=[1,2]}\n[design]\nkind="finite-differences"\nsamples=4',
            r"\[factors.torque_n_m\]: finite-differences needs continuous factors",
        ),
        (
            '[factors]\nneedle_count={low=20,high=27}\n[design]\nkind="finite-differences"\nsamples=4',
            r"\[factors.needle_count\]: finite-differences needs continuous factors",
        ),
        (
            '[factors]\nneedle_count={low=20,high=27}\n[design]\nkind="fast"\nsamples=65',
            r"\[factors.needle_count\]: fast needs continuous factors, and this one has levels; use a saltelli",
        ),
        ("[factors]\nspeed_rpm={values=[1]}\n[design]\nconstraints=['speed_rpm > 5']", "exclude every point"),
        ("[factors]\nspeed_rpm={values=[1]}\n[design]\nconstraints=['speed > 5']", "speed_rpm"),
        (
            '[factors]\nspeed_rpm={low=1,high=9}\n[design]\nkind="morris"\nsamples=4\nconstraints=["speed_rpm > 5"]',
            "cannot leave points out",
        ),
        ('[design]\nkind="table"\ntable="nowhere.csv"', "cannot read"),
        ("[design]\nkind='grid'", "no factors"),
        ('[factors]\nspeed_rpm={values=[1]}\n[design]\nkind="product"\nof=["a"]', "two or more sub-designs"),
        (
            '[factors]\nspeed_rpm={values=[1]}\n[design]\nkind="product"\nof=["a","b"]\n[design.a]\nfactors=["speed_rpm"]',
            r"design.b",
        ),
    ],
)
def test_designs_that_cannot_be_made(text, message):
    with pytest.raises(InputError, match=message):
        points_of(text)


def test_table_errors_name_line_and_column(tmp_path):
    (tmp_path / "a.csv").write_text("joint_angle_deg\n5\nmany\n")
    with pytest.raises(InputError, match=r"line 3: joint_angle_deg"):
        points_of('[design]\nkind = "table"\ntable = "a.csv"', tmp_path)
    (tmp_path / "b.csv").write_text("joint_angel_deg\n5\n")
    with pytest.raises(InputError, match="did you mean 'joint_angle_deg'"):
        points_of('[design]\nkind = "table"\ntable = "b.csv"', tmp_path)
    with pytest.raises(InputError, match="no column 'torque_n_m'"):
        points_of('[factors.torque_n_m]\n[design]\nkind = "table"\ntable = "b.csv"', tmp_path)


@pytest.mark.slow
def test_shipped_studies_make_points():
    for path in __import__("pathlib").Path("studies").glob("*.toml"):
        assert make_points(load_study(path)).count > 1


SWITCHES = ["groove_sliding", "groove_spinning", "groove_rolling", "needle_sliding", "needle_rolling"]


def test_an_ablation_switches_all_mechanisms_in_all_combinations():
    points = points_of('[design]\nkind = "ablation"')
    assert points.dims == ("point",)
    assert list(points.columns) == SWITCHES
    rows = list(zip(*points.columns.values(), strict=True))
    assert len(rows) == len(set(rows)) == 32
    assert (rows[0], rows[-1]) == ((1,) * 5, (0,) * 5)


def test_a_single_ablation_has_all_none_each_off_and_each_on():
    points = points_of('[design]\nkind = "ablation"\ncombinations = "single"')
    rows = list(zip(*points.columns.values(), strict=True))
    assert [sum(row) for row in rows] == [5, 0] + [4] * 5 + [1] * 5
    assert len(set(rows)) == 12
    two = points_of(
        '[design]\nkind = "ablation"\ncombinations = "single"\nfactors = ["groove_rolling", "needle_rolling"]'
    )
    assert list(two.columns) == ["groove_rolling", "needle_rolling"]
    assert two.count == 4  # with two, off alone is the other on alone


def test_an_ablation_takes_its_switches_from_the_factors():
    points = points_of(
        '[factors]\nneedle_rolling = {values = [0, 1]}\n[factors.groove_rolling]\n[design]\nkind = "ablation"'
    )
    assert list(points.columns) == ["needle_rolling", "groove_rolling"]


def test_an_ablation_is_crossed_with_operating_points():
    text = (
        "[factors]\njoint_angle_deg = {values = [5, 10]}\ninitial_skew_1_deg = {values = [1, 0]}\n"
        'initial_skew_2_deg = {values = [-1, 0]}\n[design]\nkind = "product"\nof = ["angle", "switches", "skew"]\n'
        '[design.angle]\nfactors = ["joint_angle_deg"]\n[design.switches]\nkind = "ablation"\n'
        '[design.skew]\nkind = "zip"\nfactors = ["initial_skew_1_deg", "initial_skew_2_deg"]'
    )
    points = points_of(text)
    assert points.count == 2 * 32 * 2
    assert parse_study(HEAD + text).switches == tuple(SWITCHES)
    assert np.unique(np.stack(list(points.columns.values())), axis=1).shape[1] == 128


def test_an_ablation_beside_other_factors_is_one_at_each_of_their_grid_points():
    factors = "[factors]\njoint_angle_deg = {values = [5, 10]}\ntorque_n_m = {values = [-50, 20, 80]}\n"
    product = (
        'kind = "product"\nof = ["operating", "mechanisms"]\n[design.operating]\n'
        'factors = ["joint_angle_deg", "torque_n_m"]\n[design.mechanisms]\nkind = "ablation"\n'
    )
    short, long = (points_of(f"{factors}[design]\n{design}") for design in ('kind = "ablation"', product))
    assert short.count == 2 * 3 * 32
    assert list(short.columns) == list(long.columns)
    assert all(np.array_equal(short.columns[name], long.columns[name]) for name in long.columns)
    named = points_of(f'{factors}[design]\nkind = "ablation"\ncombinations = "single"\nfactors = ["needle_rolling"]')
    assert named.count == 2 * 3 * 2
    halved = points_of(f'{factors}[design]\nkind = "ablation"\ncombinations = "single"\nhalved = true')
    assert halved.count == 2 * 3 * (12 + 5)
    assert [int((halved.columns[name] == 0.5).sum()) for name in SWITCHES] == [6] * 5
    assert parse_study(
        f'{HEAD}{factors}needle_sliding = {{values = [0, 1]}}\n[design]\nkind = "ablation"'
    ).switches == ("needle_sliding",)


def test_an_ablation_of_a_function_names_its_arguments(tmp_path):
    (tmp_path / "ablated.py").write_text("def f(a, b, load):\n    return {'y': load * (a + b)}\n")
    text = '[study]\nname = "f"\nfunction = "ablated:f"\n[base]\nload = 2\n[design]\nkind = "ablation"\n'
    points = make_points(parse_study(text + 'factors = ["a", "b"]', folder=StudyFolder(tmp_path)))
    assert list(zip(*points.columns.values(), strict=True)) == [(1, 1), (1, 0), (0, 1), (0, 0)]
    with pytest.raises(InputError, match=r"\[design\]: an ablation needs factors = "):
        parse_study(text, folder=StudyFolder(tmp_path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "ablation"\nfactors = ["groove_sliding", "needle_slidng"]', "did you mean 'needle_sliding'"),
        (
            'kind = "ablation"\nfactors = ["joint_angle_deg"]',
            r"joint_angle_deg is no switch \(those are groove_sliding.*needle_rolling\)",
        ),
        (
            'kind = "ablation"\n[factors]\ntorque_n_m = {low = 1, high = 2}',
            r"torque_n_m\]: this design needs levels; give values",
        ),
        ('kind = "ablation"\n[factors]\nneedle_rolling = {values = [1]}', r"needle_rolling.*values = \[0, 1\]"),
        ('kind = "ablation"\n[base]\nneedle_rolling = 0', "needle_rolling is both a base value and a factor"),
        ('kind = "ablation"\ncombinations = "some"', "combinations = 'some': unknown; allowed: all, single"),
        (
            'kind = "product"\nof = ["a", "b"]\n[design.a]\nkind = "ablation"\n[design.b]\nkind = "ablation"',
            "varied by",
        ),
    ],
)
def test_ablations_that_cannot_be_made(text, message):
    with pytest.raises(InputError, match=message):
        points_of(f"[design]\n{text}")


FOUR = (
    "[factors]\njoint_angle_deg = {low = 4, high = 14}\ntorque_n_m = {low = 25, high = 100}\n"
    "speed_rpm = {low = 300, high = 900}\ngroove_sliding_friction = {low = 0.03, high = 0.08}\n"
)


def coded(points):
    """Columns from -1 to 1, shape (point, factor)."""
    columns = np.stack(list(points.columns.values()), axis=1)
    low, high = columns.min(axis=0), columns.max(axis=0)
    return (2 * columns - low - high) / (high - low)


def test_a_fractional_factorial_has_its_resolution_and_tells_its_aliases():
    """Exact: orthogonal columns of two levels; resolution IV keeps each factor apart from products of two."""
    points = points_of(FOUR + '[design]\nkind = "fractional-factorial"\nresolution = 4')
    columns = coded(points)
    assert points.count == 8
    assert (columns.T @ columns == 8 * np.eye(4)).all()
    assert (np.prod(columns, axis=1) == columns[0].prod()).all()  # defining relation I = ABCD
    assert "resolution IV; it confounds joint_angle_deg:torque_n_m = speed_rpm:groove" in points.notes[0]
    full = points_of(FOUR + '[design]\nkind = "fractional-factorial"\nresolution = 5')
    assert full.count == 16
    assert "no effects of one factor or two are confounded" in full.notes[0]
    low = points_of(FOUR + '[design]\nkind = "fractional-factorial"\nresolution = 3')
    assert "resolution IV" in low.notes[0]  # the best that eight points can have


def test_a_fraction_of_the_highest_resolution_that_can_be_made_is_made(monkeypatch):
    """Regression: with 24 factors at resolution 8 the look for a better one ended in a ValueError, after 5 s."""
    made = pydoe.fracfact_by_res

    def at_most_four(factors, resolution):
        if resolution > 4:
            raise ValueError("no design could be constructed")
        return made(factors, resolution)

    monkeypatch.setattr(pydoe, "fracfact_by_res", at_most_four)
    assert points_of(FOUR + '[design]\nkind = "fractional-factorial"\nresolution = 4').count == 8
    with pytest.raises(InputError, match="resolution = 5: no design"):
        points_of(FOUR + '[design]\nkind = "fractional-factorial"\nresolution = 5')


def test_a_table_with_a_column_twice_is_refused(tmp_path):
    """Regression: the last one counted, in silence."""
    (tmp_path / "t.csv").write_text("torque_n_m,speed_rpm, torque_n_m\n1,2,3\n")
    with pytest.raises(InputError, match=r"t\.csv': column 'torque_n_m' occurs 2 times"):
        points_of('[design]\nkind = "table"\ntable = "t.csv"\n', tmp_path)


def test_a_table_whose_quote_never_ends_is_refused(tmp_path):
    (tmp_path / "t.csv").write_text('torque_n_m\n"1\n')
    with pytest.raises(InputError, match=r"t\.csv'?: .*unexpected end of data"):
        points_of('[design]\nkind = "table"\ntable = "t.csv"\n', tmp_path)


def test_a_full_factorial_takes_levels_words_and_ends():
    points = points_of(
        "[factors]\ntorque_n_m = {low = 25, high = 100}\nspeed_rpm = {values = [300, 600, 1200]}\n"
        'model = {values = ["equilibrium", "kinetostatic"]}\n[design]\nkind = "full-factorial"\nlevels = 4\n'
    )
    assert points.count == 4 * 3 * 2
    assert sorted(set(points.columns["torque_n_m"])) == [25, 50, 75, 100]
    assert set(points.columns["model"]) == {"equilibrium", "kinetostatic"}


@pytest.mark.parametrize(("width", "count"), [(3, 4), (4, 8), (7, 8), (11, 12)])
def test_plackett_burman_columns_are_orthogonal(width, count):
    """Exact: Plackett and Burman (1946)."""
    names = [
        name
        for name in parse_study(HEAD + FOUR).simulator.parameters
        if "friction" in name or "skew" in name or name in ("joint_angle_deg", "torque_n_m", "speed_rpm")
    ]
    text = "[factors]\n" + "".join(f"{name} = {{low = 0.01, high = 0.02}}\n" for name in names[:width])
    columns = coded(points_of(text + '[design]\nkind = "plackett-burman"'))
    assert columns.shape == (count, width)
    assert columns.T @ columns == pytest.approx(count * np.eye(width))


@pytest.mark.parametrize(
    ("star", "reach", "corner"), [("circumscribed", 2**0.5, 1), ("inscribed", 1, 2**-0.5), ("faced", 1, 1)]
)
def test_central_composite_stars_lie_where_they_are_asked_for(star, reach, corner):
    """Exact: of two factors, rotatable stars lie at sqrt 2 of the corners (Box and Wilson 1951)."""
    points = points_of(
        "[factors]\njoint_angle_deg = {low = 8, high = 12}\ntorque_n_m = {low = 40, high = 60}\n"
        f'[design]\nkind = "central-composite"\nstar = "{star}"\n'
    )
    angle = (points.columns["joint_angle_deg"] - 10) / 2
    assert points.count == 4 + 4 + 1
    levels = sorted({-reach, -corner, 0, corner, reach})
    assert sorted(set(angle.round(12))) == pytest.approx(levels)


def test_box_behnken_has_no_corner():
    """Exact: twelve edges of the cube and its centre."""
    text = FOUR.rsplit("groove", 1)[0] + '[design]\nkind = "box-behnken"'
    columns = coded(points_of(text))
    assert sorted(np.abs(columns).sum(axis=1).round(9).tolist()) == [0] + [2] * 12


def test_a_logarithmic_factor_is_coded_on_its_scale():
    points = points_of(
        "[factors]\nspeed_rpm = {low = 100, high = 900, scale = 'log'}\ntorque_n_m = {low = 40, high = 60}\n"
        '[design]\nkind = "central-composite"\nstar = "faced"\n'
    )
    assert sorted(set(points.columns["speed_rpm"].round(9))) == [100, 300, 900]


@pytest.mark.parametrize("kind", ["sobol", "halton", "latin-hypercube"])
@pytest.mark.parametrize(
    "given",
    ['[["joint_angle_deg", "torque_n_m", 0.7]]', "[[1, 0.7], [0.7, 1]]", "{joint_angle_deg = {torque_n_m = 0.7}}"],
)
def test_correlated_samples_have_their_rank_correlation_and_their_distributions(kind, given):
    """Exact up to sampling error: 0.7 within 0.02 of 4096 points; uniform margins, strata kept by the hypercube."""
    points = points_of(
        "[factors]\njoint_angle_deg = {low = 4, high = 14}\ntorque_n_m = {low = 25, high = 100}\n"
        f'[design]\nkind = "{kind}"\nsamples = 4096\ncorrelation = {given}\n'
    )
    ranks = [np.argsort(np.argsort(column)) for column in points.columns.values()]
    assert np.corrcoef(ranks)[0, 1] == pytest.approx(0.7, abs=0.02)
    for column, (low, high) in zip(points.columns.values(), ((4, 14), (25, 100)), strict=True):
        classes = np.histogram(column, 16, (low, high))[0]
        assert np.abs(classes - 256).max() <= (0 if kind == "latin-hypercube" else 25)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('kind = "halton"\nsamples = 8', 'kind = "halton"\nsamples = 20'),
        (
            'kind = "sobol"\nsamples = 8\ncorrelation = [["joint_angle_deg", "torque_n_m", 0.5]]',
            'kind = "sobol"\nsamples = 32\ncorrelation = [["joint_angle_deg", "torque_n_m", 0.5]]',
        ),
        ('kind = "saltelli"\nsamples = 4', 'kind = "saltelli"\nsamples = 16'),
        ('kind = "morris"\nsamples = 3', 'kind = "morris"\nsamples = 9'),
        ('kind = "finite-differences"\nsamples = 3', 'kind = "finite-differences"\nsamples = 9'),
        ('kind = "fractional-factorial"', 'kind = "full-factorial"'),
        ('kind = "full-factorial"', 'kind = "full-factorial"\nlevels = 3'),
        ('kind = "full-factorial"', 'kind = "central-composite"\nstar = "faced"'),
        ('kind = "central-composite"\nstar = "faced"', 'kind = "full-factorial"\nlevels = 3'),
        ('kind = "plackett-burman"', 'kind = "full-factorial"'),
    ],
)
def test_a_design_that_grows_keeps_every_point(before, after):
    """Exact: the fingerprints of the smaller design are all among those of the larger one."""
    old, new = (keys_of(f"{FOUR}[design]\n{design}\n") for design in (before, after))
    assert np.isin(old, new).all()
    assert np.unique(new).size > np.unique(old).size


def test_a_further_factor_at_its_base_value_keeps_every_point():
    """Exact: the old points are those of the new design at the default torque."""
    first = "[factors]\njoint_angle_deg = {low = 4, high = 14}\nspeed_rpm = {low = 300, high = 900}\n"
    design = '[design]\nkind = "full-factorial"\n'
    assert np.isin(keys_of(first + design), keys_of(first + "torque_n_m = {values = [50, 80]}\n" + design)).all()


def test_factors_of_a_group_change_together():
    """Exact: a trajectory of three groups has four points, and a block of Saltelli's eight."""
    grouped = FOUR.replace("high = 14", 'high = 14, group = "load"').replace("high = 100", 'high = 100, group = "load"')
    points = points_of(grouped + '[design]\nkind = "morris"\nsamples = 5')
    assert points.count == 5 * 4
    for block in np.stack(list(points.columns.values()), axis=1).reshape(5, 4, 4):
        moved = np.diff(block, axis=0) != 0
        assert (moved[:, 0] == moved[:, 1]).all()
        assert (moved.sum(axis=0) == 1).all()
    assert points_of(grouped + '[design]\nkind = "saltelli"\nsamples = 4').count == 4 * 8
    with pytest.raises(InputError, match="group is used by saltelli, morris and multifidelity designs, not by sobol"):
        points_of(grouped + '[design]\nkind = "sobol"\nsamples = 4')


@pytest.mark.parametrize(
    ("design", "message"),
    [
        (
            'kind = "saltelli"\nsamples = 4\ncorrelation = [["joint_angle_deg", "torque_n_m", 0.5]]',
            "takes independent factors: its indices divide the variance",
        ),
        (
            'kind = "morris"\nsamples = 4\ncorrelation = [["joint_angle_deg", "torque_n_m", 0.5]]',
            "changes one factor, independently of the others",
        ),
        (
            'kind = "sobol"\nsamples = 4\ncorrelation = [["joint_angle", "torque_n_m", 0.5]]',
            "did you mean 'joint_angle_deg'",
        ),
        ('kind = "sobol"\nsamples = 4\ncorrelation = [["speed_rpm", "torque_n_m", 1.5]]', "between -1 and 1"),
        ('kind = "sobol"\nsamples = 4\ncorrelation = [[1, 0.5], [0.5, 1]]', "4 rows of 4 numbers"),
        (
            'kind = "sobol"\nsamples = 4\ncorrelation = [["speed_rpm", "torque_n_m", 0.9], ["joint_angle_deg", "torque_n_m", 0.9], ["joint_angle_deg", "speed_rpm", -0.9]]',
            "can have these correlations together",
        ),
        ('kind = "fast"\nsamples = 64', "at least 65"),
        ('kind = "fast"\nsamples = 65\nconstraints = ["speed_rpm > 400"]', "cannot leave points out"),
        ('kind = "central-composite"', "its coded level -2: joint_angle_deg = -1.*narrow its range"),
        ('kind = "fractional-factorial"\nresolution = 2', "resolution = 2"),
    ],
)
def test_designs_that_are_refused(design, message):
    with pytest.raises(InputError, match=message):
        points_of(f"{FOUR}[design]\n{design}\n")
