"""Views of cubes: what is drawn are the numbers of a query, whatever the design; texts of studies survive the form."""

from __future__ import annotations

import base64
import html
import json
import re
import shlex
import shutil
import tomllib

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.cli.main import main
from tripod_doe.errors import InputError
from tripod_doe.service.explorer import analysis_tables, exports
from tripod_doe.service.explorer.analysis_tables import view_behind
from tripod_doe.service.explorer.answers import explore, extremes, failures, figure, numbers, parameters, point
from tripod_doe.service.explorer.axes import drawn_view, full_view
from tripod_doe.service.explorer.controls import controls, view_title
from tripod_doe.service.explorer.exports import query_command, simulate_command, study_of_view
from tripod_doe.service.explorer.figures.lines import lines
from tripod_doe.service.explorer.figures.point import point_figures
from tripod_doe.service.explorer.figures.scatter import scatter
from tripod_doe.service.explorer.slices import draw, number_of, numbered, point_of, seen, shown_cells, values_of
from tripod_doe.service.explorer.view import View
from tripod_doe.service.explorer.what_if import contribution_study, price_of_point
from tripod_doe.service.limits import Limits
from tripod_doe.service.page.rendering import part
from tripod_doe.service.requests.gallery import gallery, gallery_upload, study_of_joint
from tripod_doe.service.requests.plans import plan_upload
from tripod_doe.service.requests.study_form import changed_text, study_form
from tripod_doe.service.requests.uploads import main_file, upload_texts, write_upload
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.definition.study_file import load_study, parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.workflow.workflow import load_workflow

