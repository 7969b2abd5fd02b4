"""Cubes: labelled, conforming, honest about what failed."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.model_interface import Departure, ModelErrors, ModelSummary, Trust, ValidRange
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.cube.model_records import model_records
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution.task import make_task, run_task
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import FinishedBlock

pytestmark = pytest.mark.usefixtures("pages_not_made")

GRID = """
[study]
name = "grid"
question = "?"
[factors]
joint_angle_deg = {values = [5, 10, 15]}
model = {values = ["equilibrium"]}
"""
SAMPLED = """
[study]
name = "sampled"
[factors]
joint_angle_deg = {low = 5, high = 15}
torque_n_m = {low = 25, high = 100}
[design]
kind = "saltelli"
samples = 8
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg", "largest_penetration_um"]
"""


ABLATION = """
[study]
name = "ablation"
[factors]
joint_angle_deg = {values = [5, 10]}
[design]
kind = "product"
of = ["angle", "switches"]
[design.angle]
factors = ["joint_angle_deg"]
[design.switches]
kind = "ablation"
factors = ["groove_sliding", "groove_rolling"]
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""


def cube_of(text, blocks=1, run=None):
    study = parse_study(text)
    points = make_points(study)
    keys = point_keys(study, points)
    finished = []
    for chosen in np.array_split(np.arange(points.count), blocks)[:run]:
        result, cpu, wall = run_task(make_task(study, points, chosen))
        finished.append(FinishedBlock(keys[chosen], result, cpu, wall, "0"))
    return build_cube(study, points, keys, iter(finished))


