"""The time that is counted as the cost of points."""

from __future__ import annotations

import threading
import time

import pytest

from tripod_doe.model_interface import counted_time, not_counted


def work(seconds):
    """Keep the processor busy for so many CPU seconds of this thread."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def leave_out_and_fail():
    with not_counted():
        work(0.2)
        with not_counted():
            work(0.2)
        raise MemoryError


def test_what_is_not_counted_is_left_out_once_however_it_is_nested_and_ends():
    began, raw = counted_time(), (time.thread_time(), time.perf_counter())
    with pytest.raises(MemoryError):
        leave_out_and_fail()
    cpu, wall = (now - then for now, then in zip(counted_time(), began, strict=True))
    assert 0 <= cpu < 0.1
    assert 0 <= wall <= time.perf_counter() - raw[1] - 0.4
    work(0.1)
    assert counted_time()[0] - began[0] >= 0.1


def test_each_thread_has_its_own():
    began = counted_time()[0]

    def other():
        with not_counted():
            work(0.05)

    thread = threading.Thread(target=other)
    thread.start()
    work(0.05)
    thread.join()
    assert counted_time()[0] - began >= 0.05
