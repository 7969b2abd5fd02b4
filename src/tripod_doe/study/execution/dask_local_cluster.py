"""Worker processes of this machine behind a Dask scheduler, in a program of its own (see `child_process` for why).

The workers are forked from one process that has imported what they need, and has no threads: that costs each of them
0.1 s of CPU time in place of 3 s.

The program answers with the address of its scheduler and the credentials of its clients, then reads standard input: a
line closes the workers in order; the end of the input ends them at once, as the process that wanted them is gone.

A process that reaches a scheduler, a nanny or a worker of Dask can run code as their owner, and every user of this
machine reaches its ports. So all of them talk TLS and ask for a certificate, made anew for each cluster and kept in
memory; their HTTP servers, which Dask always starts, have no pages; and all of them, which import from their working
folder, have it in one that only the owner can open.
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from multiprocessing import forkserver
from typing import TYPE_CHECKING

from tripod_doe.errors import TripodDoeError, option
from tripod_doe.study.definition.simulators import modules_of_scenes
from tripod_doe.study.execution.child_process import answers, shorten_temporary_folder, start_child

if TYPE_CHECKING:  # this program starts its own children before it imports Dask
    from distributed import Client

_CREDENTIALS = ("tls_ca_file", "tls_client_cert", "tls_client_key")
_OWN = "tripod_doe.process.own_process"
_END = 5.0  # seconds for a program that has closed its output to end

QUIET = {
    "distributed.scheduler.allowed-failures": 0,  # the executor decides which block is to blame
    "distributed.admin.tick.limit": "1h",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.multiprocessing-method": "forkserver",
    "distributed.comm.timeouts.connect": "30s",
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
"""Settings of Dask in every process of a study."""


class LocalWorkers:
    """Worker processes of this machine.

    Args:
        count: Number of worker processes, one thread each.

    Raises:
        TripodDoeError: If they cannot be started.
    """

    def __init__(self, count: int) -> None:
        self._program = start_child(__name__, str(count), *modules_of_scenes())
        assert self._program.stdout is not None
        answer = self._program.stdout.readline()
        if not answer:
            reason = _ending(self._program)
            self.close()
            raise TripodDoeError(
                f"worker processes could not be started: {reason}; {option('workers', 0)} computes in this process"
            )
        started = json.loads(answer)
        self.address = str(started["address"])  # of their Dask scheduler
        self._credentials: dict[str, str] = started["credentials"]

    def connect(self) -> Client:
        """Make a client of their scheduler."""
        from distributed import Client
        from distributed.security import Security

        return Client(self.address, security=Security(require_encryption=True, **self._credentials))

    def close(self) -> None:
        """End the worker processes."""
        self._program.communicate("close\n")


def _ending(program: subprocess.Popen[str]) -> str:
    """The reason why a program ended before it answered, as the end of a sentence."""
    try:
        code = program.wait(_END)
    except subprocess.TimeoutExpired:
        return "the process that starts them closed its output and goes on"
    if code < 0:
        return f"the process that starts them was ended by {signal.Signals(-code).name}"
    return f"the process that starts them ended with exit code {code}; see the lines above"


def _serve(count: int, modules: list[str]) -> None:
    """Start workers with these modules imported, print their address, and keep them until the parent closes them."""
    stream = answers()
    importlib.import_module(_OWN)
    shorten_temporary_folder()
    multiprocessing.set_forkserver_preload(
        [_OWN, "distributed.nanny", "distributed.worker", f"{__package__}.dask_task", *modules]
    )
    forkserver.ensure_running()  # it imports them in parallel with the imports here: on two cores that halves the start

    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    security = Security.temporary()
    with (
        tempfile.TemporaryDirectory(prefix="tripod-doe-") as folder,
        dask.config.set(QUIET | {"temporary-directory": folder}),  # of the scheduler; workers have `local_directory`
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            security=security,
            dashboard_address="127.0.0.1:0",  # another run may have the default port
            scheduler_kwargs={"dashboard": False},
            local_directory=folder,
            silence_logs=50,
            memory_limit=0,
        ) as cluster,
    ):
        credentials = {name: getattr(security, name) for name in _CREDENTIALS}
        stream.write(json.dumps({"address": cluster.scheduler_address, "credentials": credentials}) + "\n")
        stream.close()
        if not sys.stdin.readline():
            shutil.rmtree(folder, ignore_errors=True)
            os._exit(1)


if __name__ == "__main__":
    _serve(int(sys.argv[1]), sys.argv[2:])
