"""Blocks of points run in this process, one at a time."""

from __future__ import annotations

import queue
import threading

import numpy as np
from numpy.typing import NDArray

from tripod_doe.study.executor import Answer, Lost
from tripod_doe.study.task import Task, run_task

__all__ = ["ThisProcess"]

NAME = "main process"
"""Stands for the worker of points that were computed here."""


class ThisProcess:
    """Runs blocks in a thread of this process.

    The thread that waits for them stays free for interrupts, which Python would otherwise hold back until a compiled
    kernel returns.
    """

    slots = 1

    def __init__(self) -> None:
        self._tasks: queue.SimpleQueue[tuple[NDArray[np.int64], Task] | None] = queue.SimpleQueue()
        self._finished: queue.SimpleQueue[tuple[NDArray[np.int64], Answer | Lost | Exception]] = queue.SimpleQueue()
        threading.Thread(target=self._work, name="points", daemon=True).start()

    def submit(self, block: NDArray[np.int64], task: Task) -> None:
        """Take a block to run."""
        self._tasks.put((block, task))

    def next_finished(self) -> tuple[NDArray[np.int64], Answer | Lost]:
        """Wait for the block at work, and raise what its simulator raised."""
        block, answer = self._finished.get()
        if isinstance(answer, Exception):
            raise answer
        return block, answer

    def close(self) -> None:
        """End the thread, after the block at work if there is one."""
        self._tasks.put(None)

    def _work(self) -> None:
        while (taken := self._tasks.get()) is not None:
            block, task = taken
            self._finished.put((block, _run(task)))


def _run(task: Task) -> Answer | Lost | Exception:
    try:
        return Answer(*run_task(task), NAME)
    except SystemExit as error:
        return Lost(f"the function asked Python to exit ({error.code})")
    except Exception as error:
        return error
