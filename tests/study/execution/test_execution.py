"""Where points run: here, or on workers that start while this process goes on; never does it change what they give."""

from __future__ import annotations

import sys
import threading

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from stand_in_workers import OtherProcess, SlowStart
from tripod_doe.study.cube.dataset import build_cube
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.execution import dask_workers, execution
from tripod_doe.study.execution.block_queue import BlockQueue
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler
from tripod_doe.study.execution.execution import Execution
from tripod_doe.study.study_points import StudyPoints

STUDY = """
[study]
name = "plates"
scene = "needle-between-plates"
[base]
duration_s = 0.001
[factors.friction_a]
low = 0.01
high = 0.05
count = 12
[run]
block = 2
"""


@pytest.fixture
def workers(monkeypatch):
    monkeypatch.setattr(dask_workers, "DaskWorkers", SlowStart)
    monkeypatch.setattr(SlowStart, "started", 0)
    return SlowStart


def asked(text=STUDY):
    study = parse_study(text)
    return StudyPoints(study, make_points(study))


def computed(points, **options):
    """The cube, and which process computed each block."""
    with Execution(**options) as place:
        blocks = list(place.run(points, points.without([])))
    cube, _ = build_cube(points.study, points.points, points.keys, iter(blocks))
    return cube, [block.worker for block in blocks]


@pytest.mark.parametrize("options", [{}, {"workers": 1}])
def test_a_function_of_a_script_is_refused_where_workers_would_run_it(workers, monkeypatch, options):
    """Regression: workers started, and said that it is not there; a name of their own was proposed."""
    monkeypatch.setattr(sys.modules["__main__"], "doubled", lambda x: {"y": 2 * x}, raising=False)
    points = asked('[study]\nname = "s"\nfunction = "__main__:doubled"\n[factors.x]\nvalues = [1, 2]\n')
    with pytest.raises(td.InputError, match=r"no function of a script or notebook: give workers=0"):
        computed(points, **options)
    assert workers.started == 0
    assert computed(points, workers=0)[0]["y"].values.tolist() == [2, 4]


def test_a_small_study_starts_no_workers(workers):
    assert set(computed(asked())[1]) == {"main process"}
    assert workers.started == 0


def test_a_longer_study_goes_on_here_until_its_workers_have_started(workers, monkeypatch):
    alone, _ = computed(asked(), workers=0)
    monkeypatch.setattr(execution, "_WORTH_WORKERS", 0.0)
    cube, places = computed(asked())
    assert places == ["main process"] * 2 + ["worker"] * 4
    assert workers.started == 1
    xr.testing.assert_identical(cube, alone)


def test_a_long_first_block_does_not_keep_the_others_waiting(workers, monkeypatch):
    """It is finished here while workers run the rest, and comes last."""
    points, kind = asked(), type(asked().study.simulator)
    alone, _ = computed(points, workers=0)
    simulate, others_done, calls = kind.simulate, threading.Event(), []

    def first_waits_for_the_others(self, columns, keep):
        calls.append(1)
        if len(calls) == 1:
            assert others_done.wait(60)
        elif len(calls) == 6:
            others_done.set()
        return simulate(self, columns, keep)

    monkeypatch.setattr(kind, "simulate", first_waits_for_the_others)
    monkeypatch.setattr(execution, "_PATIENCE", 0.01)
    monkeypatch.setattr(execution, "_WORTH_WORKERS", 0.05)
    cube, places = computed(points)
    assert places == ["worker"] * 5 + ["main process"]
    xr.testing.assert_identical(cube, alone)


@pytest.mark.parametrize(
    ("text", "options", "place"),
    [
        (STUDY, {"workers": 0}, "main process"),
        (STUDY + "exclusive = true\n", {}, "main process"),  # one block at a time: workers would not help
        (STUDY, {"workers": 1}, "worker"),
        (STUDY, {"scheduler": ExistingScheduler("tcp://somewhere:1")}, "worker"),
    ],
)
def test_who_asks_for_a_place_gets_it(workers, monkeypatch, text, options, place):
    monkeypatch.setattr(execution, "_WORTH_WORKERS", 0.0)
    assert set(computed(asked(text), **options)[1]) == {place}


def test_a_function_may_crash_so_it_runs_in_worker_processes(workers, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "any_function.py").write_text("def f(x):\n    return {'y': x}\n")
    text = '[study]\nname="f"\nfunction="any_function:f"\n[factors.x]\nvalues=[1, 2]\n'
    assert set(computed(asked(text))[1]) == {"worker"}
    assert set(computed(asked(text), workers=0)[1]) == {"main process"}


