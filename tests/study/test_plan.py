"""Plans: counts that are right, prices that are near."""

from __future__ import annotations

import time

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.study.cube import build_cube
from tripod_doe.study.definition import parse_study
from tripod_doe.study.designs import make_points, point_keys
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.scenes import SCENES, load_simulator
from tripod_doe.study.task import make_task, run_task

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


NINE = {"needle_count": 9, "needle_diameter_mm": 5.89, "spheres_per_needle": 3, "relative_tolerance": 0.02}
SMALL = {
    "joint": {"model": "needles", "samples_per_revolution": 30, "cycles": 3, **NINE},
    "needle-between-plates": {"duration_s": 1e-3},
    "roller-in-groove": {"duration_s": 1e-3},
    "trunnion": {"cycles": 2, **NINE},
}


@pytest.mark.parametrize("scene", SCENES)
def test_planned_bytes_are_those_of_the_cube(scene):
    """Exact: whatever becomes of a point, its cube holds every output at the length that the plan counts."""
    outputs = list(load_simulator(scene).outputs)
    base = "\n".join(f"{name} = {value!r}" for name, value in SMALL[scene].items())
    study = parse_study(
        f'[study]\nname = "b"\nscene = "{scene}"\n[base]\n{base}\n[keep]\noutputs = {outputs}\n[factors.replicate]\nvalues = [0]\n'
    )
    points = make_points(study)
    keys = point_keys(study, points)
    block = FinishedBlock(keys, *run_task(make_task(study, points, np.arange(1))), "")
    cube, _ = build_cube(study, points, keys, iter([block]))
    assert set(outputs) <= set(cube.data_vars)
    planned = td.plan(study, timing=False).cube_bytes
    assert planned == sum(cube[name].nbytes for name in [*outputs, "outcome"])
    for name in outputs:
        declared = study.simulator.outputs[name].shape(study.simulator.effective(study.base))
        assert cube[name].shape == (1, *declared), name


def test_a_length_that_a_factor_sets_is_counted():
    study = parse_study(
        '[study]\nname = "b"\n[design]\nkind = "zip"\n[keep]\noutputs = ["needle_skew_summary_deg"]\n'
        "[factors]\njoint_angle_deg = {values = [5, 6]}\ncycles = {values = [7, 7]}\n"
    )
    assert td.plan(study, timing=False).cube_bytes == 2 * (3 * 7 * 3 * 8 + 1)


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
