"""Execution of a study's points in blocks, in this process or on worker processes.

The place, the order and the neighbours of a point never change its results.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Generator
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError, option
from tripod_doe.model_interface import BlockResult, Outcome
from tripod_doe.process.interrupts import check_interrupt
from tripod_doe.study.definition.study import Study
from tripod_doe.study.execution.block_answer import Answer, AtWork, Lost
from tripod_doe.study.execution.block_queue import BlockQueue
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler
from tripod_doe.study.execution.task import make_task
from tripod_doe.study.execution.this_process import ThisProcess
from tripod_doe.study.journal import FinishedBlock
from tripod_doe.study.study_points import StudyPoints

if TYPE_CHECKING:  # Dask takes a second to import, and a small study does without
    from tripod_doe.study.execution.dask_executor import OnDask
    from tripod_doe.study.execution.dask_workers import DaskWorkers

_USUAL_WORKERS = 2
_WORTH_WORKERS = 15.0  # seconds of work left that justify workers: two take about 8 CPU-s to start, and some to end
_SECONDS, _REMOTE_SECONDS = 1.0, 5.0  # duration of a block here, and on a cluster, whose scheduler serves many
_PATIENCE = 2.0  # seconds after which a block in this process counts as long


class Execution:
    """The processes in which the studies of a command run; workers are started when a study first needs them.

    Args:
        workers: Worker processes; 0 runs everything in this process; None uses this process if that is faster, else two
            worker processes.
        scheduler: An existing Dask scheduler to use instead of own workers.
        oversubscribe: Allow more workers than this machine has processors.

    Attributes:
        seconds: Wall time of the blocks of the latest study, without compilation and the start of workers.

    Raises:
        InputError: If the arguments contradict each other.
    """

    def __init__(
        self, workers: int | None = None, scheduler: ExistingScheduler | None = None, oversubscribe: bool = False
    ) -> None:
        if workers is not None and workers < 0:
            raise InputError(f"{option('workers', workers)}: must be 0 (this process) or more")
        if workers == 0 and scheduler:
            raise InputError(f"{option('workers', 0)} runs in this process: leave out {scheduler}")
        if workers and not scheduler and not oversubscribe:
            workers = _at_most_processors(workers)
        self._wanted, self._scheduler = workers, scheduler
        self._dask: DaskWorkers | None = None
        self.seconds = 0.0

    def __enter__(self) -> Execution:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._dask:
            self._dask.close()

    def run(self, asked: StudyPoints, missing: IntArray, careful: bool = False) -> Generator[FinishedBlock, None, None]:
        """Run points in blocks, and yield each block as it finishes.

        Args:
            missing: Indices of the points to run.
            careful: Run nothing in this process unless `workers` is 0: a point may end it.

        Kernels are compiled once, in this process; workers load them, and start with the modules imported here.
        A block that ends its process (three times, for a worker) is halved until a single point is left; its outcome
        is worker_lost. In this process that holds only for a point that asks Python to exit: a crash ends the command,
        and the next run of the study is careful.

        Raises:
            InputError: If a function of a script or a notebook is to run on workers.
        """
        self.seconds = 0.0
        study = asked.study
        seconds = _REMOTE_SECONDS if self._scheduler else _SECONDS
        queue = BlockQueue(missing, study.file.run.block, seconds, asked.kinds(missing))
        starts_here = self._starts_here(careful or study.file.study.function is not None)
        if not starts_here:
            _refuse_function_of_script(study)
        study.simulator.prepare(asked.columns(asked.of_each_kind(missing)))
        if not starts_here:
            self._workers.start(study)
        with closing(ThisProcess(_PATIENCE)) as here:
            if starts_here:
                yield from self._empty(queue, asked, here, lambda: self._goes_on_here(study, queue))
            if len(queue):
                with closing(self._workers.executor(study)) as there:
                    yield from self._empty(queue, asked, there)
            yield from self._empty(queue, asked, here)  # a long block that is still at work here

    def _starts_here(self, risky: bool) -> bool:
        """Whether the first points of a study run in this process."""
        if self._wanted is None and not self._scheduler:
            return not risky
        return self._wanted == 0

    def _goes_on_here(self, study: Study, queue: BlockQueue) -> bool:
        """Whether the next points run in this process: until workers, if the rest justifies them, have started."""
        if self._wanted == 0 or study.file.run.exclusive or queue.seconds_left < _WORTH_WORKERS:
            return True
        self._workers.start(study)
        return not self._workers.ready

    def _empty(
        self,
        queue: BlockQueue,
        asked: StudyPoints,
        executor: ThisProcess | OnDask,
        go_on: Callable[[], bool] = lambda: True,
    ) -> Generator[FinishedBlock, None, None]:
        """Run the points of a queue on one executor while `go_on` allows it.

        Wait for all submitted blocks, except a long block if others can run elsewhere: it continues until the next
        call.
        """
        started = time.perf_counter()
        try:
            while True:
                check_interrupt()
                while executor.busy < executor.slots and go_on() and (block := queue.take(executor.slots)) is not None:
                    executor.submit(block, make_task(asked.study, asked.points, block))
                if not executor.busy:
                    break
                if (news := executor.next_finished()) is None:
                    continue
                block, answer = news
                if isinstance(answer, AtWork):
                    queue.expect(answer.seconds, block.size)
                    if not go_on():
                        break
                    continue
                if isinstance(answer, Lost) and block.size > 1:
                    queue.halve(block)
                    continue
                finished = _finished_block(asked.keys[block], answer)
                queue.learn(finished.wall_seconds, block, finished.result.nbytes)
                yield finished
        finally:
            self.seconds += time.perf_counter() - started

    @property
    def _workers(self) -> DaskWorkers:
        if self._dask is None:
            from tripod_doe.study.execution.dask_workers import DaskWorkers

            self._dask = DaskWorkers(self._wanted or _USUAL_WORKERS, self._scheduler)
        return self._dask


def _refuse_function_of_script(study: Study) -> None:
    """Refuse (InputError) a function that worker processes cannot import."""
    function = study.file.study.function or ""
    if function.startswith("__main__:"):
        remedy = f"give {option('workers', 0)}, which runs it in this process, or write it into a module"
        reason = f"function = {function!r}: workers have no function of a script or notebook: {remedy}"
        raise study.fail("[study]", reason)


def _at_most_processors(workers: int) -> int:
    """The number of workers, limited to the processors that this process may use; the limit is printed."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or workers
    if workers > processors:
        limit = f"{option('workers', workers)}: this machine has {processors} processors, so {processors} workers start"
        print(f"{limit}; {option('oversubscribe', True)} starts all", file=sys.stderr)
    return min(workers, processors)


def _finished_block(keys: NDArray[np.void], answer: Answer | Lost) -> FinishedBlock:
    """A block for the journal; a point that ended its process is worker_lost."""
    if isinstance(answer, Answer):
        return FinishedBlock(keys, answer.result, answer.cpu_seconds, answer.wall_seconds, answer.worker)
    lost = BlockResult.blank(1, Outcome.WORKER_LOST, answer.reason, simulated_seconds=np.nan)
    return FinishedBlock(keys, lost, 0.0, 0.0, "")