def test_kernels_are_prepared_once_before_the_workers_start(workers, monkeypatch):
    """One process imports and compiles; the workers start with what it imported."""
    points, events = asked(), []
    kind = type(points.study.simulator)
    prepare = kind.prepare
    monkeypatch.setattr(SlowStart, "start", lambda self, study: events.append("start"))
    monkeypatch.setattr(SlowStart, "executor", lambda self, study: events.append("wait") or OtherProcess())
    monkeypatch.setattr(kind, "prepare", lambda self, columns: events.append("prepare") or prepare(self, columns))
    computed(points, workers=2)
    assert events[:3] == ["prepare", "start", "wait"]


def test_places_that_cannot_be_used_are_refused():
    with pytest.raises(td.InputError, match=r"workers=-1: must be 0 \(this process\) or more"):
        Execution(-1)
    with pytest.raises(td.InputError, match="leave out scheduler='tcp://somewhere:1'"):
        Execution(0, ExistingScheduler("tcp://somewhere:1"))


def test_no_more_workers_start_than_there_are_processors(workers, monkeypatch, capsys):
    """Unless that is asked for by a second argument."""
    monkeypatch.setattr(execution.os, "sched_getaffinity", lambda process: {0, 1, 2})
    counts = []
    monkeypatch.setattr(SlowStart, "start", lambda self, study: counts.append(self.count))
    for options in ({"workers": 1000}, {"workers": 2}, {"workers": 1000, "oversubscribe": True}):
        computed(asked(), **options)
    assert counts == [3, 2, 1000]
    assert capsys.readouterr().err == (
        "workers=1000: this machine has 3 processors, so 3 workers start; oversubscribe=True starts all\n"
    )


def test_what_a_simulator_raises_reaches_the_caller(monkeypatch):
    points = asked()

    def broken(self, columns, keep):
        raise MemoryError("no room")

    monkeypatch.setattr(type(points.study.simulator), "simulate", broken)
    with pytest.raises(MemoryError, match="no room"):
        computed(points, workers=0)


def test_blocks_grow_towards_a_second_and_shrink_at_the_end():
    queue = BlockQueue(np.arange(1000))
    assert queue.take(4).tolist() == [0]
    queue.learn(0.001, np.arange(1))
    assert queue.seconds_left == 0  # one point of a millisecond is no measure of the others
    assert queue.take(4).size == 32
    queue.learn(0.32, np.arange(32))
    assert queue.seconds_left == pytest.approx(9.67)
    sizes = []
    while (block := queue.take(4)) is not None:
        sizes.append(block.size)
    assert sizes[0] == 100
    assert sizes[-1] < 10
    assert sum(sizes) == 967


def test_blocks_on_a_cluster_last_longer_and_none_has_large_results():
    queue = BlockQueue(np.arange(100_000), seconds=5.0)
    queue.take(1)
    queue.learn(0.5, np.arange(100))
    assert queue.take(1).size == 1000
    queue.learn(0.5, np.arange(100), size=100 * 64_000)
    assert queue.take(1).size == 500
    queue.learn(2.001, np.arange(1))
    assert queue.take(1).size == 3  # two would be 4 s


@pytest.mark.parametrize("seed", range(20))
def test_a_block_holds_points_of_one_kind_and_each_point_once(seed):
    """Invariance: of any order of kinds and points, all are taken once, and the size of a kind's blocks is its own."""
    random = np.random.default_rng(seed)
    waiting = np.flatnonzero(random.random(400) < 0.7)
    kinds = random.integers(0, random.integers(1, 6), waiting.size)
    of, queue = dict(zip(waiting.tolist(), kinds.tolist(), strict=True)), BlockQueue(waiting, kinds=kinds)
    taken, price = [], {kind: 10.0 ** -random.integers(0, 4) for kind in range(6)}
    while (block := queue.take(2)) is not None:
        own = {of[point] for point in block.tolist()}
        assert len(own) == 1
        assert block.size == 1 or block.size * price[own.pop()] <= 1.001
        taken += block.tolist()
        queue.learn(block.size * price[of[block[0]]], block)
    assert sorted(taken) == waiting.tolist()
    assert len(queue) == 0


def test_a_block_that_comes_back_is_run_in_halves():
    queue = BlockQueue(np.arange(5), block=5)
    queue.halve(queue.take(1))
    assert len(queue) == 5
    halves = [queue.take(1).tolist(), queue.take(1).tolist()]
    assert sorted(halves) == [[0, 1, 2], [3, 4]]
    assert queue.take(1) is None