GRID = """
[study]
name = "Small and jammed"
[base]
speed_rpm = 1400
initial_skew_2_deg = 0.3
[factors.joint_angle_deg]
values = [2, 7, 13]
[factors.torque_n_m]
values = [-40, 90]
[factors.bearing_radial_clearance_mm]
values = [-0.03, 0.02]
[keep]
outputs = ["thrust", "thrust_amplitude"]
"""
LIST = (
    GRID.replace("Small", "List")
    .replace("values = [2, 7, 13]", "low = 2\nhigh = 13")
    .replace("values = [-40, 90]", "low = -40\nhigh = 90")
    .replace("values = [-0.03, 0.02]", "low = 0.0\nhigh = 0.02")
    + '[design]\nkind = "latin-hypercube"\nsamples = 9\n'
)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Result directories of a grid of which half is jammed, and of a list of points."""
    found = {}
    for name, text in (("grid", GRID), ("list", LIST)):
        found[name] = tmp_path_factory.mktemp(name)
        (found[name] / "a.toml").write_text(text)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
            td.run(found[name] / "a.toml", out=found[name] / "out", workers=0)
        found[name] /= "out"
    return found


def values(packed):
    """Numbers that were packed for Plotly."""
    if isinstance(packed, list):
        return np.array(packed)
    array = np.frombuffer(base64.b64decode(packed["bdata"]), np.dtype(packed["dtype"]).newbyteorder("<"))
    return array.reshape([int(size) for size in packed["shape"].split(",")]) if "shape" in packed else array


def view_of(cube, address=""):
    return full_view(cube, View.from_items(part.split("=", 1) for part in address.split("&") if part))


def test_an_address_is_a_view_and_a_view_an_address():
    view = View("thrust", "map", "torque_n_m", "joint_angle_deg", ("order=3", "speed_rpm=1:2"), "thrust > 1", -1.5, 4.0)
    assert View.from_items(view.items()) == view
    with pytest.raises(InputError, match="did you mean 'lines'"):
        View.from_items([("kind", "line")])


@pytest.mark.parametrize(("kind", "lost"), [("lines", True), ("map", True), ("points", False)])
def test_the_level_at_which_a_factor_stood_does_not_narrow_its_axis(folders, kind, lost):
    cube = td.open_cube(folders["grid"])
    view = view_of(cube, f"kind={kind}&x=joint_angle_deg&by=torque_n_m&select=torque_n_m=90&select=joint_angle_deg=2:8")
    assert ("torque_n_m=90" in view.select) is not lost
    assert "joint_angle_deg=2:8" in view.select  # a range is a choice


@pytest.mark.parametrize("kind", ["points", "parallel", "matrix"])
def test_a_list_of_points_has_a_control_for_each_selection(folders, kind):
    """Regression: a word that was selected before narrowed the points, and no control said so."""
    cube = td.open_cube(folders["grid"]).assign_coords(torque_n_m=["weak", "full"])
    view = view_of(cube, f"kind={kind}&x=joint_angle_deg&by=order&select=torque_n_m=weak")
    ((axis, chosen),) = controls(cube, view)["words"]
    assert (axis["name"], axis["texts"], chosen) == ("torque_n_m", ["full", "weak"], "weak")
    assert kind != "points" or "order" in [axis["name"] for axis in controls(cube, view)["beside"]]
    cube = td.open_cube(folders["list"])
    ((axis, chosen),) = controls(cube, view_of(cube, f"kind={kind}&select=point=5"))["words"]
    assert (axis["name"], axis["texts"], chosen) == ("point", ["5"], "5")


@pytest.mark.parametrize(
    ("wanted", "told"), [("2:7", "2 to 7 deg"), (":7", "up to 7 deg"), ("2:", "2 deg or more"), ("7", "7 deg")]
)
def test_a_title_says_ranges_in_words(folders, wanted, told):
    view = view_of(td.open_cube(folders["list"]), f"kind=points&x=torque_n_m&select=joint_angle_deg={wanted}")
    assert f", joint angle {told}, order 3" in view_title(td.open_cube(folders["list"]), view)


def test_values_in_fields_are_read_as_they_are_written(folders):
    """Regression: a comma between thousands was refused when the field was sent."""
    for scene in SCENES:
        known = load_simulator(scene).parameters
        for name, default in parameters(scene):
            assert default == "" or known[name].choices or float(default) == known[name].default
    shown = point(str(folders["grid"]), 0) | {"parameters": {"speed_rpm": 10000.0, "torque_n_m": -1234.56789}}
    page = part("point.html", root="", point=shown, run_id="", step=None, read_only=False, computes=True)
    assert 'value="10000"' in page
    assert 'value="-1234.56789"' in page


@pytest.mark.slow
def test_lines_and_maps_show_the_numbers_of_a_query(folders):
    cube = td.open_cube(folders["grid"])
    for kind in ("lines", "map"):
        view = view_of(cube, f"kind={kind}&x=joint_angle_deg&by=torque_n_m")
        assert view.select == ("bearing_radial_clearance_mm=0.02", "order=3")  # where points have finished
        asked = td.query(cube, view.variable, view.select)["thrust_amplitude"].squeeze(drop=True)
        drawn = draw(cube, view)["data"]
        if kind == "lines":
            shown = np.stack([values(trace["y"]) for trace in drawn[:2]], axis=1)
        else:
            shown = values(drawn[0]["z"]).T
        assert np.array_equal(shown, asked.transpose("joint_angle_deg", "torque_n_m").values)


def test_every_cell_without_a_number_is_marked_with_its_reason(folders):
    cube = td.open_cube(folders["grid"])
    for kind in ("lines", "map", "points"):
        figure = draw(
            cube, view_of(cube, f"kind={kind}&x=joint_angle_deg&by=torque_n_m&select=bearing_radial_clearance_mm=-0.03")
        )
        marks = [
            trace
            for trace in figure["data"]
            if trace.get("text") is not None and trace["type"] == "scatter" and trace.get("mode") == "markers"
        ]
        told = [text for trace in marks for text in trace["text"] if "jammed" in text]
        assert told, kind
        assert len(told) == (3 if kind == "lines" else 6)  # lines that fail at the same place share a mark
        assert "6 of 6 points failed: 6 jammed" in figure["note"] or kind == "points"


def test_what_a_condition_leaves_out_is_blank_and_no_failure(folders):
    cube = td.open_cube(folders["grid"])
    view = view_of(cube, "kind=map&x=joint_angle_deg&by=torque_n_m&where=thrust_amplitude > 5")
    figure = draw(cube, view)
    assert figure["note"] == ""
    shown = values(figure["data"][0]["z"])
    assert np.nanmin(shown) > 5
    assert np.isnan(shown).any()


def test_colours_span_the_whole_design(folders):
    cube = td.open_cube(folders["grid"])
    limits = [
        draw(
            cube, view_of(cube, f"kind=map&x=joint_angle_deg&by=bearing_radial_clearance_mm&select=torque_n_m={torque}")
        )["data"][0]
        for torque in (-40, 90)
    ]
    third = cube["thrust_amplitude"].sel(order=3)
    assert {(cells["zmin"], cells["zmax"]) for cells in limits} == {(float(third.min()), float(third.max()))}


def test_a_list_of_points_is_filtered_by_ranges_as_by_a_query(folders):
    cube = td.open_cube(folders["list"])
    view = view_of(cube, "select=torque_n_m=0:90")
    assert view.kind == "points"
    shown = values(draw(cube, view)["data"][0]["y"])
    asked = td.query(cube, "thrust_amplitude", ["order=3", "torque_n_m=0:90"])["thrust_amplitude"].values.ravel()
    assert 0 < shown.size == asked.size < 9
    assert np.array_equal(shown, asked)
    axes = draw(cube, view_of(cube, "kind=parallel"))["axes"]
    assert [axis["name"] for axis in axes] == [
        "joint_angle_deg",
        "torque_n_m",
        "bearing_radial_clearance_mm",
        "thrust_amplitude",
    ]


def test_parallel_axes_of_candidates_show_all_objectives(folders):
    """Regression: the axes held one objective at a time."""
    cube = td.open_cube(folders["list"])
    points = cube.assign(
        second=cube["thrust_amplitude"].sel(order=2, drop=True).assign_attrs(role="objective", units="N"),
        third=cube["thrust_amplitude"].sel(order=3, drop=True).assign_attrs(role="objective", units="N"),
    )
    drawn = draw(points, view_of(points, "variable=third&kind=parallel&where=third > 0"))
    assert [axis["name"] for axis in drawn["axes"]][-2:] == ["second", "third"]
    wanted = points["second"].where(points["third"] > 0).values
    assert np.array_equal(values(drawn["axes"][-2]["values"]), wanted, equal_nan=True)


def test_curves_of_a_list_are_one_per_point(folders):
    cube = td.open_cube(folders["list"])
    view = view_of(cube, "variable=thrust&kind=lines")
    assert (view.x, view.by) == ("rotation_deg", "point")
    traces = draw(cube, view)["data"]
    assert np.array_equal(values(traces[4]["y"]), cube["thrust"].values[4])


def test_numbers_and_failures_and_points_belong_together(folders):
    path = str(folders["grid"])
    table = numbers(path, [["kind", "lines"], ["select", "bearing_radial_clearance_mm=0.02"]])
    cube = numbered(td.open_cube(path))
    first = table["rows"][0]
    found = point(path, first[0])
    assert [factor["value"] for factor in found["factors"]] == ["2 deg", "-40 N m", "0.02 mm"]
    assert found["outcome"] == "finished"
    assert set(found["figures"]) == {"thrust", "thrust_amplitude"}
    lost = failures(path)
    assert lost["count"] == 6
    assert all(int(cube["outcome"].values.ravel()[row["position"]]) for row in lost["rows"])
    assert point(path, lost["rows"][0]["position"])["reason"].startswith("jammed: ")
    with pytest.raises(InputError, match="points 0 to 11"):
        point(path, 12)


def test_the_command_that_is_copied_gives_what_is_seen(folders, capsys):
    cube = td.open_cube(folders["grid"])
    view = view_of(cube, "kind=lines&where=thrust_amplitude > 5")
    assert main([*shlex.split(query_command(str(folders["grid"]), view))[1:], "--format", "csv"]) == 0
    printed = [float(line.split(",")[4]) for line in capsys.readouterr().out.splitlines()[1:]]
    shown = np.concatenate([values(trace["y"]) for trace in draw(cube, view)["data"][:2]])
    assert sorted(printed) == sorted(shown[np.isfinite(shown)])
    one = numbered(cube).isel(joint_angle_deg=1, torque_n_m=0, bearing_radial_clearance_mm=1)
    words = shlex.split(simulate_command(cube, one))
    assert main([*words[1:], "--format", "json"]) == 0
    answer = capsys.readouterr().out
    assert f"{float(one['thrust_amplitude'].sel(order=3))!r}" in answer
    words = {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "none equilibrium kinetostatic"}
    retried = one.assign(model_used=((), np.int8(1), words))  # by a retry, whatever [base] says
    assert "--model kinetostatic" in simulate_command(cube, retried)
    finer = retried.assign(attempt=1, relative_tolerance_used=((), 5e-4, {"role": "record of the run"}))
    assert "--relative-tolerance 0.0005" in simulate_command(cube, finer)


def test_the_study_that_is_copied_is_the_whole_one_where_an_axis_is_long(folders, monkeypatch):
    """Regression: a page wrote out all 12,000 levels of an axis, for tens of seconds."""
    monkeypatch.setattr(exports, "_MOST_ROWS", 2)
    cube = td.open_cube(folders["grid"])
    view = view_of(cube, "kind=lines&x=joint_angle_deg&by=torque_n_m")
    assert study_of_view(cube, view, seen(cube, view)) == cube.attrs["study"]


@pytest.mark.parametrize("name", ["grid", "list"])
def test_the_study_that_is_copied_has_the_points_that_are_seen(folders, name):
    cube = td.open_cube(folders[name])
    view = view_of(cube, "kind=lines&x=joint_angle_deg&by=torque_n_m" if name == "grid" else "select=torque_n_m=0:90")
    data = seen(cube, view)
    study = parse_study(study_of_view(cube, view, data))
    points = make_points(study)
    assert points.count == data["outcome"].size
    assert study.base["speed_rpm"] == 1400
    clearance = {
        study.base.get("bearing_radial_clearance_mm"),
        *points.columns.get("bearing_radial_clearance_mm", [0.02]),
    }
    assert clearance <= {None, 0.02} or name == "list"
    shown = np.broadcast_to(
        data["joint_angle_deg"].values.reshape((-1, 1) if name == "grid" else -1), data["outcome"].shape
    )
    assert np.allclose(np.sort(points.columns["joint_angle_deg"]), np.sort(shown.ravel()))


COPIED = """
[study]
name = "a copy"
[base]
model = "equilibrium"
joint_angle_deg = 7
[factors.torque_n_m]
values = [30, 90, 150]
[factors.speed_rpm]
values = [200, 900]
[keep]
outputs = ["thrust_amplitude", "thrust_rms"]
"""
PARTS = {
    "a formula": '[responses.half]\nformula = "thrust_amplitude[3] / 2"\nunit = "N"\n',
    "a cost": "",
    "constraints": '[design]\nkind = "grid"\nconstraints = ["torque_n_m * speed_rpm < 100000"]\n',
    "one factor at a time": '[design]\nkind = "one-at-a-time"\n',
    "another accuracy": '[accuracy]\nthrust_amplitude_3 = 1e-4\n[run]\nretry = [{ model = "kinetostatic" }]\n',
}


@pytest.mark.usefixtures("charts_not_drawn")
@pytest.mark.parametrize("part", first_fast(PARTS, 2))
def test_the_study_that_is_copied_runs_as_the_one_that_it_is_of(tmp_path, part):
    """Regression: some copies were refused; others left out constraints, accuracy and retries without a word."""
    text = (
        COPIED.replace("joint_angle_deg = 7", "torque_n_m = 60\nspeed_rpm = 500" if "time" in part else "")
        + PARTS[part]
    )
    (tmp_path / "a.toml").write_text(text)
    td.run(tmp_path / "a.toml", out=tmp_path / "a", workers=0)
    cube, variable = (
        td.open_cube(tmp_path / "a"),
        {"a formula": "half", "a cost": "steps"}.get(part, "thrust_amplitude"),
    )
    view = view_of(cube, f"variable={variable}&kind=points")
    (tmp_path / "b.toml").write_text(study_of_view(cube, view, seen(cube, view)))
    td.run(tmp_path / "b.toml", out=tmp_path / "b", workers=0)
    again = td.open_cube(tmp_path / "b")
    assert (again["outcome"] == 0).sum() == (cube["outcome"] == 0).sum() > 3
    assert np.allclose(np.sort(again[variable].values.ravel()), np.sort(cube[variable].values.ravel()), equal_nan=True)
    copied, first = load_study(tmp_path / "b.toml"), load_study(tmp_path / "a.toml")
    assert (copied.accuracy, copied.retry) == (first.accuracy, first.retry)


@pytest.mark.usefixtures("charts_not_drawn")
def test_the_study_that_is_copied_is_the_whole_one_where_a_field_is_empty(tmp_path):
    (tmp_path / "points.csv").write_text("joint_angle_deg,groove_spin_friction\n4,\n8,0.03\n")
    text = '[study]\nname = "table"\n[base]\nmodel = "equilibrium"\n[design]\nkind = "table"\ntable = "points.csv"\n'
    (tmp_path / "a.toml").write_text(text)
    td.run(tmp_path / "a.toml", out=tmp_path / "a", workers=0)
    cube = td.open_cube(tmp_path / "a")
    view = view_of(cube)
    assert study_of_view(cube, view, seen(cube, view)) == cube.attrs["study"]


def test_a_point_is_found_by_its_values(folders):
    """Regression: an address with a number led to another point after the study had grown."""
    cube = td.open_cube(folders["grid"])
    at = values_of(cube, point_of(cube, 6))
    assert number_of(cube, 6, at) == number_of(cube, 11, at) == number_of(cube, 99, at) == 6
    assert number_of(cube.isel(joint_angle_deg=[1, 2]), 6, at) == 2
    assert number_of(cube, 3, "") == 3
    wide = cube.expand_dims(model=["rollers", "equilibrium"])
    with pytest.raises(InputError, match="2 points of this study have these values"):
        number_of(wide.assign(outcome=wide["outcome"].assign_attrs(cube["outcome"].attrs)), 99, at)
    for wrong in (
        '{"joint_angle_deg":7.5}',
        '{"joint_angle_deg":"x"}',
        '{"unknown":7}',
        "[" * 9999,
        "7",
        '{"torque_n_m":[1]}',
    ):
        with pytest.raises(InputError, match=r"of (a point of )?this study"):
            number_of(cube, 0, wrong)
    assert number_of(cube, 0, '{"joint_angle_deg":2}') == 0


def test_the_difference_of_a_cube_and_itself_is_zero_and_of_others_refused(folders):
    cube, other = td.open_cube(folders["grid"]), td.open_cube(folders["list"])
    view = view_of(cube, "kind=map&x=joint_angle_deg&by=torque_n_m")
    assert not values(draw(cube, view, cube)["data"][0]["z"]).any()
    with pytest.raises(InputError, match="in the run that is subtracted: no cell matches"):
        draw(cube, view, other)


def test_unlike_points_and_units_are_not_subtracted(folders):
    """Regression: points were paired by their numbers whatever their factors, newtons and kilonewtons subtracted."""
    cube = td.open_cube(folders["list"])
    view = view_of(cube, "kind=matrix&select=order=3")
    draw(cube, view, cube)
    with pytest.raises(InputError, match="the points of the other run differ in joint_angle_deg"):
        draw(cube, view, cube.assign_coords(joint_angle_deg=cube["joint_angle_deg"] + 1))
    thousand = cube.assign(thrust_amplitude=(cube["thrust_amplitude"] / 1000).assign_attrs(units="kN"))
    with pytest.raises(InputError, match="thrust_amplitude is in N here, in kN in the other run"):
        draw(cube, view, thousand)


def test_a_difference_of_runs_is_drawn_where_both_have_points(folders):
    """Regression: "No picture" where the levels of two runs overlap partly."""
    cube = td.open_cube(folders["grid"])
    view = drawn_view(cube, View.from_items([("kind", "lines"), ("x", "joint_angle_deg"), ("minus", "b")]))
    angles = cube["joint_angle_deg"].values
    drawn = draw(cube, view, cube.isel(joint_angle_deg=slice(1, None)))
    assert values(drawn["data"][0]["x"]).tolist() == angles[1:].tolist()
    assert drawn["note"].startswith("Only values that both have are shown.")
    with pytest.raises(InputError, match="no point in common"):
        draw(cube, view, cube.assign_coords(joint_angle_deg=angles + 0.01))


def test_a_level_of_a_factor_is_subtracted_while_the_view_stands_still_there(folders):
    path, view = (
        str(folders["grid"]),
        "kind=lines&x=joint_angle_deg&by=bearing_radial_clearance_mm&select=torque_n_m=90",
    )
    items = [part.split("=", 1) for part in f"{view}&minus=torque_n_m=-40".split("&")]
    asked = td.query(td.open_cube(path), "thrust_amplitude", ["order=3", "bearing_radial_clearance_mm=0.02"])
    wanted = asked["thrust_amplitude"].sel(torque_n_m=90) - asked["thrust_amplitude"].sel(torque_n_m=-40)
    whole = json.loads(figure(path, items, None))
    drawn = whole["data"][1]
    assert whole["layout"]["yaxis"]["title"]["text"] == "difference of thrust amplitude (N)"  # it read as the amplitude
    assert np.array_equal(values(drawn["y"]), wanted.values.ravel())
    assert values(drawn["customdata"]).tolist() == [3, 7, 11]  # the points at 90 N m
    rows = numbers(path, items)["rows"]
    assert [row[-2] for row in rows if row[-1] == "finished"] == [f"{value:.6g}" for value in wanted.values.ravel()]
    assert explore(path, items, "x")["title"].endswith("less the value at torque -40 N m")
    along = [part.split("=", 1) for part in ["kind=lines", "x=torque_n_m", "minus=torque_n_m=-40"]]
    assert explore(path, along, "x")["view"]["minus"] == ""
    with pytest.raises(
        InputError, match="torque_n_m is an axis of this figure"
    ):  # the plain values came as a difference
        figure(path, along, None)


def test_a_condition_chooses_cells_and_not_what_is_subtracted(folders):
    """Regression: a condition that the subtracted level does not meet left the figure empty."""
    path = str(folders["grid"])
    items = [("kind", "lines"), ("x", "joint_angle_deg"), ("select", "torque_n_m=90"), ("minus", "torque_n_m=-40")]
    free, meant = (json.loads(figure(path, [*items, *more], None)) for more in ([], [("where", "torque_n_m > 0")]))
    assert np.isfinite(values(meant["data"][0]["y"])).any()
    assert values(meant["data"][0]["y"]).tolist() == pytest.approx(values(free["data"][0]["y"]).tolist(), nan_ok=True)


def test_points_over_a_dimension_of_their_output_lead_to_their_points(folders):
    """Regression: marks coloured by an order ended in an IndexError; a level of single points was "another run"."""
    path = str(folders["grid"])
    items = [("kind", "points"), ("x", "joint_angle_deg"), ("by", "order"), ("select", "torque_n_m=90")]
    (marks, *_) = json.loads(figure(path, items, None))["data"]
    at = values(marks["customdata"])
    assert np.unique(at).size * 13 == at.size
    angles = td.open_cube(path)["joint_angle_deg"].values[at // 4]
    assert values(marks["x"]).tolist() == angles.tolist()
    (less, *_) = json.loads(figure(path, [*items, ("minus", "torque_n_m=-40")], None))["data"]
    assert values(less["customdata"]).tolist() == at.tolist()


def test_numbers_like_an_output_have_its_unit(tmp_path):
    """Regression: means and quantiles of an analysis had none."""
    values = {"mean": ("output", [8.25, 3.5]), "share_of": ("output", [0.5, 0.25]), "limit": ("output", [np.nan, 4])}
    attributes = {"analysis_kind": "tolerance", "output_units": json.dumps({"pull": "N", "penetration": "um"})}
    result = xr.Dataset(values, {"output": ["pull", "penetration"]}, attributes)
    (table,) = analysis_tables._tables(result, None)
    assert [[text for _, _, text in row["cells"]] for row in table["rows"]] == [
        ["8.25 N", "0.5", "\N{EN DASH}"],
        ["3.5 um", "0.25", "4 um"],
    ]


def test_an_output_without_its_neighbours_dimension_has_one_row():
    """Regression: rows of an output without grooves were repeated for each groove."""
    values = {"mean": (("output", "groove"), [[1.0, 2.0], [3.0, 3.0]])}
    result = xr.Dataset(values, {"output": ["groove_thrust", "thrust"], "groove": [1, 2]})
    (table,) = analysis_tables._tables(result, None)
    assert [row["labels"] for row in table["rows"]] == [
        ["groove thrust", "1"],
        ["groove thrust", "2"],
        ["thrust", "all"],
    ]
    assert [row["cells"][0][1:] for row in table["rows"]] == [(0, "1"), (1, "2"), (2, "3")]
    assert table["count"] == 3


def test_phases_are_subtracted_by_the_shorter_way(folders):
    """Regression: 123.1 less -142.6 deg was 265.7 deg."""
    cube = td.open_cube(folders["grid"])
    turned = cube.assign(thrust_amplitude=(170.0 * np.sign(cube["torque_n_m"]) + 0 * cube["thrust_amplitude"]))
    turned["thrust_amplitude"].attrs = {"units": "degree", "wraps_at": "+-180 degree"}
    view = view_of(turned, "kind=lines&x=joint_angle_deg&select=torque_n_m=90&minus=torque_n_m=-40")
    assert np.unique(shown_cells(turned, view)["thrust_amplitude"]) == pytest.approx([-20])


def test_extremes_are_those_of_the_order(folders):
    cube = numbered(td.open_cube(folders["grid"]))
    found = extremes(str(folders["grid"]), 6)
    for end, at in (
        ("least", cube["thrust_amplitude"].sel(order=6).min()),
        ("largest", cube["thrust_amplitude"].sel(order=6).max()),
    ):
        number = point(str(folders["grid"]), found[end]["number"])["number"]
        own = cube["thrust_amplitude"].sel(order=6).values.ravel()[number]
        assert own == float(at)
    assert found["label"] == "thrust amplitude (N), order 6"


@pytest.mark.parametrize("outputs", [["thrust"], ["friction_power_w"], ["needle_skew_deg"]])
def test_results_with_many_values_at_a_point_have_no_extremes(tmp_path, outputs):
    """Regression: the thrust at rotation 0 was told as the extremes of "thrust (N), order 3"."""
    text = GRID.replace("values = [-0.03, 0.02]", "values = [0.02]")
    (tmp_path / "a.toml").write_text(text.replace('["thrust", "thrust_amplitude"]', json.dumps(outputs)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
        td.run(tmp_path / "a.toml", out=tmp_path / "out", workers=0)
    assert extremes(str(tmp_path / "out"), 3) is None


def test_the_price_of_a_point_names_what_is_wrong_or_will_fail():
    price = price_of_point("joint", {"model": "needles", "torque_n_m": 33})
    assert price["cpu_seconds"] > 10 * price_of_point("joint", {"model": "kinetostatic"})["cpu_seconds"]
    assert price_of_point("joint", {"bearing_radial_clearance_mm": -0.05})["foreseen"].startswith("jammed: ")
    with pytest.raises(InputError, match=r"^torque_nm = 3: unknown parameter"):
        price_of_point("joint", {"torque_nm": 3})
    with pytest.raises(InputError, match="torque_n_m: a value is needed"):
        price_of_point("joint", {"torque_n_m": None})
    assert price_of_point("joint", {"model": "equilibrium", "step_s": None})["foreseen"] == ""


def test_the_study_of_contributions_keeps_the_point(folders):
    study = parse_study(contribution_study(str(folders["grid"]), 5))
    assert {"joint_angle_deg": 7, "torque_n_m": -40, "bearing_radial_clearance_mm": 0.02}.items() <= study.base.items()
    assert study.base["initial_skew_2_deg"] == 0.3
    assert make_points(study).count == 32


def test_the_study_of_contributions_leaves_off_what_is_off(tmp_path):
    """Regression: "groove_rolling is both a base value and a factor; remove it from [base]"."""
    text = GRID.replace("[base]", "[base]\ngroove_rolling = 0\nneedle_rolling = 1")
    (tmp_path / "a.toml").write_text(text.replace("values = [-0.03, 0.02]", "values = [0.02]"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
        td.run(tmp_path / "a.toml", out=tmp_path / "out", workers=0)
    study = parse_study(contribution_study(str(tmp_path / "out"), 1))
    assert study.base["groove_rolling"] == 0
    assert set(study.switches) == {"groove_sliding", "groove_spinning", "needle_sliding", "needle_rolling"}


def analysed(dims, coords, **attrs):
    sizes = [len(coords[dim]) for dim in dims]
    return xr.Dataset({"number": (dims, np.arange(np.prod(sizes), dtype=float).reshape(sizes))}, coords, attrs)


@pytest.mark.parametrize(
    ("result", "cell", "view"),
    [
        (
            analysed(["factor", "order"], {"factor": ["torque_n_m", "joint_angle_deg"], "order": [0, 3]}),
            1,
            {"x": "torque_n_m", "select": ("order=3",)},
        ),
        (
            analysed(["term", "order"], {"term": ["torque_n_m:joint_angle_deg"], "order": [6]}),
            0,
            {"x": "torque_n_m", "by": "joint_angle_deg", "select": ("order=6",)},
        ),
        (
            analysed(
                ["joint_angle_deg", "pair"],
                {"joint_angle_deg": [2, 13], "pair": ["torque_n_m + bearing_radial_clearance_mm"]},
            ),
            1,
            {"x": "torque_n_m", "by": "bearing_radial_clearance_mm", "select": ("joint_angle_deg=13",)},
        ),
        (analysed(["probability"], {"probability": [0.05, 0.95]}), 1, {"where": "thrust_amplitude >= 1"}),
        (analysed(["share"], {"share": [0.005, 0.5]}), 0, {"where": "thrust_amplitude <= 0"}),
        (analysed(["output"], {"output": ["thrust"]}), 0, {"variable": "thrust"}),
    ],
)
def test_behind_a_number_are_the_points_of_its_factors_at_its_place(folders, result, cell, view):
    found = view_behind(
        numbered(td.open_cube(folders["grid"])), result.assign_attrs(outputs="thrust_amplitude"), "number", cell
    )
    assert {name: getattr(found, name) for name in view} == view
    assert found.variable == view.get("variable", "thrust_amplitude")
    draw(td.open_cube(folders["grid"]), full_view(td.open_cube(folders["grid"]), found))  # it can be shown


def test_a_study_that_runs_is_explored_as_far_as_it_is(folders, tmp_path):
    """Its finished points stand in the journal alone."""
    shutil.copytree(folders["grid"], tmp_path / "out")
    (tmp_path / "out" / "cube.nc").unlink()
    view = [["kind", "lines"], ["select", "bearing_radial_clearance_mm=0.02"]]
    assert figure(str(tmp_path / "out"), view, None) == figure(str(folders["grid"]), view, None)
    shutil.rmtree(tmp_path / "out")
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="no cube"):
        explore(str(tmp_path / "out"), view, "x")


def test_wrong_names_are_told_with_a_near_one(folders):
    with pytest.raises(InputError, match="did you mean 'thrust_amplitude'"):
        explore(str(folders["grid"]), [["variable", "thrust_amplitud"]], "x")
    with pytest.raises(InputError, match="analysis = 'none'"):
        figure(str(folders["grid"]), [["analysis", "none"]], None)


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("minus=point=nan", "minus = 'point=nan': a number is needed"),
        ("minus=pint=3", "minus = 'pint': not a coordinate"),
        ("x=thrust", "x = 'thrust': not a coordinate"),
        ("by=torque", "by = 'torque': not a coordinate of this cube; did you mean 'torque_n_m'"),
        ("select=ordr=3", "select = 'ordr': not a coordinate of this cube; did you mean 'order'"),
        ("low=5&high=1", "low = 5: not below high = 1"),
        ("where=1/0", "not a condition"),
    ],
)
def test_wrong_parts_of_a_view_are_refused_by_its_figure(folders, address, told):
    """They were passed over in silence, and another view was drawn."""
    items = [tuple(part.split("=", 1)) for part in address.split("&")]
    for ask in (figure, numbers):
        with pytest.raises(InputError) as refused:
            ask(str(folders["list"]), items, None)
        assert told in str(refused.value)


@pytest.mark.parametrize("kind", ["points", "lines", "matrix", "parallel", ""])
@pytest.mark.parametrize("variable", ["thrust_amplitude", "thrust"])
def test_one_point_of_a_list_is_drawn(folders, kind, variable):
    """Its factors were lost with the dimension of the points: a KeyError."""
    items = [("variable", variable), ("kind", kind), ("select", "order=3"), ("select", "point=5")]
    drawn = json.loads(figure(str(folders["list"]), items, None))
    assert drawn["axes"] if kind in ("matrix", "parallel") else drawn["data"]


def test_an_analysis_has_nothing_to_subtract_from(folders):
    axis = xr.Dataset({"S1": ("factor", [0.1, 0.9])}, {"factor": ["a", "b"]})
    with pytest.raises(InputError, match="minus = 'abc': an analysis has no points"):
        drawn_view(axis, View(minus="abc"))


def test_many_points_are_drawn_as_their_density():
    generator = np.random.default_rng(1)
    data = xr.Dataset(
        {"force": ("point", generator.normal(size=9000)), "outcome": ("point", np.zeros(9000, np.int8))},
        {"load": ("point", generator.normal(size=9000))},
    )
    drawn = scatter(data, "load")["data"][0]
    assert drawn["type"] == "heatmap"
    assert np.sum(drawn["text"]) == 9000
    assert scatter(data.isel(point=slice(0, 50)), "load")["data"][0]["type"] == "scatter"


def test_known_errors_stand_as_bars():
    data = xr.Dataset({"force": ("load", [1.0, 2, 4]), "force_error": ("load", [0.1, 0.2, 0.3])}, {"load": [1.0, 2, 3]})
    assert np.array_equal(values(lines(data, "load")["data"][0]["error_y"]["array"]), [0.1, 0.2, 0.3])


def test_names_of_persons_are_written_as_such_in_labels_alone():
    fields = [field for group in study_form(GRID)["groups"] for field in group["fields"]]
    labels = {field["name"]: field["label"] for field in fields}
    assert labels["youngs_modulus_gpa"] == "Young's modulus (GPa)"
    assert labels["poissons_ratio"] == "Poisson's ratio"
    options = html.unescape(part("parameters.html", parameters=[["poissons_ratio", "0.3"]]))
    assert """<option value="poissons_ratio" data-default="0.3">Poisson's ratio</option>""" in options


