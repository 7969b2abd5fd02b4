"""Time counted as the cost of points: the time of their thread, without compilation."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


class _LeftOut(threading.local):
    """Seconds of a thread that are excluded so far."""

    cpu = 0.0
    wall = 0.0


_left_out = _LeftOut()


def counted_time() -> tuple[float, float]:
    """CPU and wall seconds of this thread; only differences mean anything. The clock stands still in `not_counted`."""
    return time.thread_time() - _left_out.cpu, time.perf_counter() - _left_out.wall


@contextmanager
def not_counted() -> Iterator[None]:
    """Exclude the time of the block; nested blocks are excluded once."""
    cpu, wall = counted_time()
    try:
        yield
    finally:
        later_cpu, later_wall = counted_time()
        _left_out.cpu += later_cpu - cpu
        _left_out.wall += later_wall - wall
