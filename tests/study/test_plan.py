"""Plans: counts that are right, prices that are near."""

from __future__ import annotations

import time

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.study.definition import parse_study

TEXT = """
[study]
name = "p"
[factors]
joint_angle_deg = {low = 4, high = 14}
[design]
kind = "sobol"
samples = 2000
[keep]
outputs = ["thrust_amplitude"]
"""


def test_counts_and_bytes():
    plan = td.plan(parse_study(TEXT), timing=False)
    assert plan.points == plan.unique == 2000
    assert plan.cube_bytes == 2000 * (13 * 8 + 1)
    assert plan.cpu_hours is None


def test_price_is_that_of_the_work():
    """A factor of 3 on a noisy machine; the price itself is 0.3 s."""
    study = parse_study(TEXT)
    plan = td.plan(study)
    low, mean, high = plan.cpu_hours
    assert low <= mean * 1.5
    assert high >= mean / 1.5
    points = {name: np.full(1000, value) for name, value in study.simulator.effective({}).items() if name != "model"}
    points["model"] = np.full(1000, "equilibrium", object)
    study.simulator.prepare(points)
    start = time.thread_time()
    study.simulator.simulate(points, ["thrust_amplitude"])
    seconds = 2 * (time.thread_time() - start)
    assert seconds / 3 < mean * 3600 < seconds * 3


def test_repeated_points_are_computed_once():
    text = TEXT.replace('kind = "sobol"\nsamples = 2000', 'kind = "zip"').replace(
        "low = 4, high = 14", "values = [5, 5, 6]"
    )
    plan = td.plan(parse_study(text), timing=False)
    assert (plan.points, plan.unique) == (3, 2)
    assert "repeated" in plan.describe()


def test_timing_stops_after_ten_seconds(tmp_path):
    (tmp_path / "endless.py").write_text("import time\ndef f(x):\n    time.sleep(60)\n    return {'y': x}\n")
    text = '[study]\nname="e"\nfunction="endless:f"\n[factors.x]\nvalues=[1, 2]\n'
    start = time.monotonic()
    plan = td.plan(parse_study(text, folder=tmp_path))
    assert time.monotonic() - start < 14
    assert plan.timed == 0
    assert "no point ended" in plan.describe() or "not timed" in plan.describe()


@pytest.mark.parametrize("value", [1, 4])
def test_wall_time_counts_the_workers(value):
    plan = td.Plan(10, 10, 0, 3, (0.5, 1.0, 2.0), 100, 5, False, ("careful",))
    assert f"on {value} workers" in plan.describe(value)
    assert "careful" in plan.describe(value)