@pytest.mark.parametrize(
    ("name", "field", "table"),
    [
        ("torque_n_m", "20, 40.5", {"values": [20, 40.5]}),
        ("torque_n_m", "7,", {"values": [7]}),
        ("joint_angle_deg", "2 : 14 : 5", {"low": 2, "high": 14, "count": 5}),
        ("speed_rpm", "100 : 1000 : 4 log", {"low": 100, "high": 1000, "count": 4, "scale": "log"}),
        ("roller_radius_mm", "15 : 17", {"low": 15, "high": 17}),
    ],
)
def test_a_field_becomes_a_factor_and_is_read_back(name, field, table):
    text = changed_text(gallery_upload("template-grid")["study"], f"parameter.{name}", field)
    study = tomllib.loads(text)
    assert study["factors"][name] == table
    assert name not in study.get("base", {})
    assert "# Remove the # before a line to use it." in text
    shown = {entry["name"]: entry["value"] for group in study_form(text)["groups"] for entry in group["fields"]}
    assert shown[name] == field
    fixed = tomllib.loads(changed_text(text, f"parameter.{name}", "12"))
    assert fixed["base"][name] == 12
    assert name not in fixed.get("factors", {})
    assert name not in tomllib.loads(changed_text(text, f"parameter.{name}", "")).get("factors", {})


