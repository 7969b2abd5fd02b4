"""The time that is counted as the cost of points: all that their thread spends on them, compilation left out."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


class _LeftOut(threading.local):
    """Seconds of a thread that are not counted so far."""

    cpu = 0.0
    wall = 0.0


_left_out = _LeftOut()


def counted_time() -> tuple[float, float]:
    """CPU and wall seconds of this thread, of which only differences count; it stands still in `not_counted`."""
    return time.thread_time() - _left_out.cpu, time.perf_counter() - _left_out.wall


@contextmanager
def not_counted() -> Iterator[None]:
    """Leave out the time that the block takes, such a block within it included once."""
    cpu, wall = counted_time()
    try:
        yield
    finally:
        later_cpu, later_wall = counted_time()
        _left_out.cpu += later_cpu - cpu
        _left_out.wall += later_wall - wall
