"""Differences of two studies: what was asked, and what came out at the points that both have."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.analyses.diff.diff import diff, diff_cubes
from tripod_doe.analyses.diff.sentences import diff_csv, diff_json, diff_text
from tripod_doe.cli import main
from tripod_doe.study.cube import lazy_dataset
from tripod_doe.study.result_directory import open_cube

pytestmark = pytest.mark.usefixtures("pages_not_made")

GRID = """
[study]
name = "grid"
[base]
model = "equilibrium"
pitch_radius_mm = {radius}
[factors]
joint_angle_deg = {{values = {angles}}}
torque_n_m = {{values = {torques}}}
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""
LIST = """
[study]
name = "list"
[base]
model = "equilibrium"
torque_n_m = 50
[factors]
joint_angle_deg = {values = [12, 7, 30]}
[design]
kind = "zip"
[keep]
outputs = ["thrust_amplitude"]
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two grids that share four points, of joints of another size, and a list that shares two with the first."""
    folder = tmp_path_factory.mktemp("diff")
    texts = {
        "a": GRID.format(radius=21, angles=[2, 7, 12], torques=[50, -80]),
        "b": GRID.format(radius=24, angles=[7, 12, 20], torques=[-80, 50, 90]),
        "list": LIST,
    }
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
        td.run(folder / f"{name}.toml", out=folder / name, progress=False, workers=0)
    return folder


@pytest.mark.slow
def test_results_are_compared_at_shared_points_only(runs):
    found = diff(runs / "a", runs / "b")
    assert found.points == {"a": 6, "b": 9, "shared": 4}
    a, b = (td.open_cube(runs / name)["thrust_amplitude"].sel(joint_angle_deg=[7, 12]) for name in "ab")
    change = b.sel(torque_n_m=a["torque_n_m"]) - a
    for one in found.results:
        part = change.sel(order=one.part["order"])
        assert one.difference == part.values.ravel()[np.abs(part.values).argmax()]
        assert one.difference == float(part.sel(one.at)) == one.b - one.a
        assert one.relative == pytest.approx(one.difference / one.a)
    assert found.results[0].part == {"order": 3}  # the largest first
    weights = [one.weight for one in found.results]
    assert weights == sorted(weights, reverse=True)


def test_keys_that_differ_are_listed_and_no_others(runs):
    found = diff(runs / "a", runs / "b")
    assert [one.key for one in found.study] == [
        "base.pitch_radius_mm",
        "factors.joint_angle_deg.values",
        "factors.torque_n_m.values",
    ]
    text = diff_text(found)
    assert "base.pitch_radius_mm: 21 -> 24" in text
    assert "factors.joint_angle_deg.values: added 20; left out 2" in text
    assert "factors.torque_n_m.values: added 90" in text
    assert found.program == []


def test_rows_of_the_parts_of_a_product_are_no_factors(tmp_path):
    """Regression: products of equal points in another order shared none, "no point has the same factor values"."""
    text = (
        '[study]\nname = "p"\n[base]\nmodel = "equilibrium"\n[factors]\njoint_angle_deg.values = [{}]\n'
        "torque_n_m.values = [30, 60]\nspeed_rpm.values = [300, 600]\n[design]\nkind = 'product'\nof = ['a', 'z']\n"
        "[design.a]\nkind = 'grid'\nfactors = ['joint_angle_deg']\n[design.z]\nkind = 'zip'\n"
        "factors = ['torque_n_m', 'speed_rpm']\n[keep]\noutputs = ['thrust_amplitude']\n"
    )
    for name, angles in (("one", "4, 8"), ("other", "9, 8, 4")):
        (tmp_path / f"{name}.toml").write_text(text.format(angles))
        td.run(tmp_path / f"{name}.toml", out=tmp_path / name, progress=False, workers=0)
    found = diff(tmp_path / "one", tmp_path / "other")
    assert found.points == {"a": 4, "b": 6, "shared": 4}
    assert [one.variable for one in found.equal] == ["thrust_amplitude"]
    assert not found.results


def test_a_factor_of_one_study_alone_is_matched_with_the_base_of_the_other(runs):
    found = diff(runs / "list", runs / "a")
    assert found.points == {"a": 3, "b": 6, "shared": 2}
    assert [one.difference for one in found.results] == []
    assert [(one.variable, one.numbers, one.points) for one in found.equal] == [("thrust_amplitude", 13, 2)]
    assert "thrust_amplitude (13 numbers a point): equal at all 2 shared points" in diff_text(found)