def test_a_field_that_cannot_be_read_is_refused_in_words():
    with pytest.raises(InputError, match="low : high"):
        changed_text(GRID, "parameter.torque_n_m", "a : b")
    with pytest.raises(InputError, match="not valid TOML"):
        changed_text("[study", "study.name", "x")
    with pytest.raises(InputError, match=r"change parameter\.joint_angle_deg in the text"):
        changed_text("factors = {joint_angle_deg = {values = [1]}}", "parameter.joint_angle_deg", "7, 9")


@pytest.mark.parametrize("field", ["1,5", "1,5, 2,5", "1,200", "1.200,5", "1,200.5", "100,200,300", "25,50,"])
def test_a_comma_in_a_field_that_may_stand_in_a_number_is_refused(field):
    """Regression: 1,5 became the levels 1 and 5."""
    with pytest.raises(
        InputError, match=f"torque_n_m: {re.escape(field.split(', ')[0].rstrip(','))} may be one number"
    ):
        changed_text(GRID, "parameter.torque_n_m", field)


def test_levels_without_spaces_are_levels_and_other_digits_no_number():
    assert "values = [25, 50.5, 1e2]".replace("1e2", "100.0") in changed_text(
        GRID, "parameter.torque_n_m", "25,50.5,1e2"
    )
    for field in ("1_000", "\uff11\uff12"):
        study = tomllib.loads(changed_text(GRID, "parameter.torque_n_m", field))
        assert study["base"]["torque_n_m"] == field  # a text, which the parameter refuses


