"""Worker processes of this machine behind a Dask scheduler, in a program of its own (see `child_process` for why).

The workers are forked from one process that has imported what they need, and has no threads: that costs each of them
0.1 s of CPU time in place of 3 s.

The program answers with the address of its scheduler, then reads standard input: a line closes the workers in order;
the end of the input ends them at once, as the process that wanted them is gone.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from multiprocessing import forkserver

from tripod_doe.errors import TripodDoeError, option
from tripod_doe.study.child_process import answers, start_child
from tripod_doe.study.scenes import modules_of_scenes

QUIET = {
    "distributed.scheduler.allowed-failures": 0,  # which block is to blame is found out here
    "distributed.admin.tick.limit": "1h",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.multiprocessing-method": "forkserver",
    "distributed.comm.timeouts.connect": "30s",
}
"""Settings of Dask in every process of a study."""


class LocalWorkers:
    """Worker processes of this machine.

    Parameters
    ----------
    count
        Number of worker processes, one thread each.

    Attributes
    ----------
    address
        Of their Dask scheduler.

    Raises
    ------
    TripodDoeError
        If they cannot be started.
    """

    def __init__(self, count: int) -> None:
        self._program = start_child(__name__, str(count), *modules_of_scenes())
        assert self._program.stdout is not None
        self.address = self._program.stdout.readline().strip()
        if not self.address:
            self.close()
            raise TripodDoeError(
                f"worker processes could not be started, see the lines above; {option('workers', 0)} computes in this "
                "process"
            )

    def close(self) -> None:
        """End the worker processes."""
        self._program.communicate("close\n")


def _serve(count: int, modules: list[str]) -> None:
    """Start workers with these modules imported, say where they are, and keep them until they are to close."""
    stream = answers()
    multiprocessing.set_forkserver_preload(
        ["distributed.nanny", "distributed.worker", f"{__package__}.on_worker", *modules]
    )
    forkserver.ensure_running()  # it imports them beside the imports here: on two cores that halves the start

    import dask
    from distributed import LocalCluster

    with (
        dask.config.set(QUIET),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # another run may have the default port
            silence_logs=50,
            memory_limit=0,
        ) as cluster,
    ):
        stream.write(f"{cluster.scheduler_address}\n")
        stream.close()
        if not sys.stdin.readline():
            os._exit(1)


if __name__ == "__main__":
    _serve(int(sys.argv[1]), sys.argv[2:])
