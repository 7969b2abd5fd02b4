"""Plans: counts that are right, prices that are near."""

from __future__ import annotations

from dataclasses import replace
from threading import Timer

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.joint.models.candidates import JOINT_CANDIDATES
from tripod_doe.joint.outputs import CYCLE_OUTPUTS, VIBRATION_THIRD
from tripod_doe.study import plan as plan_module
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution import timing
from tripod_doe.study.execution.task import make_task, run_task
from tripod_doe.study.fingerprints import point_keys
from tripod_doe.study.journal import FinishedBlock

OF_BALANCES = {*CYCLE_OUTPUTS, VIBRATION_THIRD}

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


def test_the_memory_of_a_long_list_is_told():
    """Exact: 40 bytes a point, and 64 for a value of a latin hypercube."""
    held = td.plan(parse_study(TEXT.replace("sobol", "latin-hypercube")), timing=False)
    assert held.memory_bytes == 2000 * (40 + 64)
    assert "memory" not in held.describe()
    long = replace(held, points=2_000_000, memory_bytes=208_000_000)
    assert "memory       208 MB for the list of points\n" in long.describe()


def test_counts_and_bytes():
    plan = td.plan(parse_study(TEXT), timing=False)
    assert plan.points == plan.unique == 2000
    assert plan.cube_bytes == 2000 * (13 * 8 + 1)
    assert plan.cpu_hours is None


