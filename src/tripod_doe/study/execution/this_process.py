"""Blocks of points run in this process, one at a time."""

import queue
import threading
import time

from tripod_doe.array_types import IntArray
from tripod_doe.study.execution.block_answer import Answer, AtWork, Lost
from tripod_doe.study.execution.task import Task, run_task

NAME = "main process"
"""Name of the worker of points that are computed in this process."""


class ThisProcess:
    """Runs blocks in a thread of this process.

    The thread that waits for them stays free for interrupts, which Python would otherwise hold back until a compiled
    kernel returns.

    Args:
        patience: Seconds after which a block is reported as `AtWork`; None waits for its end.
    """

    slots = 1

    def __init__(self, patience: float | None = None) -> None:
        self._patience = patience
        self._block: IntArray | None = None
        self._taken = 0.0
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._finished: queue.SimpleQueue[Answer | Lost | Exception] = queue.SimpleQueue()
        threading.Thread(target=self._work, name="points", daemon=True).start()

    @property
    def busy(self) -> int:
        """Blocks at work."""
        return int(self._block is not None)

    def submit(self, block: IntArray, task: Task) -> None:
        """Take a block to run."""
        self._block, self._taken = block, time.perf_counter()
        self._tasks.put(task)

    def next_finished(self) -> tuple[IntArray, Answer | Lost | AtWork]:
        """Wait for the block at work, for `patience` at most, and raise the exception of its simulator."""
        assert self._block is not None
        block = self._block
        try:
            answer = self._finished.get(timeout=self._patience)
        except queue.Empty:
            return block, AtWork(time.perf_counter() - self._taken)
        self._block = None
        if isinstance(answer, Exception):
            raise answer
        return block, answer

    def close(self) -> None:
        """End the thread, after the block at work if there is one."""
        self._tasks.put(None)

    def _work(self) -> None:
        while (task := self._tasks.get()) is not None:
            self._finished.put(_run(task))


def _run(task: Task) -> Answer | Lost | Exception:
    try:
        return Answer(*run_task(task), NAME)
    except SystemExit as error:
        return Lost(f"the function asked Python to exit ({error.code})")
    except KeyboardInterrupt:  # its own: Python interrupts the main thread alone
        return Lost("the function raised KeyboardInterrupt")
    except Exception as error:
        return error
