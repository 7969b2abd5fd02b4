"""Dask workers of a command: processes of this machine, or the workers of an existing scheduler."""

import sys
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress

import dask
from distributed import Client

from tripod_doe.study.definition.simulators import matching_simulator
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.execution.dask_executor import OnDask
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler
from tripod_doe.study.execution.dask_local_cluster import QUIET, LocalWorkers
from tripod_doe.study.execution.user_code import read_user_code


class DaskWorkers:
    """Workers that several studies share.

    Args:
        scheduler: An existing Dask scheduler, used in place of own workers.
    """

    def __init__(self, count: int, scheduler: ExistingScheduler | None = None) -> None:
        self._count, self._scheduler = count, scheduler
        self._stack = ExitStack()
        self._background = ThreadPoolExecutor(1, "start of workers")
        self._client: Future[Client] | None = None

    def start(self, study: Study) -> None:
        """Start the workers without waiting for them; local ones import the simulator of a study."""
        if self._client is None:
            self._client = self._background.submit(self._connect, study)

    @property
    def ready(self) -> bool:
        """Whether the start of the workers has ended, with success or not."""
        return self._client is not None and self._client.done()

    def executor(self, study: Study) -> OnDask:
        """Wait for the workers and let them run blocks of a study; InputError if no scheduler answers."""
        self.start(study)
        assert self._client is not None
        client = self._client.result()
        function = study.file.study.function
        if not self._scheduler:
            _import_simulator(client, study)
        elif not client.nthreads():
            print(f"{self._scheduler}: no worker has joined yet; waiting for the first", file=sys.stderr)
        code = read_user_code(function, study.folder.path) if self._scheduler and function else None
        return OnDask(client, self._replaced, study.file.run.exclusive, code)

    def close(self) -> None:
        """End the worker processes of this machine."""
        self._background.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def _connect(self, study: Study) -> Client:
        self._stack.enter_context(dask.config.set(QUIET))
        client = self._scheduler.connect_first() if self._scheduler else self._own_workers()
        self._stack.callback(client.close)  # as a context manager it must be left by the thread that entered it
        if not self._scheduler:
            _import_simulator(client, study)
        return client

    def _own_workers(self) -> Client:
        workers = LocalWorkers(self._count)
        self._stack.callback(workers.close)
        return workers.connect()

    def _replaced(self, lost: Client) -> Client:
        """A new client after its scheduler was lost."""
        if lost.status != "connecting":  # by itself, which would leave a socket open; it is closed at the end
            with suppress(OSError, TimeoutError):
                lost.close(timeout=1)
        client = self._scheduler.connect_again() if self._scheduler else self._own_workers()
        self._stack.callback(client.close)
        self._client = Future()
        self._client.set_result(client)
        return client


def _import_simulator(client: Client, study: Study) -> None:
    """Import a simulator on the workers of this machine before the first block; remote ones import it with a block."""
    table = study.file.study
    client.run(_get_ready, table.scene, table.function, study.folder, study.simulator.source_hash, on_error="ignore")


def _get_ready(scene: str, function: str | None, folder: StudyFolder, source_hash: str) -> None:
    matching_simulator(scene, function, folder, source_hash)
