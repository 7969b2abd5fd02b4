from __future__ import annotations

import re
import warnings
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from tripod_doe.analyses.factorial_effects.charts import factorial_effect_charts
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.sensitivity.charts import convergence_chart, index_charts
from tripod_doe.analyses.tolerance.charts import quantile_chart
from tripod_doe.page_parts import templates
from tripod_doe.page_parts.charts.chart import Chart, drawing, factor_ticks, legend_above
from tripod_doe.page_parts.charts.waveforms import chosen_points, spectrum_chart, waveform_charts
from tripod_doe.page_parts.main_outputs import OutputPart
from tripod_doe.page_parts.tables import factor_rows
from tripod_doe.reports.workflow_report import step_page, write_charts
from tripod_doe.study.cube.dataset import RESPONSE_ROLE


@pytest.fixture
def data_of(read_table):
    return lambda chart: read_table(chart.csv())


def texts_of(chart) -> list[str]:
    return re.findall(r"<text[^>]*>([^<]*)</text>", chart.svg())


def test_chosen_points_have_the_smallest_median_and_largest_third_order(joint_cube):
    third = np.sort(joint_cube["thrust_amplitude"].sel(order=3).values.ravel())
    third = third[np.isfinite(third)]
    shown = [float(chosen.data["thrust_amplitude"].sel(order=3)) for chosen in chosen_points(joint_cube)]
    assert shown == [third[0], third[(third.size - 1) // 2], third[-1]]
    assert chosen_points(joint_cube)[-1].text == "joint angle 12 deg, torque 200 N m, needle count 27"


def test_waveform_numbers_are_those_of_the_cube(joint_cube, data_of):
    chart = waveform_charts(joint_cube)[-1]
    point = joint_cube.sel(joint_angle_deg=12, torque_n_m=200, needle_count=27)
    data = data_of(chart)
    assert (data["rotation_deg"] == joint_cube["rotation_deg"].values).all()
    assert (data["thrust_n"] == point["thrust"].values).all()
    for groove in (1, 2, 3):
        assert (data[f"groove_{groove}_thrust_n"] == point["groove_thrust"].sel(groove=groove).values).all()
    assert {"sum", "groove 1", "groove 2", "groove 3", "thrust force (N)"} <= set(texts_of(chart))


def test_spectrum_at_the_chosen_points_is_that_of_the_cube(joint_cube, data_of):
    data = data_of(spectrum_chart(joint_cube))
    point = joint_cube.sel(joint_angle_deg=12, torque_n_m=200, needle_count=27)
    assert (data["amplitude_n_largest"] == point["thrust_amplitude"].values).all()


def test_spectrum_of_a_study_without_waveforms_has_mean_and_extremes(grid_cube, data_of):
    data = data_of(spectrum_chart(grid_cube.drop_vars("thrust")))
    amplitude = grid_cube["thrust_amplitude"].values.reshape(-1, 13)
    assert data["mean_n"].to_numpy() == pytest.approx(amplitude.mean(axis=0))
    assert (data["min_n"] == amplitude.min(axis=0)).all()
    assert (data["max_n"] == amplitude.max(axis=0)).all()


def test_lines_and_map_of_a_grid_hold_the_numbers_of_the_cube(grid_cube, data_of):
    third = grid_cube["thrust_amplitude"].sel(order=3)
    charts = {chart.name: chart for chart in effect_charts(grid_cube)[0].charts}
    assert list(charts) == [
        "thrust_amplitude_order_3-joint_angle_deg",
        "thrust_amplitude_order_3-torque_n_m",
        "thrust_amplitude_order_3-map",
    ]
    lines = data_of(charts["thrust_amplitude_order_3-joint_angle_deg"])
    assert (lines["thrust_amplitude_order_3[torque_n_m=50]"] == third.sel(torque_n_m=50).values).all()
    shown = data_of(charts["thrust_amplitude_order_3-map"]).set_index("torque_n_m")
    assert (shown.to_numpy() == third.transpose("torque_n_m", "joint_angle_deg").values).all()
    cells = texts_of(charts["thrust_amplitude_order_3-map"])
    assert {f"{value:#.3g}".rstrip(".") for value in third.values.ravel()} <= set(cells)
    assert "joint angle (deg)" in cells
    assert "torque (N m)" in cells


def test_a_level_without_finished_points_has_no_line(joint_cube):
    chart = effect_charts(joint_cube.isel(torque_n_m=1))[0].charts[0]
    assert "27" in texts_of(chart)
    assert "29" not in texts_of(chart)


def test_a_mean_over_failed_points_says_so(joint_cube, grid_cube):
    assert "mean over needle count (finished points only)" in effect_charts(joint_cube)[0].charts[0].caption
    assert not any("finished points only" in chart.caption for chart in effect_charts(grid_cube)[0].charts)


def test_a_fine_grid_is_drawn_as_contours_not_as_cells(grid_cube):
    levels = np.linspace(1, 20, 20)
    fine = (
        grid_cube[["thrust_amplitude", "outcome", "outcome_detail"]]
        .interp(joint_angle_deg=np.linspace(4, 12, 20), torque_n_m=10 * levels, kwargs={"fill_value": "extrapolate"})
        .assign(outcome=(("joint_angle_deg", "torque_n_m"), np.zeros((20, 20), int)))
    )
    chart = effect_charts(fine)[0].charts[-1]
    assert "labelled contours" in chart.caption
    assert len(texts_of(chart)) < 60


def sampled(count: int) -> xr.Dataset:
    rng = np.random.default_rng(0)
    x, z = rng.random((2, count))
    point = ("point", np.arange(count))
    meta = {"source": "user function", "units": "1"}
    return xr.Dataset(
        {
            "y": ("point", x + z, {"units": "N", "long_name": "output of a user function"}),
            "outcome": ("point", np.zeros(count, np.int8)),
            "outcome_detail": ("point", np.full(count, "")),
        },
        coords={"point": point, "x": ("point", x, meta), "z": ("point", z, meta)},
    )


def test_a_large_sample_makes_a_small_figure(data_of):
    charts = effect_charts(sampled(50_000))[0].charts
    assert [chart.name for chart in charts] == ["y-x", "y-z"]
    assert all(len(chart.svg()) < 40_000 for chart in charts)
    assert data_of(charts[0])["points"].sum() == 50_000


def test_the_same_cube_gives_the_same_picture(grid_cube):
    assert spectrum_chart(grid_cube).svg() == spectrum_chart(grid_cube).svg()


def indices(kind: str, **variables: list[float]) -> xr.Dataset:
    return xr.Dataset(
        {key: ("factor", values) for key, values in variables.items()},
        coords={"factor": ["x", "z"]},
        attrs={"outputs": "y", "confidence_level": 0.9, "analysis_kind": kind},
    )


def test_sobol_chart_shows_both_indices_with_their_intervals(data_of):
    result = indices("sobol", S1=[0.1, 0.6], S1_conf=[0.01, 0.02], ST=[0.2, 0.7], ST_conf=[0.03, 0.04])
    (chart,) = index_charts(result, "sobol")
    data = data_of(chart)
    assert data.to_numpy().tolist() == [["z", 0.7, 0.04, 0.6, 0.02], ["x", 0.2, 0.03, 0.1, 0.01]]
    assert {"0.70", "0.60", "0.20", "0.10", "total index ST", "first-order index S1"} <= set(texts_of(chart))
    assert "90 % confidence" in chart.caption


def test_morris_chart_of_effects_without_intervals(data_of):
    """Regression: a run ended with "Axis limits cannot be NaN or Inf" where no effect varied over the trajectories."""
    result = indices("morris", mu=[1.0, -2.0], mu_star=[1.0, 2.0], mu_star_conf=[np.nan] * 2, sigma=[0.0, 0.0])
    (chart,) = index_charts(result, "morris")
    assert data_of(chart)["mu_star"].tolist() == [2, 1]
    assert "confidence" not in chart.caption


def test_morris_chart_shows_every_factor_in_the_unit_of_the_output(data_of):
    result = indices("morris", mu=[1.0, -2.0], mu_star=[1.0, 2.0], mu_star_conf=[0.1, 0.2], sigma=[0.5, 0.0])
    result = result.assign_attrs(outputs="force", output_units='{"force": "N"}')
    (chart,) = index_charts(result, "morris")
    assert data_of(chart)["mu_star"].tolist() == [2.0, 1.0]
    assert {"x", "z", "mean elementary effect μ* (N)"} <= set(texts_of(chart))


def test_a_distribution_is_drawn_through_more_quantiles_than_were_asked_for(data_of):
    """Regression: three straight lines through four quantiles stood for the distribution."""
    shares = np.arange(0.005, 1, 0.005)
    result = xr.Dataset(
        {
            "quantile": ("probability", [0.4, 6.4]),
            "quantile_low": ("probability", [0.3, np.nan]),
            "quantile_high": ("probability", [0.5, 9.0]),
            "distribution": ("share", 10 * shares**2),
        },
        {"probability": [0.2, 0.8], "share": shares},
    )
    chart = quantile_chart("some", "scatter", OutputPart("y", "y", "N", result.assign_attrs(confidence_level=0.95)))
    data = data_of(chart)
    assert data["quantile"].to_numpy() == pytest.approx(10 * data["probability"].to_numpy() ** 2)
    assert data["probability"].is_monotonic_increasing
    assert data["quantile_high"].dropna().tolist() == [0.5, 9]
    assert max(line.count("L") for line in re.findall(r'd="([^"]*)"', chart.svg())) > 10  # of the lines in a path


def test_levels_out_of_order_are_drawn_in_order(grid_cube):
    shuffled = effect_charts(grid_cube.isel(joint_angle_deg=[2, 0, 1], torque_n_m=[1, 3, 0, 2]))[0].charts
    ordered = effect_charts(grid_cube)[0].charts
    assert shuffled[0].data["joint_angle_deg"].tolist() == [4, 8, 12]
    assert shuffled[-1].data.equals(ordered[-1].data)


def test_a_factor_with_one_level_needs_no_line_of_its_own(grid_cube):
    (group,) = [
        group for group in effect_charts(grid_cube.isel(torque_n_m=[2])) if group.response.label == "third order"
    ]
    (chart,) = group.charts
    third = grid_cube["thrust_amplitude"].sel(order=3, torque_n_m=100)
    assert (chart.data["thrust_amplitude_order_3"] == third.values).all()


def test_a_legend_is_never_wider_than_its_figure():
    with drawing(3.7, 3.0) as (figure, axes):
        for value in range(5):
            axes.plot([0, 1], [0, value], label=f"a level of {value}.2345 N m")
        legend_above(axes, 3, "torque")
        figure.canvas.draw()
        assert axes.get_legend().get_window_extent().x1 <= figure.bbox.x1


def test_a_third_factor_of_few_levels_has_a_map_each_and_own_results_stand_beside_the_orders(make_cube, data_of):
    """Regression: the page of studies/vibration.toml had neither a map nor anything of the growth."""
    cube = make_cube("""
        [study]
        name = "V"
        [base]
        model = "equilibrium"
        [factors]
        joint_angle_deg = { values = [4, 8, 12] }
        torque_n_m = { values = [20, 40, 60] }
        speed_rpm = { values = [100, 200] }
        [keep]
        outputs = ["thrust_amplitude", "energy_residual"]
        """)
    cube["energy_residual"].attrs["role"] = RESPONSE_ROLE
    third, residual = effect_charts(cube)
    maps = [chart for chart in third.charts if "-map" in chart.name]
    assert [chart.name for chart in maps] == [f"thrust_amplitude_order_3-map-{k}" for k in (1, 2)]
    assert [chart.caption.rpartition(", ")[2] for chart in maps] == ["speed 100 rpm.", "speed 200 rpm."]
    values = cube["thrust_amplitude"].sel(order=3, speed_rpm=200).transpose("torque_n_m", "joint_angle_deg").values
    assert (data_of(maps[1]).set_index("torque_n_m").to_numpy() == values).all()
    assert residual.response.label == "energy_residual"


def crowded(name: str, count: int) -> Chart:
    rng = np.random.default_rng(3)
    data = pd.DataFrame(rng.random((count, 2)), columns=["across", "up"])
    with drawing(4, 3) as (figure, axes):
        axes.scatter(data["across"], data["up"], s=4)
        axes.plot(data["up"], data["across"], "o")
        axes.set_xlabel("across")
    return Chart(name, f"Cloud {name}", "Very many markers.", figure, data)


@pytest.mark.slow
def test_very_many_markers_are_an_image_in_the_figure():
    few, many = crowded("few", 100).svg(), crowded("many", 30_000)
    assert "<image" not in few
    assert len(many.svg()) < 200_000
    assert "<image" in many.svg()
    assert "across" in texts_of(many)


def test_a_page_is_never_larger_than_ten_megabytes(tmp_path, monkeypatch):
    """The largest tables are left out first, and the page says so; a smaller one stays. Here with 1.5 MB."""
    assert templates._MOST_BYTES == 10_000_000
    monkeypatch.setattr(templates, "_MOST_BYTES", 1_500_000)
    charts = [crowded("a", 10_000), crowded("b", 20_000), crowded("c", 50)]
    write_charts(charts, "step", tmp_path)
    page = step_page("Clouds", "?", ["step"], {}, {"step": ("Clouds", tmp_path)}, "")
    assert 500_000 < len(page.encode()) <= 1_500_000
    assert page.count("Its data are left out: this page would be larger than 1.5 MB.") == 1
    assert 'download="step-b.csv"' not in page
    assert 'download="step-a.csv"' in page
    assert 'download="step-c.csv"' in page
    assert page.count("<svg role") == 3


def test_levels_of_a_factor_are_written_in_full():
    """Regression: 1800 was 1.8e+03, and levels a thousandth apart looked the same."""
    for levels, told in (
        ([-600, 600, 1800], ["\N{MINUS SIGN}600", "600", "1800"]),
        ([4.996, 4.999], ["4.996", "4.999"]),
    ):
        with drawing(2.0, 2.0) as (_, axes):
            axes.plot(levels, levels)
            factor_ticks(axes, np.array(levels))
            assert [text.get_text() for text in axes.get_xticklabels()] == told


@pytest.mark.parametrize("levels", [[0, 0.3, 4, 12], [0, 0.1, 0.2, 0.3, 100], [-1000, -999, 1000]])
def test_labels_of_unequal_levels_do_not_lie_on_each_other(levels):
    """Regression: 0 and 0.3 of 0 to 12 deg were one smear."""
    with drawing(3.7, 3.0) as (figure, axes):
        axes.plot(levels, levels)
        factor_ticks(axes, np.array(levels))
        figure.draw_without_rendering()
        texts = axes.get_xticklabels()
        assert [float(text.get_text().replace("\N{MINUS SIGN}", "-")) for text in texts] == levels
        lines = {}
        for text in texts:
            lines.setdefault(text.get_text().count("\n"), []).append(text.get_window_extent())
        assert all(left.x1 < right.x0 for line in lines.values() for left, right in pairwise(line))
        assert len(lines) > 1
        assert lines[0][0].height < lines[1][0].height


def test_a_caption_counts_the_classes_of_a_sample_with_ties():
    """Regression: half of the points at one value make fewer than the "ten classes with equally many points"."""
    cube = sampled(120)
    tied = np.where(np.arange(120) < 60, 0.0, cube["x"].values)
    caption = effect_charts(cube.assign_coords(x=cube["x"].copy(data=tied)))[0].charts[0].caption
    assert "quartiles (band) of 6 classes of neighbouring points" in caption


def test_a_spectrum_names_no_largest_order(grid_cube):
    """Regression: the order of the largest whisker was said to be the largest one, and the first of a thrust of zero."""
    zero = grid_cube.assign(thrust_amplitude=0 * grid_cube["thrust_amplitude"])
    assert all("is the largest" not in spectrum_chart(cube).caption for cube in (grid_cube, zero))


def test_captions_name_only_intervals_and_samples_that_are_there():
    """Regression: a design with as many terms as points has no intervals, and 48 samples no eighth that says much."""
    columns = {"effect": [1.0, 2.0], "effect_conf": [np.nan] * 2, "p_value": [np.nan] * 2}
    effects = xr.Dataset({key: ("term", values) for key, values in columns.items()}, {"term": ["a", "b"]})
    (chart,) = factorial_effect_charts(effects.assign(r_squared=1.0).assign_attrs(outputs="y"), "own")
    assert chart.caption == "Effects on y (analysis own)."
    course = {f"ST{over}{key}": ([*dims, "factor"], np.ones((2,) * (len(dims) + 1)))
              for over, dims in (("", []), ("_over_samples", ["samples"])) for key in ("", "_conf")}  # fmt: skip
    part = xr.Dataset(course, {"samples": [24, 48], "factor": ["a", "b"]})
    assert "from the first 24 and 48 samples" in convergence_chart("key", "own", "y", part, "sobol").caption


def test_a_grid_of_many_levels_is_no_sample():
    cube = sampled(301)
    values = [row.value for row in factor_rows(cube)]
    assert all(value.endswith("(301 values)") for value in values)


def test_characters_that_no_font_has_are_not_printed():
    """Regression: the warning of matplotlib held the escape character of a factor's word, and a terminal obeyed it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with drawing(3, 2) as (figure, axes):
            axes.set_xlabel("a\x1b[31mb")
        Chart("n", "t", "c", figure, pd.DataFrame({"a": [1]})).svg()
    assert not caught