def test_a_long_field_is_kept_whole():
    """Regression: a field was cut at 200 characters, in the middle of a level."""
    levels = [1.25 + 0.25 * at for at in range(200)]
    text = changed_text(GRID, "parameter.torque_n_m", ", ".join(map(str, levels)))
    assert tomllib.loads(text)["factors"]["torque_n_m"]["values"] == levels
    with pytest.raises(InputError, match="more than 1,000 values"):
        changed_text(GRID, "parameter.torque_n_m", "1, " * 20_000)


def test_a_study_of_a_joint_is_at_the_operating_points_of_its_search():
    """Regression: it had the angles 4, 8 and 12 deg whatever the search was for."""
    base = '[base]\nmodel = "equilibrium"\njoint_angle_deg = 9\n'
    at = {"torque_n_m": {"values": [50, 60.5]}, "weights": [1, 2]}
    for search, factors in (
        ({"at": at}, {"torque_n_m": {"values": [50, 60.5]}}),
        ({"at": {"table": "values.csv"}}, {"joint_angle_deg": {"values": [9]}}),
    ):
        text = study_of_joint("j", base, 3, search)
        assert tomllib.loads(text)["factors"] == factors
        assert parse_study(text).file.study.name == "j, candidate 3"
    assert tomllib.loads(study_of_joint("j", "[base]\n", None, {}))["factors"]["joint_angle_deg"]["values"] == [
        4,
        8,
        12,
    ]


