"""Blocks of points at work on Dask workers, with what became of each kept here: what dies there is ordinary.

A block that was at work on a lost scheduler runs again, a worker with another version is left out, and a point is only
said to take down its worker after it did so by itself, three times.

Why not Dask's `retries` and `as_completed`: retries are for exceptions, and a scheduler blames every block in the queue
of a worker for its death. as_completed cannot wait for a second only, after which silent schedulers and new workers are
looked for; 3,000 empty blocks cost 7.7 CPU-s with it and 8.1 to 8.9 here, so speed decides nothing.
"""

from __future__ import annotations

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
from tripod_doe.study.execution.dask_task import Unfit, our_version, read_answer, run_block
from tripod_doe.study.execution.executor import Answer, Lost
from tripod_doe.study.execution.task import Task
from tripod_doe.study.execution.user_code import UserCode

DEATHS = 3
"""Workers that a point takes down by itself before it is given up."""

_IN_FLIGHT = 2  # blocks per thread: one at work, one waiting, so that no worker waits for this process
_TOGETHER = 8  # answers that are fetched at once: the way there and back takes longer than to send one
_LOOK = 1.0  # seconds after which workers are counted again, and room for more blocks is noticed
_LOST = "scheduler-connection-lost"  # Dask's reason of a cancellation
_NEWS = (None, "memory", "erred")  # states of a task (none: unknown) of which a scheduler tells at once
_ANSWER, _SILENCE = 10.0, 60.0  # seconds for one answer of a scheduler, and without any until it counts as gone


@dataclass(eq=False)
class _Block:
    """A block that was taken, until there is an answer."""

    # points, task: indices of its points, and what a worker needs
    points: IntArray
    task: Task
    deaths: int = 0  # workers that died while it was the only block at work


class OnDask:
    """Runs blocks on the workers of a client.

    Parameters
    ----------
    client
        Of their scheduler.
    replaced
        Gives a client in place of one whose scheduler is gone.
    exclusive
        Whether a block must have no neighbours.
    code
        Of the user's function, for workers that may not see the study's folder.
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
        self._untold: dict[Key, float] = {}
        self._answered, self._left_out = False, set[str]()

    @property
    def slots(self) -> int:
        """Blocks sent before the first one is finished; none while a point is suspected to take down its worker."""
        if self._suspects or self._alone:
            return 0
        return 1 if self._exclusive else _IN_FLIGHT * max(self._count_threads(), 1)

    def _count_threads(self) -> int:
        """Threads of all workers, as they join and leave; those of the last count where the scheduler is silent."""
        if time.monotonic() > self._counted_at + _LOOK and self._dask.status == "running":
            with suppress(OSError, CancelledError):  # a timeout is an OSError
                self._threads = sum(self._dask.nthreads(callback_timeout=_ANSWER).values())
                self._heard_at = time.monotonic()
            self._counted_at = time.monotonic()
        return self._threads

    def _is_silent(self) -> bool:
        """Whether a scheduler gives no answers, or no news of blocks, over a connection that nobody has closed."""
        self._count_threads()
        if self._dask.status != "running":
            return False
        states = {future.key: "processing" for future in self._at_work}
        with suppress(OSError, CancelledError):
            ask = self._dask.scheduler.get_task_status
            states = self._dask.sync(ask, keys=list(states), callback_timeout=_ANSWER)
        now = time.monotonic()
        self._untold = {key: self._untold.get(key, now) for key, state in states.items() if state in _NEWS}
        return now > self._heard_at + _SILENCE or now > min(self._untold.values(), default=now) + _ANSWER

    @property
    def busy(self) -> int:
        """Blocks that were taken and have no answer."""
        return len(self._at_work) + len(self._suspects)

    def submit(self, block: IntArray, task: Task) -> None:
        """Send a block."""
        self._send([_Block(block, task)])

    def _send(self, blocks: list[_Block]) -> None:
        """Send blocks, to the next scheduler where this one is gone."""
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
        """All blocks that were at work on a scheduler and are to be sent to the one that takes its place."""
        unsent = [block for block in blocks if block not in self._at_work.values()]
        blocks = [*self._at_work.values(), *unsent]
        self._at_work.clear()
        if gone:  # also where Dask has connected again: the scheduler may still forget what that client sends
            self._dask = self._replaced(self._dask)
        else:
            print("somebody has cancelled the blocks at work; they are sent again", file=sys.stderr)
        self._counted_at, self._heard_at = -np.inf, time.monotonic()
        return blocks

    def next_finished(self) -> tuple[IntArray, Answer | Lost] | None:
        """Wait for one of the blocks that were sent, and raise what its simulator raised.

        A block whose scheduler was lost, or whose worker cannot run the study, is sent again. One whose workers died
        is sent again by itself, with nothing behind it that could be blamed for it. None where nothing is finished for
        a second: there may be room for more blocks by now.
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
            if block is None:  # of a scheduler that is gone
                continue
            answer = self._answer(future, block)
            if answer is not None:
                self._alone = None
                return block.points, answer

    def _next_future(self) -> DaskFuture:
        """The next finished block, whose answer is fetched with those of others; `queue.Empty` where none is."""
        if self._next:
            return self._next.popleft()
        found = [self._finished.get(timeout=_LOOK)]
        while len(found) < _TOGETHER and not self._finished.empty():
            found.append(self._finished.get())
        good = [future for future in found if future in self._at_work and future.status == "finished"]
        with suppress(Exception):  # `_answer` asks for each that is not there, and judges
            gather = partial(self._dask.gather, good, asynchronous=True)
            self._fetched = dict(zip(good, self._dask.sync(gather, callback_timeout=_ANSWER), strict=True))
        self._next.extend(found)
        return self._next.popleft()

    def _answer(self, future: DaskFuture, block: _Block) -> Answer | Lost | None:
        """What a block gave; None where it runs again."""
        try:
            given = self._fetched.pop(future, None)
            answer = read_answer(future.result(timeout=_SILENCE) if given is None else given)
        except KilledWorker as error:
            return self._judge(block, error.allowed_failures + 1)
        except (CancelledError, CommClosedError, TimeoutError) as error:
            by_somebody = getattr(error, "reason", _LOST) != _LOST and self._dask.status == "running"
            self._send(self._taken_back([block], gone=not by_somebody))
            return None
        if isinstance(answer, Unfit):
            self._leave_out(answer)
            self._send([block])
            return None
        self._answered = True
        return answer

    def _judge(self, block: _Block, died: int) -> Lost | None:
        """Give up a point that took down enough workers by itself, else let it run alone; several points are halved."""
        if self._alone is block:
            self._alone = None
            block.deaths += died
        if block.deaths >= DEATHS or block.points.size > 1:
            return Lost(f"{block.deaths} worker processes died on this point")
        self._suspects.append(block)
        return None

    def _leave_out(self, unfit: Unfit) -> None:
        """Retire a worker that cannot run the study.

        Raises
        ------
        InputError
            If no other is there, and none has ever given an answer.
        """
        if not self._answered and set(self._dask.nthreads()) <= {unfit.address}:
            raise InputError(f"worker {unfit.name}: {unfit.reason}")
        if unfit.name not in self._left_out:  # whoever supervises it may start it again and again
            print(f"worker {unfit.name} at {unfit.address} is left out: {unfit.reason}", file=sys.stderr)
            self._left_out.add(unfit.name)
        with suppress(OSError):
            self._dask.retire_workers([unfit.address])

    def close(self) -> None:
        """Cancel the blocks that are not finished."""
        if self._at_work and self._dask.status == "running":
            self._dask.cancel(list(self._at_work))
