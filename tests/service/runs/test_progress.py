"""Counts of the points of a run, from its journal."""

from __future__ import annotations

from tripod_doe.service.runs.progress import Progress
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.study.study_points import StudyPoints

SEVERAL = """
[study]
name = "two models"
[factors.joint_angle_deg]
low = 5
high = 12
[factors.model]
values = ["equilibrium", "kinetostatic"]
[design]
kind = "multifidelity"
samples = 16
pilot = 16
split = { equilibrium = 30, kinetostatic = 16 }
prices = { equilibrium = 0.001, kinetostatic = 0.01 }
"""


def test_the_points_that_a_pilot_asks_for_are_counted_before_they_run(tmp_path):
    """Regression: such a study said that no point was missing while most of them were computed."""
    (tmp_path / "study.toml").write_text(SEVERAL)
    study = load_study(tmp_path / "study.toml")
    progress = Progress(tmp_path / "out", total=32)
    assert progress.read().missing == 32
    with ResultDirectory(tmp_path / "out") as directory:
        directory.accept(StudyPoints(study, make_points(study)))
        assert progress.read().missing == 2 * (16 + 30)
    with ResultDirectory(tmp_path / "other") as directory:  # of a study that grew: its new points are not all known yet
        directory.note_further(5)
        assert Progress(tmp_path / "other", total=0).read().missing == 5