@pytest.mark.slow
def test_files_conform_to_cf(tmp_path):
    """The checker's own verdict, CF 1.8; every file kind that a run writes."""
    files = {"grid": cube_of(GRID)[0], "ablation": cube_of(ABLATION)[0]}
    files["sampled"], files["cost"] = cube_of(SAMPLED)
    for kind, cube, analysis in (
        ("sobol", files["sampled"], td.sobol_indices),
        ("contribution", files["ablation"], td.contribution_shares),
    ):
        attrs = {key: cube.attrs[key] for key in ("Conventions", "title", "institution", "source", "references")}
        files[kind] = analysis(cube).assign_attrs(attrs)
    for kind, content in files.items():
        write_dataset(content.assign_attrs(history="made by a test"), tmp_path / f"{kind}.nc")
    report = tmp_path / "report.json"
    command = [
        str(Path(sys.executable).with_name("compliance-checker")),
        "-t",
        "cf:1.8",
        "-c",
        "strict",
        "-f",
        "json_new",
        "-o",
        str(report),
        *(str(tmp_path / f"{kind}.nc") for kind in files),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert report.exists(), done.stdout + done.stderr
    verdicts = {Path(path).stem: verdict["cf:1.8"] for path, verdict in json.loads(report.read_text()).items()}
    assert verdicts.keys() == files.keys()
    errors = [
        f"{kind}: {check['name']}: {check['msgs']}"
        for kind, verdict in verdicts.items()
        for check in verdict["high_priorities"]
        if check["value"][0] < check["value"][1]
    ]
    assert not errors, "\n".join(errors)
    assert all(verdict["high_priorities"] for verdict in verdicts.values())


def test_a_cube_survives_the_disk(tmp_path):
    cube, _ = cube_of(GRID)
    write_dataset(cube, tmp_path / "cube.nc")
    stored = td.open_cube(tmp_path / "cube.nc")
    xr.testing.assert_equal(stored, cube)
    for name in cube.variables:
        assert stored[name].attrs.keys() >= {"long_name"} & cube[name].attrs.keys()
    assert stored["joint_angle_deg"].attrs["units"] == "degree"
    assert stored["outcome"].attrs["flag_meanings"].split()[:2] == ["finished", "diverged"]


def test_every_variable_says_what_it_is():
    cube, cost = cube_of(GRID)
    for dataset in (cube, cost):
        for name, variable in dataset.variables.items():
            assert variable.attrs.get("long_name"), name
    for key in ("Conventions", "study", "study_hash", "kernel_source_hash", "package_versions", "source"):
        assert cube.attrs[key]


def test_fixed_parameters_are_those_that_all_points_share(tmp_path):
    text = '[study]\nname="f"\n[base]\ntorque_n_m=60\n[factors]\ngroove_sliding_friction={values=[0.03, 0.05]}'
    fixed = json.loads(cube_of(text)[0].attrs["fixed_parameters"])
    assert fixed["torque_n_m"] == 60
    assert "groove_sliding_friction" not in fixed
    assert "groove_spin_friction" not in fixed  # it follows the sliding friction
    given = json.loads(cube_of(text.replace("torque_n_m=60", "groove_spin_friction=0.04"))[0].attrs["fixed_parameters"])
    assert given["groove_spin_friction"] == 0.04
    (tmp_path / "t.csv").write_text("joint_angle_deg\n5\n7\n")
    table = parse_study('[study]\nname="t"\n[design]\nkind="table"\ntable="t.csv"', folder=StudyFolder(tmp_path))
    points = make_points(table)
    cube, _ = build_cube(table, points, point_keys(table, points), iter(()))
    assert "joint_angle_deg" not in json.loads(cube.attrs["fixed_parameters"])


def test_what_was_not_run_is_flagged():
    study = parse_study(GRID)
    points = make_points(study)
    cube, _ = build_cube(study, points, point_keys(study, points), iter(()))
    assert (cube["outcome"] == td.Outcome.NOT_RUN).all()
    assert "excluded" not in cube


def test_points_that_have_not_run_get_no_known_error():
    """Regression: for 200,000 points that had not run, opening a cube took 12 s."""
    cube = cube_of(GRID, blocks=3, run=2)[0]
    assert cube["outcome"].values.ravel().tolist() == [td.Outcome.FINISHED] * 2 + [td.Outcome.NOT_RUN]
    assert np.isfinite(cube["model_error"].values).ravel().tolist() == [True, True, False]


def test_what_a_constraint_excludes_is_flagged_apart():
    study = parse_study(GRID + '[design]\nconstraints = ["joint_angle_deg < 12"]\n')
    points = make_points(study)
    cube, _ = build_cube(study, points, point_keys(study, points), iter(()))
    assert cube["excluded"].values.ravel().tolist() == [0, 0, 1]


def test_blocks_do_not_matter():
    one, three = cube_of(SAMPLED)[0], cube_of(SAMPLED, blocks=5)[0]
    xr.testing.assert_identical(one, three)


def test_a_failed_write_keeps_the_old_file(tmp_path):
    cube, _ = cube_of(GRID)
    write_dataset(cube, tmp_path / "cube.nc")
    before = (tmp_path / "cube.nc").read_bytes()
    (tmp_path / ".cube.nc.new").mkdir()
    with pytest.raises(td.StorageError, match="nothing that was finished is lost"):
        write_dataset(cube, tmp_path / "cube.nc")
    assert (tmp_path / "cube.nc").read_bytes() == before


def test_a_metric_that_is_not_finite_does_not_pass():
    study = parse_study(SAMPLED)
    points = make_points(study)
    keys = point_keys(study, points)
    result, cpu, wall = run_task(make_task(study, points, np.arange(points.count)))
    result.outputs["thrust_amplitude"].data[3, 3] = np.nan
    with pytest.raises(td.CubeError, match="thrust_amplitude: a finished point is not finite"):
        build_cube(study, points, keys, iter([FinishedBlock(keys, result, cpu, wall, "0")]))


def test_a_cube_names_its_model_and_the_error_known_for_it():
    cube, _ = cube_of(
        '[study]\nname = "m"\n[factors]\njoint_angle_deg = {values = [1, 10, 30]}\n[keep]\noutputs = ["thrust_amplitude"]\n'
    )
    assert cube.attrs["models"] == "kinetostatic"
    verdict, errors, *_ = cube.attrs["model_notes"].splitlines()
    assert verdict.startswith("Verdict on the third order: sure at 1, ")
    assert errors.startswith("Model kinetostatic: typical error of the third order")
    assert "error not known at 1 of 3 points (33 %): joint_angle_deg is outside" in cube.attrs["model_notes"]
    assert np.isfinite(cube["model_error"].values).tolist() == [True, True, False]
    assert (cube["model_error"] <= cube["model_error_limit"]).values.tolist() == [True, True, False]
    assert cube["joint_angle_deg"].attrs["source"] == "this study"


def test_notes_on_the_models_of_an_ablation_are_those_with_all_mechanisms_on():
    """Regression: "error not known at 224 of 256 points" counted combinations with mechanisms switched off."""
    study = parse_study(ABLATION.replace("[5, 10]", "[5, 10, 12, 35]"))
    points = make_points(study)
    (message,) = model_records(study, points, points.allowed).error_sentences
    assert message.startswith("Model kinetostatic with all mechanisms on: typical error of the third order")
    assert "error not known at 1 of 4 points (25 %): joint_angle_deg is outside" in message


def test_a_joint_whose_parts_do_not_fit_has_neither_error_nor_verdict(tmp_path):
    """Regression: "typical error 0.12 %" stood beside rollers that overlap."""
    text = (
        '[study]\nname = "m"\n[base]\nmodel = "equilibrium"\n[factors]\nroller_radius_mm = {values = [16, 28]}\n'
        '[keep]\noutputs = ["thrust_amplitude"]\n'
    )
    (tmp_path / "m.toml").write_text(text)
    td.run(tmp_path / "m.toml", out=tmp_path / "m", workers=0, progress=False)
    cube = td.open_cube(tmp_path / "m")
    assert cube["outcome"].values.tolist() == [td.Outcome.FINISHED, td.Outcome.JAMMED]
    assert np.isnan(cube["model_error"].values).tolist() == [False, True]
    assert cube["trust"].values[1] == Trust.NOT_KNOWN
    assert cube["trust"].values[0] != Trust.NOT_KNOWN
    assert not re.search(r"of 2 points|all 2 points", cube.attrs["model_notes"])
    planned = td.plan(tmp_path / "m.toml", timing=False)
    assert not re.search(r"of 2 points|all 2 points", "".join(planned.models))


def test_values_that_follow_from_a_factor_are_not_fixed():
    """Regression: of a list whose first and last point agree, a value in between was not seen."""
    text = (
        '[study]\nname = "m"\n[factors]\nroller_radius_mm = {values = [16, 15, 16]}\n'
        'model = {values = ["equilibrium", "rollers", "equilibrium"]}\n[design]\nkind = "zip"\n'
    )
    fixed = json.loads(cube_of(text)[0].attrs["fixed_parameters"])
    assert not {"groove_rolling_lever_mm", "method", "model"} & fixed.keys()
    own = text.replace("[factors]", "[base]\ngroove_rolling_lever_mm = 14\n[factors]")
    assert json.loads(cube_of(own)[0].attrs["fixed_parameters"])["groove_rolling_lever_mm"] == 14


@pytest.mark.parametrize(
    ("reasons", "message"),
    [
        ("abc", "case a (1 point); case b (1 point); case c (1 point)"),
        ("aabbccd", "case a (2 points); case b (2 points); other reasons (3 points), most often case c"),
    ],
)
def test_reasons_for_an_unknown_error_are_named(reasons, message):
    unknown = np.array([f"case {letter}" for letter in reasons], object)
    nan = np.full(unknown.size, np.nan)
    summary = ModelSummary()
    summary.add(ModelErrors("third order", "fine", np.full(unknown.size, "coarse", object), nan, nan, unknown))
    assert summary.error_texts == [f"Model coarse: error not known: {message}."]


def test_the_errors_of_some_points_keep_the_ranges_that_these_leave():
    left = Departure("m", ValidRange("x", "why", high=1), np.array([False, True, True, False]), np.array([2.0, 3.0]))
    models, nan = np.full(4, "m", object), np.full(4, np.nan)
    errors = ModelErrors("q", "fine", models, nan, nan, np.full(4, "no", object), [left])
    (kept,) = errors.of(np.array([True, False, True, False])).departures
    assert kept.outside.tolist() == [False, True]
    assert kept.values.tolist() == [3.0]
