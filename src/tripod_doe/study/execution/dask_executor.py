"""Run blocks of points on Dask workers, and repeat them when a worker or the scheduler is lost.

A block runs again when its scheduler is lost; a worker with another version of the package is retired; a point is given
up after three workers died while it was the only queued block.

Why not Dask's `retries` and `as_completed`: retries are for exceptions, and a scheduler blames every block in the queue
of a worker for its death. as_completed cannot wait for one second at a time, as checks for silent schedulers and new
workers need; 3,000 empty blocks cost 7.7 CPU-s with it and 8.1 to 8.9 here.
"""

import pickle
import queue
import sys
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from dask.typing import Key
from distributed import Client, KilledWorker
from distributed import Future as DaskFuture
from distributed.client import ClosedClientError
from distributed.comm import CommClosedError

from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError
from tripod_doe.study.execution.block_answer import Answer, Lost
from tripod_doe.study.execution.dask_task import Unfit, our_version, read_answer, run_block
from tripod_doe.study.execution.task import Task
from tripod_doe.study.execution.user_code import UserCode

DEATHS = 3
"""Workers that a point may end before it is given up."""

_IN_FLIGHT = 2  # blocks per thread: one at work, one waiting, so that no worker waits for this process
_TOGETHER = 8  # answers fetched at once: a round trip takes longer than an answer
_LOOK = 1.0  # seconds between counts of workers and of free slots
_LOST = "scheduler-connection-lost"  # Dask's reason of a cancellation
_NEWS = (None, "memory", "erred")  # states of a task (none: unknown) that a scheduler reports at once
_ANSWER, _SILENCE = 10.0, 60.0  # seconds for one answer of a scheduler; seconds without any until it counts as lost


@dataclass(eq=False)
class _Block:
    """A submitted block without an answer."""

    # points, task: indices of its points, and the task for a worker
    points: IntArray
    task: Task
    deaths: int = 0  # workers that died while it ran alone


