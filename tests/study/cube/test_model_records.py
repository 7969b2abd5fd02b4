"""Sentences on the models of a study count the points that its sentences are about."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tripod_doe.study.cube.model_records import model_records
from tripod_doe.study.definition.study import parse_study
from tripod_doe.study.designs import make_points


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
    counts = [int(each) for each in re.findall(r"(?:sure|usable|doubtful|known) at (?:all )?(\d+)", verdict)]
    assert sum(counts) == truth < points.count
    texts = [*records.error_sentences, *records.warnings, *records.attributes["model_notes"].splitlines()]
    assert any(models[-1] in text for text in texts)
    assert not [text for text in texts if any(cheap in text for cheap in models[:-1])]
