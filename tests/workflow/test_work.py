"""How much of the work of a run its first points are."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.study_points import StudyPoints
from tripod_doe.workflow.progress import Progress, work_of

SEVERAL = """
[study]
name = "s"
[factors.joint_angle_deg]
low = 4
high = 14
[factors.model]
values = ["equilibrium", "kinetostatic"]
[design]
kind = "multifidelity"
indices = false
samples = 250
split = {equilibrium = 1000, kinetostatic = 250}
prices = {equilibrium = 1e-4, kinetostatic = 1e-2}
"""


def work(text):
    study = parse_study(text)
    asked = StudyPoints(study, make_points(study))
    return work_of(asked, np.arange(asked.points.count))


def test_work_of_several_models():
    """Exact: 250 points of a price of 10 ms, which come first, and 1000 of 0.1 ms."""
    done = work(SEVERAL)
    assert [done(count) for count in (0, 100, 200, 1250)] == pytest.approx([0, 1, 2, 2.6])
    assert done(700) - done(600) == pytest.approx(0.01)


def test_work_of_a_grid_over_models_goes_by_recorded_prices():
    text = SEVERAL.split("[design]")[0].replace("high = 14", "high = 14\ncount = 100") + '[design]\nkind = "grid"\n'
    study = parse_study(text)
    cheap, dear = (study.simulator.recorded_price({"model": model}) for model in ("equilibrium", "kinetostatic"))
    assert work(text)(200) == pytest.approx(100 * (cheap + dear), rel=1e-12)


def test_points_of_one_kind_count_one_each():
    one = SEVERAL.split("[factors.model]")[0].replace("high = 14", "high = 14\ncount = 100")
    assert work(one + '[design]\nkind = "grid"\n') is float


def test_the_time_left_goes_by_the_work(monkeypatch, capsys):
    """Exact: 250 dear points took 250 s of 260."""
    passed = [0.0]
    monkeypatch.setattr("tripod_doe.workflow.progress.time.monotonic", lambda: passed[0])
    with Progress(1250, shown=True, work=work(SEVERAL)) as message:
        message.add(50)
        passed[0] = 200.0
        message.add(200)
    assert capsys.readouterr().err == "250 of 1,250 points (20 %) after 3.33 min, about 10 s left\n"