def test_studies_without_a_shared_point(runs, tmp_path):
    (tmp_path / "c.toml").write_text(GRID.format(radius=21, angles=[4, 5], torques=[50]))
    td.run(tmp_path / "c.toml", out=tmp_path / "c", progress=False, workers=0)
    found = diff(runs / "a", tmp_path / "c")
    assert found.points["shared"] == 0
    assert "No point of A has the same factor values" in diff_text(found)


def test_a_phase_differs_by_half_a_turn_at_most(runs):
    cube = td.open_cube(runs / "a")
    turned = cube.assign(thrust_phase_deg=(cube["thrust_phase_deg"] + 350 + 180) % 360 - 180)
    found = diff_cubes(cube, turned, ["thrust_phase_deg"])
    assert found.results
    assert [one.difference for one in found.results] == pytest.approx([-10] * len(found.results))
    assert {one.part["order"] for one in found.results} <= {
        int(order) for order in cube["order"] if (cube["thrust_amplitude"].sel(order=order) > 1e-9).any()
    }


def test_failed_points_and_defaults_of_another_version_are_stated(runs):
    cube = td.open_cube(runs / "a")
    outcome = cube["outcome"].copy()
    outcome[1, 0] = 2  # inaccurate
    amplitude = cube["thrust_amplitude"].copy()
    amplitude[1, 0] = np.nan
    fixed = json.loads(cube.attrs["fixed_parameters"]) | {"density_kg_m3": 7800.0}
    other = cube.assign(outcome=outcome, thrust_amplitude=amplitude)
    other.attrs |= {"fixed_parameters": json.dumps(fixed), "kernel_source_hash": "other"}
    found = diff_cubes(cube, other)
    (changed,) = found.outcomes
    assert (changed.a, changed.b) == ("finished", td.Outcome(2).label)
    assert changed.at == {
        "joint_angle_deg": float(cube["joint_angle_deg"][1]),
        "torque_n_m": float(cube["torque_n_m"][0]),
    }
    assert found.results == []
    assert [(one.key, one.a, one.b) for one in found.parameters] == [("density_kg_m3", 7850.0, 7800.0)]
    assert [one.key for one in found.program] == ["kernel_source_hash"]


def test_all_forms_say_the_same(runs):
    found = diff(runs / "a", runs / "b")
    plain = json.loads(diff_json(found))
    rows = [row for row in csv.DictReader(io.StringIO(diff_csv(found))) if row["kind"] == "result"]
    assert len(plain["results"]) == len(rows) == len(found.results)
    assert [float(row["difference"]) for row in rows] == [one["difference"] for one in plain["results"]]


def test_study_files_are_compared_without_results(runs):
    found = diff(runs / "a.toml", runs / "b")
    assert [one.key for one in found.study] == [one.key for one in diff(runs / "a", runs / "b").study]
    assert found.results == []
    assert diff_text(diff(runs / "a.toml", runs / "a.toml")).startswith("the studies are equal")


def test_a_value_that_stands_more_often_is_added(runs, tmp_path):
    """Regression: lists of other lengths with the same values were in another order."""
    text = (runs / "list.toml").read_text()
    for angles, told in (("12, 30, 7", "in another order"), ("12, 7, 30, 7, 7", "added 7, 7")):
        (tmp_path / "other.toml").write_text(text.replace("12, 7, 30", angles))
        assert f"joint_angle_deg.values: {told}" in diff_text(diff(runs / "list.toml", tmp_path / "other.toml"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a", "b", "--variable", "thrust_ampltude"], "did you mean 'thrust_amplitude'?"),
        (["a", "none"], "none: there is no such file"),
        (["a", "none.toml"], "cannot read the study file"),
    ],
)
def test_wrong_calls_name_the_remedy(runs, capsys, words, message):
    assert main(["diff", str(runs / words[0]), str(runs / words[1]), *words[2:]]) == 2
    assert message in capsys.readouterr().err


