"""Execution of a study's points on Dask: blocks out, finished blocks into the journal, by one writer.

Policy (workers, block size, scheduler) decides when and where a point runs, never what it gives.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed, get_worker
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.interrupts import check_interrupt
from tripod_doe.simulator import BlockResult, Outcome
from tripod_doe.study.definition import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.task import Task, make_task, matching_simulator, run_task

__all__ = ["Policy", "local_workers", "run_blocks"]

_TARGET_SECONDS = 1.0
_FIRST_BLOCK = 1  # a point may take seconds; cheap ones are told by the first answer
_LARGEST_GROWTH = 32
_SMALLEST_SHARE = 16  # the last blocks shrink to this part of the usual ones
_IN_FLIGHT = 2  # blocks a worker: one at work, one waiting, so that no worker waits for this process
_ALLOWED_FAILURES = 2
_QUIET = {
    "distributed.scheduler.allowed-failures": _ALLOWED_FAILURES,
    "distributed.admin.tick.limit": "1h",
    "distributed.worker.profile.enabled": False,
    "distributed.comm.timeouts.connect": "30s",
}


@dataclass(frozen=True)
class Policy:
    """How a study runs.

    Attributes
    ----------
    workers
        Worker processes of the local cluster, one thread each.
    scheduler
        Address of an existing Dask scheduler, used in place of a local cluster.
    block
        Points a task; sized for about a second of work unless given.
    exclusive
        One block at a time.
    """

    workers: int = 2
    scheduler: str | None = None
    block: int | None = None
    exclusive: bool = False


def _get_ready(*what: Any) -> None:
    """Import and compile on a worker before its first block."""
    matching_simulator(*what)


def _on_worker(task: Task) -> tuple[BlockResult, float, float, str]:
    """Run a task on a worker; its name goes with the results."""
    return *run_task(task), str(get_worker().name)


@contextmanager
def local_workers(count: int) -> Iterator[str]:
    """A local cluster of single-threaded processes, gone at the end; gives its scheduler's address.

    Parameters
    ----------
    count
        Worker processes.
    """
    with (
        dask.config.set(_QUIET),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # another run may have the default port
            silence_logs=50,
            memory_limit=0,
            preload=["tripod_doe.study.worker"],
        ) as cluster,
    ):
        yield str(cluster.scheduler_address)


@contextmanager
def _client(policy: Policy) -> Iterator[Client]:
    """A client of the existing scheduler, or of a local cluster of its own."""
    with dask.config.set(_QUIET):
        if policy.scheduler:
            try:
                client = Client(policy.scheduler, timeout=5)
            except (OSError, ValueError) as error:
                raise InputError(f"--scheduler {policy.scheduler}: no Dask scheduler answers there") from error
            with client:
                yield client
            return
        with local_workers(policy.workers) as address, Client(address) as client:
            yield client


def run_blocks(
    study: Study,
    points: Points,
    keys: NDArray[np.void],
    missing: NDArray[np.int64],
    policy: Policy,
    commit: Callable[[FinishedBlock], bool],
) -> float:
    """Run the missing points in blocks and hand every finished block to `commit`.

    Parameters
    ----------
    study, points
        What to run.
    keys
        Fingerprints of all points.
    missing
        Indices of the points to run.
    policy
        How to run them.
    commit
        Called in this thread for every finished block, in the order in which they finish; False stops the run.

    Returns
    -------
    float
        Wall seconds from the first block sent to the last one committed, the start of the workers not counted.

    Notes
    -----
    A worker that dies is replaced and its block runs elsewhere. A block that takes down three workers is halved until
    the point that does it stands alone; that point is recorded as worker_lost.
    """
    columns = {name: column[missing] for name, column in points.settings.items()}
    study.simulator.prepare(study.simulator.columns(study.base, columns, missing.size))  # once for all workers
    queue = _Queue(missing, policy.block)
    with _client(policy) as client:
        table = study.file.study
        client.run(_get_ready, table.scene, table.function, str(study.folder), study.simulator.source_hash)
        workers = max(len(client.nthreads()), 1)
        slots = 1 if policy.exclusive else _IN_FLIGHT * workers
        running: dict[Future, NDArray[np.int64]] = {}
        completed = as_completed()

        def submit() -> None:
            while len(running) < slots and (chosen := queue.take(slots)) is not None:
                future = client.submit(_on_worker, make_task(study, points, chosen), pure=False)
                running[future] = chosen
                completed.add(future)

        started = time.perf_counter()
        submit()
        for future in completed:
            chosen = running.pop(future)
            block = _finished(future, keys[chosen])
            future.release()
            if block is None:
                queue.halve(chosen)
            else:
                queue.learn(block.wall_seconds, chosen.size)
                if not commit(block):
                    client.cancel(list(running))
                    break
            check_interrupt()
            submit()
        return time.perf_counter() - started


def _finished(future: Future, keys: NDArray[np.void]) -> FinishedBlock | None:
    """The block of a future; None where it killed its workers and should be halved."""
    error = future.exception()
    if error is None:
        result, cpu, wall, worker = future.result()
        return FinishedBlock(keys, result, cpu, wall, worker)
    if isinstance(error, KilledWorker):
        if keys.size > 1:
            return None
        detail = f"{_ALLOWED_FAILURES + 1} worker processes died on this point"
        lost = BlockResult.blank(1, Outcome.WORKER_LOST, detail, simulated_seconds=np.nan)
        return FinishedBlock(keys, lost, 0.0, 0.0, "")
    raise error


class _Queue:
    """Points that wait, cut into blocks that last about a second each."""

    def __init__(self, missing: NDArray[np.int64], block: int | None) -> None:
        self._waiting = missing
        self._returned: list[NDArray[np.int64]] = []
        self._fixed = block
        self._size = block or _FIRST_BLOCK

    def take(self, slots: int) -> NDArray[np.int64] | None:
        """The next block, None when nothing waits; the last blocks are small so that all workers end together."""
        if self._returned:
            return self._returned.pop()
        if self._waiting.size == 0:
            return None
        share = -(-self._waiting.size // slots)
        size = self._fixed or max(min(self._size, share), self._size // _SMALLEST_SHARE, 1)
        block, self._waiting = self._waiting[:size], self._waiting[size:]
        return block

    def halve(self, chosen: NDArray[np.int64]) -> None:
        """Put a block back as two halves."""
        self._returned.extend(half for half in np.array_split(chosen, 2) if half.size)

    def learn(self, seconds: float, count: int) -> None:
        """Size the next blocks by what this one took."""
        if self._fixed is None and count:
            wanted = _TARGET_SECONDS * count / max(seconds, 1e-6)
            self._size = int(min(max(wanted, 1), _LARGEST_GROWTH * max(self._size, count)))