@pytest.mark.slow
def test_the_gallery_holds_only_studies_that_can_be_sent(tmp_path):
    entries = gallery()
    ids = {entry["id"] for entry in entries}
    assert {"template-grid", "template-sensitivity", "template-contribution", "thrust_map", "speed_needle"} <= ids
    assert {"workflow-small", "workflow-paper", "optimisation-smaller_joint", "fit-frictions"} <= ids
    limits = Limits(points=2_000_000)
    for entry in entries:
        upload = gallery_upload(entry["id"])
        kind, texts = upload_texts(upload)
        assert kind == entry["kind"]
        folder = tmp_path / entry["id"]
        write_upload(folder, texts)
        if entry["id"].startswith(("template-", "fit-", "optimisation-")):
            assert plan_upload(folder, kind, limits, timing=False)["kind"] == kind
        else:  # as cheap as it is: no function, and no file that is not sent
            load = load_study if kind == "study" else load_workflow
            load(folder / main_file(kind), folder=StudyFolder(folder, trusted=False))
        assert len(json.dumps(upload)) < limits.body_bytes
    with pytest.raises(InputError, match="no study or workflow of this name"):
        gallery_upload("../pyproject")


def test_levels_of_a_factor_keep_its_base_value_where_the_design_starts_from_it():
    text = '[base]\nspeed_rpm = 450\n[factors.speed_rpm]\nvalues = [300, 600]\n[design]\nkind = "{}"\n'
    for kind, kept in (("one-at-a-time", 1), ("grid", 0)):
        changed = changed_text(text.format(kind), "parameter.speed_rpm", "200, 500")
        assert changed.count("speed_rpm = 450") == kept
        assert "values = [200, 500]" in changed