def test_the_command(runs, capsys):
    assert main(["diff", str(runs / "a"), str(runs / "b"), "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["points"]["shared"] == 4


@pytest.mark.slow
def test_of_large_cubes_what_is_compared_is_read(runs, monkeypatch):
    """Regression: two cubes of 14,400 points took 2.3 to 4.0 CPU-s and 1 GB, all of them read."""
    whole, read = diff_json(diff(runs / "a", runs / "b", ["thrust_phase_deg"])), set[str]()
    own = lazy_dataset._Array.__getitem__
    monkeypatch.setattr(open_cube, "_READ_AT_ONCE", 0)
    monkeypatch.setattr(
        lazy_dataset._Array, "__getitem__", lambda array, key: read.add(array.variable_name) or own(array, key)
    )
    assert diff_json(diff(runs / "a", runs / "b", ["thrust_phase_deg"])) == whole
    assert "thrust_phase_deg" in read
    assert not read & {"force_evaluations", "cpu_seconds", "solves"}


def test_an_open_field_of_a_table_matches_no_number(tmp_path):
    """Regression: the point that leaves the spin friction open was taken for the one with the largest."""
    text = '[study]\nname = "t"\n[base]\nmodel = "equilibrium"\n[design]\nkind = "table"\ntable = "{0}.csv"\n'
    for name, rows in {"a": "8,0.2\n8,\n8,0.01\n", "b": "8,\n"}.items():
        (tmp_path / f"{name}.csv").write_text("joint_angle_deg,groove_spin_friction\n" + rows)
        (tmp_path / f"{name}.toml").write_text(text.format(name))
        td.run(tmp_path / f"{name}.toml", out=tmp_path / name, progress=False, workers=0)
    assert diff(tmp_path / "a", tmp_path / "a").points["shared"] == 3
    found = diff(tmp_path / "a", tmp_path / "b")
    assert found.points["shared"] == 1
    assert found.results == []


def test_a_number_on_one_side_alone_is_no_equality(runs):
    cube = td.open_cube(runs / "a")
    amplitude = cube["thrust_amplitude"].copy()
    amplitude[0, 0, 3] = np.nan
    found = diff_cubes(cube, cube.assign(thrust_amplitude=amplitude))
    assert [(one.part, one.points) for one in found.one_sided] == [({"order": 3}, 1)]
    assert "equal at" not in diff_text(found)
    assert "thrust_amplitude, order 3: a number in one study only at 1 point" in diff_text(found)


def test_results_of_other_units_are_not_compared(runs):
    """Regression: their numbers stood side by side, both in the unit of A."""
    cube = td.open_cube(runs / "a")
    other = cube.assign(thrust_amplitude=cube["thrust_amplitude"] / 1000)
    other["thrust_amplitude"].attrs["units"] = "kN"
    for wanted in ((), ["thrust_amplitude"]):
        found = diff_cubes(cube, other, wanted)
        assert (found.results, found.equal) == ([], [])
        lines = diff_text(found).splitlines()
        assert lines[0] == "results that are not compared, since their units differ"
        assert "  thrust_amplitude: N -> kN" in lines
        assert "no result has" not in diff_text(found)
        assert "unit,thrust_amplitude,,N,kN,," in diff_csv(found).splitlines()
        assert json.loads(diff_json(found))["units"] == [{"key": "thrust_amplitude", "a": "N", "b": "kN"}]


def test_a_variable_that_is_asked_for_and_equal_is_named(runs):
    """Regression: nothing was printed for it beside one that differs."""
    cube = td.open_cube(runs / "a")
    phases = cube["thrust_phase_deg"].copy()
    phases[0, 0] = np.nan
    cube = cube.assign(thrust_phase_deg=phases)
    found = diff_cubes(
        cube, cube.assign(thrust_amplitude=2 * cube["thrust_amplitude"]), ["thrust_amplitude", "thrust_phase_deg"]
    )
    (equal,) = found.equal
    assert equal.points == 5
    line = f"thrust_phase_deg ({equal.numbers} numbers a point): equal wherever both have one (5 or more of 6 shared points)"
    assert line in diff_text(found)
    assert "thrust_amplitude (" not in diff_text(found)
    assert "equal,thrust_phase_deg,5 points,,,," in diff_csv(found).splitlines()


@pytest.mark.parametrize("name", ["fixed_parameters", "package_versions"])
@pytest.mark.parametrize("value", ["no JSON", "[1]", '{"a": [1]}', "[" * 50_000])
def test_a_damaged_attribute_is_named(runs, name, value):
    cube = td.open_cube(runs / "a")
    with pytest.raises(td.CubeError, match=f"the attribute {name} of this cube is damaged"):
        diff_cubes(cube, cube.assign_attrs({name: value}))
