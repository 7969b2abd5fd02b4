"""One record and its operating point: what it states counts for every way to compare it."""

from __future__ import annotations

import json

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.analyses.comparison.record_comparison import ComparisonSettings, compare_file
from tripod_doe.cli import main
from tripod_doe.service.explorer.uploaded_measurement import compare_upload
from tripod_doe.study.definition.study_folder import StudyFolder

pytestmark = pytest.mark.usefixtures("pages_not_made")

STUDY = """
[study]
name = "rig"
[base]
model = "equilibrium"
torque_n_m = 100
[factors]
joint_angle_deg = {values = [8, 12]}
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""
NEAREST = {"nearest": False, "columns": {}, "pulses_per_revolution": None, "sign": 1, "reference_angle": None}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    (folder / "study.toml").write_text(STUDY)
    td.run(folder / "study.toml", out=folder / "out", progress=False, workers=0)
    angle = np.arange(720)
    rows = "\n".join(f"{a},{11.6 * np.cos(np.radians(3 * a)):.6f}" for a in angle)
    (folder / "record.csv").write_text(f"Joint angle: 8 deg\nTorque: 50 Nm\nrotation_deg,thrust_n\n{rows}\n")
    return folder


def third(compared):
    return float(compared["model_amplitude"].sel(order=3))


def compared_everywhere(rig, select, capsys):
    """The third order of the model and the remarks: by command, on the page and in a workflow."""
    words = ["compare", str(rig / "out"), str(rig / "record.csv"), *(f"--select={text}" for text in select)]
    assert main([*words, "--format", "json"]) == 0
    by_command = json.loads(capsys.readouterr().out)
    text = (rig / "record.csv").read_text()
    on_page = compare_upload(str(rig / "out"), text, select=select, speeds=None, **NEAREST)
    settings = ComparisonSettings(measurement="record.csv", select=select)
    in_workflow = compare_file({"rig": td.open_cube(rig / "out")}, settings, StudyFolder(rig))
    assert by_command | {"measurement": ""} == on_page | {"measurement": ""}
    return third(in_workflow), str(in_workflow.attrs["remarks"])


def test_a_record_that_states_its_torque_is_compared_there(rig, capsys):
    """Regression: page and workflow took the 100 N m of the study, and said that the order agrees."""
    there = td.simulate(model="equilibrium", joint_angle_deg=8, torque_n_m=50)
    found, remarks = compared_everywhere(rig, [], capsys)
    assert found == pytest.approx(float(there["thrust_amplitude"].sel(order=3)))
    assert "The cube lacks the point of this record" in remarks


def test_a_selection_that_contradicts_the_record_counts_and_is_stated(rig, capsys):
    there = td.simulate(model="equilibrium", joint_angle_deg=12, torque_n_m=50)
    found, remarks = compared_everywhere(rig, ["joint_angle_deg=12"], capsys)
    assert found == pytest.approx(float(there["thrust_amplitude"].sel(order=3)))
    assert "The record states joint angle 8 deg, while 12 deg is selected" in remarks


def test_a_decimal_comma_in_a_selection_is_named_before_the_torque(rig, capsys):
    """Regression: the refusal spoke of the torque of the record alone, which a right selection would have simulated."""
    words = ["compare", str(rig / "out"), str(rig / "record.csv"), "--select", "joint_angle_deg=11,5"]
    assert main(words) == 2
    assert "write 11.5 with a decimal point" in capsys.readouterr().err


def test_a_record_without_time_states_its_speed(rig, tmp_path, capsys):
    """Regression: of a cube with several speeds, a speed in the notes of a record without time was not read."""
    text = STUDY.replace(
        "joint_angle_deg = {values = [8, 12]}", "speed_rpm = {values = [300, 600]}\njoint_angle_deg.values = [8]"
    )
    (tmp_path / "study.toml").write_text(text.replace("torque_n_m = 100", "torque_n_m = 50"))
    td.run(tmp_path / "study.toml", out=tmp_path / "out", progress=False, workers=0)
    record = "Speed: 600 rpm\n" + (rig / "record.csv").read_text()
    (tmp_path / "record.csv").write_text(record)
    found, _ = compared_everywhere(tmp_path, [], capsys)
    assert found == pytest.approx(
        float(td.open_cube(tmp_path / "out")["thrust_amplitude"].sel(speed_rpm=600, joint_angle_deg=8, order=3))
    )
