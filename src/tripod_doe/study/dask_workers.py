"""Blocks of points run on Dask workers: processes of this machine, or those of an existing scheduler.

What dies is ordinary: blocks that were at work on a lost scheduler run again, a worker with other kernels is left out,
and a point is only said to take down its worker after it did so alone.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass

import dask
import numpy as np
from distributed import Client, KilledWorker, as_completed, get_worker
from distributed import Future as DaskFuture
from distributed.comm import CommClosedError
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.study.definition import Study
from tripod_doe.study.executor import Answer, Lost
from tripod_doe.study.existing_scheduler import ExistingScheduler
from tripod_doe.study.local_cluster import LocalWorkers
from tripod_doe.study.task import Task, matching_simulator, run_task

__all__ = ["QUIET", "DaskWorkers"]

_IN_FLIGHT = 2  # blocks per thread: one at work, one waiting, so that no worker waits for this process
_ALLOWED_FAILURES = 2
_COUNTED = 1.0  # seconds for which a count of the workers holds
QUIET = {
    "distributed.scheduler.allowed-failures": _ALLOWED_FAILURES,
    "distributed.admin.tick.limit": "1h",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.multiprocessing-method": "forkserver",
    "distributed.comm.timeouts.connect": "30s",
}
"""Settings of Dask in every process of a study."""


class DaskWorkers:
    """Workers that several studies share.

    Parameters
    ----------
    count
        Worker processes of this machine, one thread each.
    scheduler
        An existing Dask scheduler, used in place of own workers.
    """

    def __init__(self, count: int, scheduler: ExistingScheduler | None = None) -> None:
        self._count, self._scheduler = count, scheduler
        self._stack = ExitStack()
        self._background = ThreadPoolExecutor(1, "start of workers")
        self._client: Future[Client] | None = None

    def start(self, study: Study) -> None:
        """Start the workers without waiting for them, and let them import the simulator of a study."""
        if self._client is None:
            self._client = self._background.submit(self._connect, study)

    @property
    def ready(self) -> bool:
        """Whether the workers are there (or could not be started)."""
        return self._client is not None and self._client.done()

    def executor(self, study: Study) -> OnDask:
        """Wait for the workers and let them run blocks of a study.

        Raises
        ------
        InputError
            If no scheduler answers.
        """
        self.start(study)
        assert self._client is not None
        client = self._client.result()
        _import_simulator(client, study)
        if not client.nthreads():
            print(f"{self._scheduler}: no worker has joined yet; waiting for the first", file=sys.stderr)
        return OnDask(client, self._replaced, exclusive=study.file.run.exclusive)

    def close(self) -> None:
        """End the worker processes of this machine."""
        self._background.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def _connect(self, study: Study) -> Client:
        self._stack.enter_context(dask.config.set(QUIET))
        client = self._scheduler.connect() if self._scheduler else self._own_workers()
        self._stack.callback(client.close)  # as a context manager it must be left by the thread that entered it
        _import_simulator(client, study)
        return client

    def _own_workers(self) -> Client:
        workers = LocalWorkers(self._count)
        self._stack.callback(workers.close)
        return Client(workers.address)

    def _replaced(self, lost: Client) -> Client:
        """A client in place of one whose scheduler is gone."""
        with suppress(OSError, TimeoutError):
            lost.close(timeout=1)
        client = self._scheduler.connect_again() if self._scheduler else self._own_workers()
        self._stack.callback(client.close)
        self._client = Future()
        self._client.set_result(client)
        return client


def _import_simulator(client: Client, study: Study) -> None:
    """Import a simulator on all workers before its first block; one that cannot is left out when it gets a block."""
    table = study.file.study
    client.run(
        _get_ready, table.scene, table.function, str(study.folder), study.simulator.source_hash, on_error="ignore"
    )


def _get_ready(scene: str, function: str | None, folder: str, source_hash: str) -> None:
    matching_simulator(scene, function, folder, source_hash)


@dataclass(frozen=True)
class _Unfit:
    """A worker that cannot run a study, and why."""

    address: str
    reason: str


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
    """

    def __init__(self, client: Client, replaced: Callable[[Client], Client], exclusive: bool = False) -> None:
        self._dask, self._replaced, self._exclusive = client, replaced, exclusive
        self._blocks: dict[DaskFuture, tuple[NDArray[np.int64], Task]] = {}
        self._suspects: deque[tuple[NDArray[np.int64], Task]] = deque()
        self._alone: DaskFuture | None = None
        self._finished = as_completed(loop=client.loop)
        self._threads, self._counted_at, self._answered = 0, -np.inf, False

    @property
    def slots(self) -> int:
        """Blocks sent before the first one is finished; none while a point is suspected to take down its worker."""
        if self._suspects or self._alone:
            return 0
        if self._exclusive:
            return 1
        if time.monotonic() > self._counted_at + _COUNTED:  # workers join and leave
            with suppress(OSError, CancelledError):
                self._threads, self._counted_at = sum(self._dask.nthreads().values()), time.monotonic()
        return _IN_FLIGHT * max(self._threads, 1)

    @property
    def busy(self) -> int:
        """Blocks that were sent and are not finished."""
        return len(self._blocks) + len(self._suspects)

    def submit(self, block: NDArray[np.int64], task: Task) -> None:
        """Send a block."""
        self._send(block, task)

    def _send(self, block: NDArray[np.int64], task: Task) -> DaskFuture:
        future = self._dask.submit(_on_worker, task, pure=False)
        self._blocks[future] = block, task
        self._finished.add(future)
        return future

    def next_finished(self) -> tuple[NDArray[np.int64], Answer | Lost]:
        """Wait for one of the blocks that were sent, and raise what its simulator raised.

        A block whose scheduler was lost, or whose worker cannot run the study, is sent again. A point that is
        said to have taken down its worker is sent again by itself, with nothing behind it that could be blamed for it.
        """
        while True:
            if not self._blocks:
                self._alone = self._send(*self._suspects.popleft())
            future = next(self._finished)
            if future not in self._blocks:  # of a client that was replaced
                continue
            block, task = self._blocks.pop(future)
            alone, self._alone = future is self._alone, None
            try:
                answer: Answer | _Unfit = future.result()
            except KilledWorker as error:
                if block.size > 1 or alone:
                    times = error.allowed_failures + 1
                    died = f"{times} worker processes" if times > 1 else "a worker process"
                    return block, Lost(f"{died} died on this point")
                self._suspects.append((block, task))
                continue
            except (CancelledError, CommClosedError):  # the scheduler is gone, or just went with the answer
                self._blocks[future] = block, task
                self._send_all_again()
                continue
            future.release()
            if isinstance(answer, _Unfit):
                self._leave_out(answer)
                self._send(block, task)
                continue
            self._answered = True
            return block, answer

    def _send_all_again(self) -> None:
        """Send the blocks that were at work to the scheduler that takes the place of a lost one."""
        blocks = list(self._blocks.values())
        self._blocks.clear()
        self._alone = None
        self._dask = self._replaced(self._dask)
        self._finished = as_completed(loop=self._dask.loop)
        self._counted_at = -np.inf
        for block, task in blocks:
            self._send(block, task)

    def _leave_out(self, unfit: _Unfit) -> None:
        """Retire a worker that cannot run the study.

        Raises
        ------
        InputError
            If no other is there, and none has ever given an answer.
        """
        if not self._answered and set(self._dask.nthreads()) <= {unfit.address}:
            raise InputError(f"worker {unfit.address}: {unfit.reason}")
        print(f"worker {unfit.address} is left out: {unfit.reason}", file=sys.stderr)
        with suppress(OSError):
            self._dask.retire_workers([unfit.address])

    def close(self) -> None:
        """Cancel the blocks that are not finished."""
        if self._blocks:  # none, where the scheduler is gone for good
            self._dask.cancel(list(self._blocks))


def _on_worker(task: Task) -> Answer | _Unfit:
    """Run a task on a worker; its name goes with the results."""
    worker = get_worker()
    try:
        matching_simulator(task.scene, task.function, task.folder, task.source_hash)
    except InputError as error:
        return _Unfit(str(worker.address), str(error))
    return Answer(*run_task(task), str(worker.name))
