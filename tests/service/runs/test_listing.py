"""The list of runs: what passes a filter, in which order, on which page."""

from __future__ import annotations

from tripod_doe.service.runs.listing import (
    PAGE,
    RunFilter,
    folders_of,
    names_of,
    page_count,
    page_of,
    short_ids,
    tags_of,
)
from tripod_doe.service.runs.run_table import PointCounts, Run, State


def run(number, name, **values):
    day = f"2026-{number % 12 + 1:02}-15T10:00:00.000Z"
    return Run(f"{number:016x}", "study", name, "", State.FINISHED, created=day, updated=day, **values)


RUNS = [
    run(1, "Thrust map", plan={"factors": ["joint_angle_deg"]}, tags=("audi",), counts=PointCounts(5)),
    run(2, "Skew", label="customer/joint-7", note="Checked by Ada", counts=PointCounts(50)),
    run(3, "Thrust map", label="customer/old/joint-6", tags=("audi", "old"), counts=PointCounts(9)),
    run(4, "Thrust map", tags=("old",), counts=PointCounts(1)),
]


def ids(**asked):
    return [int(each.id, 16) for each in RunFilter(**asked).select(RUNS)]


def test_every_word_must_stand_in_a_text_of_the_run():
    assert ids(text="thrust MAP") == [4, 3, 1]
    assert ids(text="thrust joint_angle") == [1]
    assert ids(text="ada") == [2]
    assert ids(text="thrust nothing") == []


def test_tags_states_folders_and_days():
    assert ids(tags=("audi",)) == [3, 1]
    assert ids(tags=("audi", "old")) == [3]
    assert ids(states=("failed",)) == []
    assert ids(states=("failed", "finished")) == [4, 3, 2, 1]
    assert ids(folder="customer") == [3, 2]
    assert ids(folder="customer/old/") == [3]
    assert ids(folder="cust") == []
    assert ids(since="2026-03-15T00:00:00.000Z", until="2026-04-15T10:00:00.000Z") == [3, 2]
    assert ids(since="2026-03-15T10:00:00.001Z", until="2026-04-15T10:00:00.001Z") == [3]


def test_orders():
    assert ids(sort="oldest") == [1, 2, 3, 4]
    assert ids(sort="points") == [2, 3, 1, 4]
    assert ids(sort="name") == [2, 3, 1, 4]


def test_pages_hold_all_runs_once():
    many = [run(number, "one") for number in range(2 * PAGE + 1)]
    assert page_count(many) == 3
    assert [each for page in (1, 2, 3) for each in page_of(many, page)] == many
    assert page_of(many, 4) == []
    assert page_count([]) == 1


def test_what_there_is_to_choose_from():
    assert tags_of(RUNS) == ["audi", "old"]
    assert folders_of(RUNS) == ["customer", "customer/old"]
    assert set(short_ids(RUNS)) == {RUNS[0].id, RUNS[3].id}  # of equal names
    assert list(names_of(RUNS).values())[1:] == ["customer/joint-7", "customer/old/joint-6", "Thrust map (000000)"]
    for name in ("../../etc", "/etc", "a//b", "N/ /mm"):  # of a study: a label of this kind is refused
        assert folders_of([run(5, name)]) == []