NINE = {"needle_count": 9, "needle_diameter_mm": 5.89, "spheres_per_needle": 3, "relative_tolerance": 0.02}
SMALL = {
    "joint": {"model": "needles", "samples_per_revolution": 30, "cycles": 2, **NINE},
    "needle-between-plates": {"duration_s": 1e-3},
    "roller-in-groove": {"duration_s": 1e-3},
    "trunnion": {"cycles": 2, **NINE},
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_planned_bytes_are_those_of_the_cube(scene):
    """Exact: whatever becomes of a point, its cube holds every output at the length that the plan counts."""
    outputs = [name for name in load_simulator(scene).outputs if name not in OF_BALANCES]
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


@pytest.mark.parametrize(
    "change",
    [
        ("", ""),
        ('kind = "sobol"', 'kind = "saltelli"'),
        ('high = 14}\n[design]\nkind = "sobol"\nsamples = 2000', 'high = 14, count = 8}\n[design]\nkind = "grid"'),
        ("[keep]", '[run]\nretry = ["smaller-step"]\n[keep]'),
    ],
)
def test_planned_bytes_of_cube_and_costs_are_those_of_their_variables(change):
    """Exact: texts by the numbers that stand for them in large cubes; what has one value a level or label left out."""
    study = parse_study(TEXT.replace(*change).replace("2000", "8"))
    points = make_points(study)
    keys = point_keys(study, points)
    block = FinishedBlock(keys, *run_task(make_task(study, points, np.arange(points.count))), "")
    cube, cost = build_cube(study, points, keys, iter([block]))
    cube = cube.drop_vars([name for name in cube.data_vars if name.endswith("_used")])
    if points.is_grid:
        cube, cost = cube.drop_vars(points.dims), cost.drop_vars(points.dims)
    along = [variable for part in (cube, cost) for variable in part.variables.values() if variable.dims != ("order",)]
    written = sum(variable.size * (4 if variable.dtype == object else variable.dtype.itemsize) for variable in along)
    assert td.plan(study, timing=False).written_bytes == written


def test_price_is_the_mean_of_the_timed_points_with_their_quartiles(monkeypatch):
    """Exact: 2000 points; the clock is the test's."""
    monkeypatch.setattr(plan_module, "time_points", lambda study, seconds: [1.8, 3.6, 5.4, 7.2, 0.0])
    plan = td.plan(parse_study(TEXT))
    assert plan.cpu_hours == pytest.approx((1.0, 2.0, 3.0))
    assert plan.blocks == 2000  # a block holds a point at least
    assert plan.timed == 5


@pytest.mark.parametrize(
    ("samples", "blocks"),
    [
        pytest.param(2000, 11 * [100], id="batches of a fifth of a second"),
        pytest.param(8, 3 * [8], id="three times all"),
    ],
)
def test_points_are_timed_in_batches_of_a_fifth_of_a_second(samples, blocks, monkeypatch):
    """Exact, with a worker that takes 2 ms per point, 1 s for its first call."""
    calls = []

    def run(task):
        calls.append(task.count)
        return None, 1.0 if len(calls) == 1 else 0.002 * task.count, 0.0

    monkeypatch.setattr(timing, "run_task", run)
    seconds = list(timing.timings(parse_study(TEXT.replace("2000", str(samples)))))
    assert seconds == pytest.approx([1.0, *[0.002] * len(blocks)])
    assert calls == [1, 1, *blocks]


def test_repeated_points_are_computed_once():
    text = TEXT.replace('kind = "sobol"\nsamples = 2000', 'kind = "zip"').replace(
        "low = 4, high = 14", "values = [5, 5, 6]"
    )
    plan = td.plan(parse_study(text), timing=False)
    assert (plan.points, plan.unique) == (3, 2)
    assert "repeated" in plan.describe()


SECOND_CALL_HANGS = """
import time
calls = []
def f(x):
    calls.append(x)
    time.sleep(36000 if len(calls) > 1 else 0)
    return {"y": x}
"""


def test_the_first_call_counts_where_no_other_ends_in_time(tmp_path, monkeypatch):
    """Regression: `needles`, of which one run ends within the limit and a second does not, had the recorded price."""
    monkeypatch.setattr(plan_module, "_TIMING_SECONDS", 10.0)
    (tmp_path / "hangs.py").write_text(SECOND_CALL_HANGS)
    text = '[study]\nname="e"\nfunction="hangs:f"\n[factors.x]\nvalues=[1, 2]\n'
    plan = td.plan(parse_study(text, folder=StudyFolder(tmp_path)))
    assert plan.timed == 1
    assert plan.cpu_hours[1] < 1


def test_timing_stops_a_point_that_would_take_hours(tmp_path, monkeypatch):
    monkeypatch.setattr(plan_module, "_TIMING_SECONDS", 1.0)
    (tmp_path / "endless.py").write_text("import time\ndef f(x):\n    time.sleep(36000)\n    return {'y': x}\n")
    plan = td.plan(
        parse_study(
            '[study]\nname="e"\nfunction="endless:f"\n[factors.x]\nvalues=[1, 2]\n', folder=StudyFolder(tmp_path)
        )
    )
    assert plan.timed == 0
    assert plan.cpu_hours is None
    assert "nothing was timed" in plan.describe()


@pytest.mark.slow
def test_points_are_timed_in_a_process_of_their_own_when_it_is_ready(tmp_path, monkeypatch):
    """An import stands for kernels that are compiled: the time for timing starts when it is done."""
    monkeypatch.setattr(plan_module, "_TIMING_SECONDS", 600.0)  # however slow the machine is
    seen = []

    class Watched(Timer):
        def start(self):
            seen.append(len(list(tmp_path.glob("imported-*"))))

    monkeypatch.setattr(timing, "Timer", Watched)
    mark = f"import os, pathlib\npathlib.Path({str(tmp_path)!r}, f'imported-{{os.getpid()}}').touch()\n"
    (tmp_path / "marked.py").write_text(mark + "def f(x):\n    return {'y': x}\n")
    text = '[study]\nname="s"\nfunction="marked:f"\n[factors.x]\nlow=0\nhigh=1\ncount=1000\n'
    plan = td.plan(parse_study(text, folder=StudyFolder(tmp_path)))
    assert plan.timed > 0
    assert plan.cpu_hours[0] > 0
    assert seen == [2]  # by this process and by the one that times


JAMMED = """
[study]
name = "jam"
[base]
needle_count = 30
[factors]
joint_angle_deg = {low = 3, high = 27, count = 5}
torque_n_m = {values = [-180, 35, 420]}
"""


def test_a_study_whose_points_cannot_fit_is_told_before_anything_runs(monkeypatch):
    monkeypatch.setattr(plan_module, "time_points", lambda study, seconds: pytest.fail("nothing is left to time"))
    plan = td.plan(parse_study(JAMMED))
    assert (plan.unique, plan.able) == (15, 0)
    assert "jammed       15 of 15: the needles do not fit on the pitch circle: reduce needle_count" in plan.describe()
    assert "price        none: no point can be run" in plan.describe()


def test_the_price_leaves_out_points_that_are_known_to_fail(monkeypatch):
    """Exact: of 3 needle counts on 5 angles one fits; the clock is the test's."""
    monkeypatch.setattr(plan_module, "time_points", lambda study, seconds: [3600.0])
    text = JAMMED.replace("[base]\nneedle_count = 30", "").replace(
        "torque_n_m = {values = [-180, 35, 420]}", "needle_count = {values = [27, 28, 29]}"
    )
    plan = td.plan(parse_study(text))
    assert plan.able == 5
    assert plan.cpu_hours == pytest.approx((5, 5, 5))


def test_the_price_lies_within_its_spread_also_where_few_points_are_dear(monkeypatch):
    monkeypatch.setattr(plan_module, "time_points", lambda study, seconds: [1.0] * 9 + [991.0])
    low, middle, high = td.plan(parse_study(TEXT)).cpu_hours
    assert low <= middle <= high
    assert middle == pytest.approx(2000 * 100 / 3600)


@pytest.mark.parametrize("scene", ["joint", "trunnion"])
def test_points_at_rest_are_foreseen(scene):
    text = f'[study]\nname = "rest"\nscene = "{scene}"\n[factors]\nspeed_rpm = {{values = [0, 600]}}\n'
    plan = td.plan(parse_study(text), timing=False)
    assert [(failure.outcome.label, failure.count) for failure in plan.foreseen] == [("out_of_range", 1)]


def test_a_price_that_cannot_be_timed_in_time_is_the_recorded_one(monkeypatch):
    """Exact: the recorded price of the candidate with the same model and the nearest numerics."""
    monkeypatch.setattr(plan_module, "time_points", lambda study, seconds: [])
    for accuracy in (0.02, 0.0025):
        text = f'[study]\nname = "n"\n[base]\nmodel = "needles"\naccuracy = {accuracy}\n'
        plan = td.plan(parse_study(text + "[factors.joint_angle_deg]\nvalues = [5, 21]\n"))
        price = next(c.price for c in JOINT_CANDIDATES if c.full and c.values["accuracy"] == accuracy)
        assert plan.cpu_hours == pytest.approx((2 * price / 3600,) * 3)
        assert "recorded on another machine" in plan.describe()


@pytest.mark.parametrize("value", [1, 4])
def test_wall_time_counts_the_workers(value):
    plan = td.Plan(
        points=10,
        unique=10,
        excluded=0,
        blocks=3,
        cpu_hours=(0.5, 1.0, 2.0),
        cube_bytes=100,
        timed=5,
        chosen=False,
        warnings=("careful",),
    )
    assert f"on {value} workers" in plan.describe(value)
    assert "careful" in plan.describe(value)


def test_a_straight_joint_is_in_the_range_of_every_model():
    """Exact: its thrust is zero. Regression: "the thrust is a small difference of large forces", at infinite ratios."""
    plan = td.plan(parse_study('[study]\nname = "w"\n[factors]\njoint_angle_deg = {values = [0, 10]}\n'), timing=False)
    assert not plan.warnings


def test_a_plan_warns_of_points_outside_the_range_of_their_model():
    text = (
        '[study]\nname = "w"\n[base]\nmodel = "equilibrium"\n[factors]\njoint_angle_deg = {values = [1, 2, 10, 12]}\n'
    )
    plan = td.plan(parse_study(text), timing=False)
    (message,) = [text for text in plan.warnings if "swing_ratio" in text]
    outside = "Model equilibrium is outside its valid range at 2 of 4 points (50 %): swing_ratio (swing of"
    assert message.startswith(outside)
    slip = [21 * np.tan(theta) * np.sin(theta) / 2 for theta in np.radians([2, 1])]
    low, high = (2 * 0.05 * 0.0086 * 16 / each for each in slip)  # docs/reference/models.md
    assert f" = {low:.2g} to {high:.2g}, valid up to 0.05; beyond, rollers swing" in message
    assert "model        equilibrium: typical error of the third order" in plan.describe()


@pytest.mark.slow
def test_a_plan_of_very_many_points_judges_a_sample(monkeypatch):
    """Exact counts of points and bytes; failures by a sample, within 10 % of their number. 90 million took 38 min."""
    text = (
        '[study]\nname = "m"\n[base]\nmodel = "equilibrium"\n[factors]\nroller_radius_mm = {values = [16, 28]}\n'
        "torque_n_m = {low = 20, high = 100, count = 4000}\n[keep]\noutputs = ['thrust_rms']\n"
    )
    whole = td.plan(parse_study(text), timing=False)
    monkeypatch.setattr(plan_module, "_MOST_CHECKED", 1000)
    sampled = td.plan(parse_study(text), timing=False)
    assert (sampled.points, sampled.unique, sampled.cube_bytes) == (whole.points, whole.unique, whole.cube_bytes)
    assert whole.foreseen[0].count == 4000
    assert sampled.foreseen[0].count == pytest.approx(4000, rel=0.1)
    assert any("drawn at random" in note for note in sampled.design)
    assert not any("drawn at random" in note for note in whole.design)


def test_a_plan_names_outputs_that_its_model_does_not_compute():
    """Regression: a kept thrust_amplitude_error was silently missing from the cube of kinetostatic."""
    text = '[study]\nname = "w"\n[factors]\njoint_angle_deg = {values = [4, 8]}\n[keep]\noutputs = ["thrust_amplitude_error"]\n'
    assert "thrust_amplitude_error: not computed by kinetostatic" in td.plan(parse_study(text), timing=False).warnings
