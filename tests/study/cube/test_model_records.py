"""Sentences on the models of a study count the points that its sentences are about."""

from __future__ import annotations

import re

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.model_interface.verdict import Trust
from tripod_doe.study.cube.model_records import model_records
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

pytestmark = pytest.mark.usefixtures("pages_not_made")


@pytest.mark.parametrize("models", [("equilibrium", "kinetostatic"), ("equilibrium", "kinetostatic", "rollers")])
def test_models_that_only_narrow_intervals_are_not_judged(models):
    """Invariance: neither the verdict nor a warning of a multifidelity study is about a point of a cheaper model."""
    study = parse_study(
        f"""
[study]
name = "t"
[base]
groove_sliding_friction = 0.09
[factors]
model = {{values = {list(models)}}}
joint_angle_deg = {{low = 1, high = 13}}
torque_n_m = {{low = -300, high = 300}}
speed_rpm = {{low = 60, high = 1400}}
[design]
kind = "multifidelity"
samples = 16
indices = false
"""
    )
    points = make_points(study)
    records = model_records(study, points, np.ones(points.count, bool))
    truth = int((points.columns["model"] == models[-1]).sum())
    (verdict,) = records.verdict
    counts = [
        int(each)
        for each in re.findall(r"(?:sure|usable|doubtful|known) at (?:all )?(\d+)", verdict.split("; check")[0])
    ]
    assert sum(counts) == truth < points.count
    texts = [*records.error_sentences, *records.warnings, *records.attributes["model_notes"].splitlines()]
    assert any(models[-1] in text for text in texts)
    assert not [text for text in texts if any(cheap in text for cheap in models[:-1])]


def test_a_joint_that_vibrates_is_doubtful_without_its_vibration(tmp_path):
    """Regression: "sure at all points" beside a note on a self-excited vibration, which the model leaves out."""
    joint = {
        "pitch_radius_mm": 25.5, "roller_radius_mm": 18.5, "roller_width_mm": 13.0, "groove_radius_ratio": 1.012,
        "groove_sliding_friction": 0.055, "needle_sliding_friction": 0.03, "needle_count": 30, "needle_diameter_mm": 2.2,
        "needle_length_mm": 11.0, "needle_pitch_diameter_mm": 21.376, "bearing_radial_clearance_mm": 0.012,
        "torque_n_m": 40.0, "speed_rpm": 750.0,
    }  # fmt: skip
    study = {
        "study": {"name": "v"},
        "base": joint,
        "factors": {"joint_angle_deg": {"values": [6.0, 12.7]}},
        "keep": {"outputs": ["thrust_amplitude", "vibrates"]},
    }
    td.run(study, out=tmp_path / "out", workers=0, progress=False)
    with td.open_cube(tmp_path / "out") as cube:
        assert cube["vibrates"].values[1] == 1
        assert cube["trust"].values.tolist() == [Trust.SURE, Trust.DOUBTFUL]


@pytest.mark.parametrize(("friction", "word"), [(0.045, "sure"), (0.055, "usable")])
def test_nobody_is_sure_of_a_joint_like_vibrating_ones_that_was_not_looked_at(friction, word):
    """Regression: a joint was "sure" where similar ones vibrate, unless the study kept whether it does."""
    study = parse_study(
        f"""
[study]
name = "t"
[base]
groove_sliding_friction = {friction}
[factors.joint_angle_deg]
values = [13.0, 13.1]
"""
    )
    points = make_points(study)
    records = model_records(study, points, np.ones(points.count, bool))
    (verdict,) = records.verdict
    assert f": {word} at all 2 points, since " in verdict
    assert ("the output vibrates shows whether these do" in verdict) == (word == "usable")
    calm = study.simulator.model_errors(
        study.simulator.columns(study.base, points.columns, 2), {"vibrates": np.zeros(2)}
    )
    assert not calm.unsettled.any()
