"""Holding a result directory: one process writes there, and is told if another takes its place.

The system gives the lock back when its process ends, however that ends. Only where a lock outlives its process, as on
some network filesystems, has a person to say that the holder is dead.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, StorageError, option

__all__ = ["Hold"]

_LOCK = ".lock"


class Hold:
    """A directory held for this process, whose host and number stand in its file ``.lock``.

    Parameters
    ----------
    path
        The directory.
    take_over
        Whether the lock of another process counts for nothing; refused where that process is alive on this host.

    Raises
    ------
    InputError
        If another process holds the directory, or it cannot be written.
    """

    def __init__(self, path: Path, take_over: bool = False) -> None:
        self._file = path / _LOCK
        try:
            self._lock = self._locked(take_over)
        except BlockingIOError as error:
            raise InputError(f"{path}: {_held(self._file)} or choose another {option('out')}") from error
        except OSError as error:
            raise InputError(f"{path}: cannot write here: {error.strerror}; choose another {option('out')}") from error
        self._sign()

    def _locked(self, take_over: bool) -> int:
        lock = os.open(self._file, os.O_CREAT | os.O_RDWR)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            if not take_over or _alive(_holder(self._file)):
                raise
            self._file.unlink(missing_ok=True)  # a new file has a lock of its own; its former holder sees that
            return self._locked(take_over=False)
        return lock

    def _sign(self) -> None:
        """Write host and process into the lock's file; without them on a full disk, the lock holds all the same."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._lock, 0)
            os.pwrite(self._lock, json.dumps({"host": socket.gethostname(), "process": os.getpid()}).encode(), 0)

    def check(self) -> None:
        """Make sure that nobody has taken the directory over.

        Raises
        ------
        StorageError
            If somebody has, or might: the lock's file is gone.
        """
        place = self._file.parent
        try:
            same = os.path.samestat(os.stat(self._file), os.fstat(self._lock))
        except FileNotFoundError as error:
            lost = f"{self._file.name} was deleted, so another process may write here"
            raise StorageError(f"{place}: {lost}; this one stops") from error
        if not same:
            raise StorageError(f"{place}: another process took this directory over; this one stops")

    def release(self) -> None:
        """Let other processes write."""
        os.close(self._lock)


def _holder(file: Path) -> dict[str, Any]:
    """Host and number of the process that holds a directory; empty where they are not known."""
    try:
        found = json.loads(file.read_text())
    except (OSError, ValueError):
        return {}
    known = isinstance(found, dict) and isinstance(found.get("process"), int) and "host" in found
    return found if known else {}


def _alive(holder: dict[str, Any]) -> bool:
    """Whether a holder is known to live: a process of this host."""
    if not holder or holder["host"] != socket.gethostname():
        return False
    try:
        os.kill(holder["process"], 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        return True
    return True


def _held(file: Path) -> str:
    """Who holds a directory, and what to do: the beginning of a sentence."""
    holder = _holder(file)
    who = f"process {holder['process']} on {holder['host']}" if holder else "another run"
    place = "" if _alive(holder) else f", take its place with {option('take_over', True)} if it is dead,"
    return f"{who} is writing here; wait for it{place}"