def test_names_and_units_show_as_they_are_written(folders):
    """Plotly makes links and styles of texts that ask for them."""
    cube = td.open_cube(folders["grid"]).load()
    link = "<a href='https://example.org'>N</a>"
    cube["thrust_amplitude"].attrs["units"] = cube["torque_n_m"].attrs["units"] = link
    view = full_view(cube, View(kind="lines", x="joint_angle_deg", by="torque_n_m", select=("order=3",)))
    point = cube[["thrust_amplitude"]].isel(joint_angle_deg=0, torque_n_m=0, bearing_radial_clearance_mm=1)
    drawn = [draw(cube, view), *point_figures(point).values()]
    assert len(drawn) == 2
    for each in drawn:
        text = json.dumps(each)
        assert "&lt;a href" in text
        assert not re.search(r"<(?!/?b>|br>|/?extra>)", text)


def test_a_change_of_design_leaves_no_key_behind():
    """Regression: the next check of the form refused keys of the kind before, which the form does not show."""
    text = changed_text(gallery_upload("template-grid")["study"], "design.kind", "morris")
    for key, value in (("samples", "8"), ("levels", "4"), ("seed", "3")):
        text = changed_text(text, f"design.{key}", value)
    assert tomllib.loads(text)["design"] == {"kind": "morris", "samples": 8, "levels": 4, "seed": 3}
    text = changed_text(text, "design.kind", "sobol")
    assert tomllib.loads(text)["design"] == {"kind": "sobol", "samples": 8, "seed": 3}
    assert tomllib.loads(changed_text(text, "design.kind", "grid"))["design"] == {"kind": "grid"}
