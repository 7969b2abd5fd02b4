"""What a worker process of a local cluster does first: it leaves interrupts to the process that started it.

Ctrl-C in a terminal goes to all processes of a command. The one that writes the results decides when workers end.
"""

from __future__ import annotations

import signal

__all__ = ["dask_setup"]


def dask_setup(worker: object) -> None:
    """Called by Dask in each new worker process, in its main thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