class OnDask:
    """Runs blocks on the workers of a client.

    Args:
        replaced: Gives a new client after the scheduler was lost.
        exclusive: Whether only one block may run at a time.
        code: Code of the user's function, for workers that may not see the study's folder.
    """

    def __init__(
        self,
        client: Client,
        replaced: Callable[[Client], Client],
        exclusive: bool = False,
        code: UserCode | None = None,
    ) -> None:
        self._dask, self._replaced, self._exclusive, self._code = client, replaced, exclusive, code
        self._at_work: dict[DaskFuture, _Block] = {}
        self._suspects: deque[_Block] = deque()
        self._alone: _Block | None = None
        self._finished: queue.SimpleQueue[DaskFuture] = queue.SimpleQueue()
        self._next: deque[DaskFuture] = deque()
        self._fetched: dict[DaskFuture, Any] = {}
        self._threads, self._counted_at, self._heard_at = 0, -np.inf, time.monotonic()
        self._unreported: dict[Key, float] = {}
        self._answered, self._left_out = False, set[str]()

    @property
    def slots(self) -> int:
        """Number of blocks to send ahead; 0 while a point is suspected of ending its worker."""
        if self._suspects or self._alone:
            return 0
        return 1 if self._exclusive else _IN_FLIGHT * max(self._count_threads(), 1)

    def _count_threads(self) -> int:
        """Threads of all workers; the last count if the scheduler does not answer."""
        if time.monotonic() > self._counted_at + _LOOK and self._dask.status == "running":
            with suppress(OSError, CancelledError):  # a timeout is an OSError
                self._threads = sum(self._dask.nthreads(callback_timeout=_ANSWER).values())
                self._heard_at = time.monotonic()
            self._counted_at = time.monotonic()
        return self._threads

    def _is_silent(self) -> bool:
        """Whether a scheduler with an open connection gives no answers, or does not report finished blocks."""
        self._count_threads()
        if self._dask.status != "running":
            return False
        states = {future.key: "processing" for future in self._at_work}
        with suppress(OSError, CancelledError):
            ask = self._dask.scheduler.get_task_status
            states = self._dask.sync(ask, keys=list(states), callback_timeout=_ANSWER)
        now = time.monotonic()
        self._unreported = {key: self._unreported.get(key, now) for key, state in states.items() if state in _NEWS}
        return now > self._heard_at + _SILENCE or now > min(self._unreported.values(), default=now) + _ANSWER

    @property
    def busy(self) -> int:
        """Number of blocks without an answer."""
        return len(self._at_work) + len(self._suspects)

    def submit(self, block: IntArray, task: Task) -> None:
        """Send a block."""
        self._send([_Block(block, task)])

    def _send(self, blocks: list[_Block]) -> None:
        """Send blocks, to the next scheduler if this one is lost."""
        while True:
            try:
                for block in blocks:
                    work = pickle.dumps((block.task, self._code))
                    future = self._dask.submit(run_block, our_version(), work, pure=False)
                    self._at_work[future] = block
                    future.add_done_callback(self._finished.put)
            except (ClosedClientError, CommClosedError):
                blocks = self._taken_back(blocks)
            else:
                return

    def _taken_back(self, blocks: list[_Block], gone: bool = True) -> list[_Block]:
        """All blocks to send again, after the scheduler was replaced or its blocks were cancelled."""
        unsent = [block for block in blocks if block not in self._at_work.values()]
        blocks = [*self._at_work.values(), *unsent]
        self._at_work.clear()
        if gone:  # also where Dask has connected again: the scheduler may drop tasks of that client
            self._dask = self._replaced(self._dask)
        else:
            print("running blocks were cancelled by another program; they are sent again", file=sys.stderr)
        self._counted_at, self._heard_at = -np.inf, time.monotonic()
        return blocks

    def next_finished(self) -> tuple[IntArray, Answer | Lost] | None:
        """Wait for a finished block, and raise the exception of its simulator.

        A block whose scheduler is lost, or whose worker cannot run the study, is sent again. A block whose worker died
        is sent again alone, so that no other block can be the cause. None if no block finishes within a second, so that
        the caller can count free slots.
        """
        while True:
            if not self._at_work:
                self._alone = self._suspects.popleft()
                self._send([self._alone])
            try:
                future = self._next_future()
            except queue.Empty:
                if self._is_silent():
                    self._send(self._taken_back([]))
                return None
            block = self._at_work.pop(future, None)
            if block is None:  # from a lost scheduler
                continue
            answer = self._answer(future, block)
            if answer is not None:
                self._alone = None
                return block.points, answer

    def _next_future(self) -> DaskFuture:
        """The next finished block; answers of several are fetched at once. Raises `queue.Empty` without any."""
        if self._next:
            return self._next.popleft()
        finished = [self._finished.get(timeout=_LOOK)]
        while len(finished) < _TOGETHER and not self._finished.empty():
            finished.append(self._finished.get())
        good = [future for future in finished if future in self._at_work and future.status == "finished"]
        with suppress(Exception):  # `_answer` asks for each missing one again
            gather = partial(self._dask.gather, good, asynchronous=True)
            self._fetched = dict(zip(good, self._dask.sync(gather, callback_timeout=_ANSWER), strict=True))
        self._next.extend(finished)
        return self._next.popleft()

    def _answer(self, future: DaskFuture, block: _Block) -> Answer | Lost | None:
        """The answer of a block; None if it runs again."""
        try:
            given = self._fetched.pop(future, None)
            answer = read_answer(future.result(timeout=_SILENCE) if given is None else given)
        except KilledWorker as error:
            return self._judge(block, error.allowed_failures + 1)
        except (CancelledError, CommClosedError, TimeoutError) as error:
            from_outside = getattr(error, "reason", _LOST) != _LOST and self._dask.status == "running"
            self._send(self._taken_back([block], gone=not from_outside))
            return None
        if isinstance(answer, Unfit):
            self._leave_out(answer)
            self._send([block])
            return None
        self._answered = True
        return answer

    def _judge(self, block: _Block, died: int) -> Lost | None:
        """Give up a point that ended enough workers while alone; let it run alone before; halve a block of several."""
        if self._alone is block:
            self._alone = None
            block.deaths += died
        if block.deaths >= DEATHS or block.points.size > 1:
            return Lost(f"{block.deaths} worker processes died on this point")
        self._suspects.append(block)
        return None

    def _leave_out(self, unfit: Unfit) -> None:
        """Retire a worker that cannot run the study.

        Raises:
            InputError: If it is the only worker, and no worker has given an answer.
        """
        if not self._answered and set(self._dask.nthreads()) <= {unfit.address}:
            raise InputError(f"worker {unfit.name}: {unfit.reason}")
        if unfit.name not in self._left_out:  # its supervisor may restart it again and again
            print(f"worker {unfit.name} at {unfit.address} is left out: {unfit.reason}", file=sys.stderr)
            self._left_out.add(unfit.name)
        with suppress(OSError):
            self._dask.retire_workers([unfit.address])

    def close(self) -> None:
        """Cancel the blocks that are not finished."""
        if self._at_work and self._dask.status == "running":
            self._dask.cancel(list(self._at_work))
