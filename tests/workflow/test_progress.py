"""Progress: a bar on a terminal, a line now and then in a log, nothing where it is not asked for."""

from __future__ import annotations

import pytest

from tripod_doe.workflow import progress
from tripod_doe.workflow.progress import Progress


@pytest.fixture
def clock(monkeypatch):
    passed = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: passed[0])
    return passed


def test_a_log_gets_a_line_now_and_then(clock, capsys):
    with Progress(1000, shown=True) as message:
        for _ in range(1000):
            clock[0] += 1
            message.add(1)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "30 of 1,000 points (3 %) after 30 s, about 16.2 min left"
    assert [line.split(" of ")[0] for line in lines] == ["30", "60", "120", "240", "480", "960"]


def test_waiting_for_the_first_points_does_not_count_as_their_price(clock, capsys):
    with Progress(100, shown=True) as message:
        clock[0] += 200  # kernels are compiled
        message.add(2)
        clock[0] += 200
        message.add(20)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "2 of 100 points (2 %) after 3.33 min",
        "22 of 100 points (22 %) after 6.67 min, about 13 min left",
    ]


def test_short_runs_and_silent_ones_say_nothing(clock, capsys):
    with Progress(10, shown=True) as message:
        clock[0] += 29
        message.add(9)
    with Progress(10, shown=False) as message:
        clock[0] += 1000
        message.add(9)
    assert capsys.readouterr().err == ""


def test_a_terminal_gets_a_bar(monkeypatch, capsys):
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: True, raising=False)
    with Progress(10, shown=True) as message:
        message.add(10)
    assert "10/10" in capsys.readouterr().err
