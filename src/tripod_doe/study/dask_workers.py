"""Blocks of points run on Dask workers: processes of this machine, or those of an existing scheduler."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack

import dask
import numpy as np
from distributed import Client, KilledWorker, as_completed, get_worker
from distributed import Future as DaskFuture
from numpy.typing import NDArray

from tripod_doe.errors import InputError, option
from tripod_doe.study.definition import Study
from tripod_doe.study.executor import Answer, Lost
from tripod_doe.study.local_cluster import LocalWorkers
from tripod_doe.study.task import Task, matching_simulator, run_task

__all__ = ["QUIET", "DaskWorkers"]

_IN_FLIGHT = 2  # blocks per worker: one at work, one waiting, so that no worker waits for this process
_ALLOWED_FAILURES = 2
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
        Address of an existing Dask scheduler, used in place of own workers.
    """

    def __init__(self, count: int, scheduler: str | None = None) -> None:
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
            If no scheduler answers, or its workers have other kernels than this process.
        """
        self.start(study)
        assert self._client is not None
        client = self._client.result()
        _import_simulator(client, study)
        workers = max(len(client.nthreads()), 1)
        return OnDask(client, 1 if study.file.run.exclusive else _IN_FLIGHT * workers)

    def close(self) -> None:
        """End the worker processes of this machine."""
        self._background.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def _connect(self, study: Study) -> Client:
        self._stack.enter_context(dask.config.set(QUIET))
        if self._scheduler:
            try:
                client = Client(self._scheduler, timeout=5)
            except (OSError, ValueError) as error:
                raise InputError(f"{option('scheduler', self._scheduler)}: no Dask scheduler answers there") from error
        else:
            workers = LocalWorkers(self._count)
            self._stack.callback(workers.close)
            client = Client(workers.address)
        self._stack.callback(client.close)  # as a context manager it must be left by the thread that entered it
        _import_simulator(client, study)
        return client


def _import_simulator(client: Client, study: Study) -> None:
    """Import a simulator on all workers before its first block, and check that it is that of this process."""
    table = study.file.study
    client.run(_get_ready, table.scene, table.function, str(study.folder), study.simulator.source_hash)


def _get_ready(scene: str, function: str | None, folder: str, source_hash: str) -> None:
    matching_simulator(scene, function, folder, source_hash)


class OnDask:
    """Runs blocks on the workers of a client.

    Attributes
    ----------
    slots
        Blocks sent before the first one is finished.
    """

    def __init__(self, client: Client, slots: int) -> None:
        self.slots = slots
        self._dask = client
        self._blocks: dict[DaskFuture, NDArray[np.int64]] = {}
        self._finished = as_completed(loop=client.loop)

    @property
    def busy(self) -> int:
        """Blocks that were sent and are not finished."""
        return len(self._blocks)

    def submit(self, block: NDArray[np.int64], task: Task) -> None:
        """Send a block."""
        future = self._dask.submit(_on_worker, task, pure=False)
        self._blocks[future] = block
        self._finished.add(future)

    def next_finished(self) -> tuple[NDArray[np.int64], Answer | Lost]:
        """Wait for one of the blocks that were sent, and raise what its simulator raised."""
        future = next(self._finished)
        block = self._blocks.pop(future)
        try:
            answer: Answer = future.result()
        except KilledWorker:
            return block, Lost(f"{_ALLOWED_FAILURES + 1} worker processes died on this point")
        finally:
            future.release()
        return block, answer

    def close(self) -> None:
        """Cancel the blocks that are not finished."""
        self._dask.cancel(list(self._blocks))


def _on_worker(task: Task) -> Answer:
    """Run a task on a worker; its name goes with the results."""
    return Answer(*run_task(task), str(get_worker().name))
