"""A Dask scheduler that somebody else started: where it is, and how long a study waits for it when it is gone."""

from __future__ import annotations

import json
import socket
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from tripod_doe.errors import InputError, TripodDoeError, option
from tripod_doe.quantities import duration

if TYPE_CHECKING:  # Dask takes a second to import
    from distributed import Client

USUAL_WAIT = 60.0
"""Seconds for which a study waits for a scheduler that is gone, unless told otherwise."""

_ATTEMPT = 5.0  # seconds for one
_PAUSES = (0.5, 10.0)  # seconds between two attempts: the first, doubled up to the last


@dataclass(frozen=True)
class ExistingScheduler:
    """Where a scheduler is."""

    address: str | None = None  # for instance ``tcp://10.0.0.1:8786``; None where a file names it
    # the file that ``dask scheduler --scheduler-file`` writes; read again whenever the scheduler was gone, since
    # another one may have another address
    file: Path | None = None
    # seconds to wait for a scheduler, at the start as well; None: for one that is gone the usual time, at the start no
    # time, so that a wrong address is noticed
    wait: float | None = None

    def __post_init__(self) -> None:
        if self.address and self.file:
            raise InputError(f"give {self} or {option('scheduler_file', str(self.file))}, not both")

    def __str__(self) -> str:
        return option("scheduler", self.address) if self.address else option("scheduler_file", str(self.file))

    def connect(self) -> Client:
        """A client of the scheduler.

        Raises
        ------
        InputError
            If none answers, or the file cannot be read.
        """
        from distributed import Client

        try:
            address = json.loads(self.file.read_text())["address"] if self.file else self.address
            place = urlsplit(str(address))
            # A client tries for much longer than it is told.
            socket.create_connection((place.hostname, place.port), timeout=_ATTEMPT).close()
            return Client(address, timeout=_ATTEMPT)
        except FileNotFoundError as error:
            raise InputError(f"{self}: there is no such file") from error
        except (OSError, ValueError, KeyError) as error:  # KeyError: a file that holds no address
            raise InputError(f"{self}: no Dask scheduler answers there") from error

    def connect_first(self) -> Client:
        """A client at the start.

        Raises
        ------
        InputError
            If none answers and no time to wait was given.
        TripodDoeError
            If none has answered for the given time.
        """
        return self.connect() if self.wait is None else self._connect_within(self.wait)

    def connect_again(self) -> Client:
        """A client of the scheduler, or of the one that takes its place, as soon as it is there.

        Raises
        ------
        TripodDoeError
            If none has answered for so long.
        """
        wait = USUAL_WAIT if self.wait is None else self.wait
        print(f"{self}: the connection is lost; trying for {duration(wait)} to connect again", file=sys.stderr)
        client = self._connect_within(wait)
        print(f"{self}: connected again", file=sys.stderr)
        return client

    def _connect_within(self, seconds: float) -> Client:
        until, pause = time.monotonic() + seconds, _PAUSES[0]
        while True:
            try:
                return self.connect()
            except InputError as error:
                left = until - time.monotonic()
                if left <= 0:
                    raise TripodDoeError(
                        f"{self}: no Dask scheduler has answered for {duration(seconds)}; finished points are kept, "
                        "and the same command runs the others"
                    ) from error
                time.sleep(min(pause, left))
                pause = min(2 * pause, _PAUSES[1])
