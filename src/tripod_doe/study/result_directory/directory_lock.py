"""The lock of a result directory: one process writes there, and notices if another takes its place.

The system releases the lock of any process that ends. Some network filesystems lock within one machine only, or not at
all: so the file also names its holder by host, process and a random token, and the lock holds until that process is
known to have ended.
"""

import contextlib
import fcntl
import json
import os
import secrets
import socket
import time
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, StorageError, option
from tripod_doe.files.regular_files import open_locked, read_regular

_LOCK = ".lock"
_SIGNING = 0.2  # seconds in which a process that has the lock names itself
_LONGEST = 1000  # bytes of the signature
_MOST_PROCESSES, _END_OF_TIME = 2**31, 1e12
_CLOCK = 2.0  # seconds by which the start of a process is uncertain


class DirectoryLock:
    """Lock of a directory for this process; its file ``.lock`` holds host, process number and token.

    Args:
        take_over: Whether to take the lock of a process of another host. A process of this host keeps it while it is
            alive.

    Raises:
        InputError: If another process holds the directory, or it cannot be written.
    """

    def __init__(self, path: Path, take_over: bool = False) -> None:
        self._file, self._token = path / _LOCK, secrets.token_hex(8)
        try:
            self._lock = self._locked(take_over)
        except BlockingIOError as error:
            raise InputError(f"{path}: {_holder_text(self._file)} or choose another directory") from error
        except OSError as error:
            raise InputError(f"{path}: cannot write here: {error.strerror}; choose another directory") from error
        self._signed = self._sign()

    def _locked(self, take_over: bool) -> int:
        lock = open_locked(self._file, os.O_CREAT | os.O_RDWR)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            holder = _holder(self._file)
            if not holder or _is_dead(holder):
                return lock
        except BlockingIOError:  # also where the lock of a dead process stays
            holder = _holder(self._file)
        os.close(lock)
        if _is_alive(holder) or not (take_over or self._stays_gone(holder)):
            raise BlockingIOError
        self._file.unlink(missing_ok=True)  # a new file has a new lock; the former holder notices it
        return self._locked(take_over=False)

    def _stays_gone(self, holder: dict[str, Any]) -> bool:
        """Whether a holder has ended, and no other process is about to write its name."""
        time.sleep(_SIGNING if _is_dead(holder) else 0.0)
        return _is_dead(holder) and _holder(self._file) == holder

    def _sign(self) -> bool:
        """Write the holder into the lock's file; that fails on a full disk, and the lock holds without it."""
        signature = {"host": socket.gethostname(), "process": os.getpid(), "since": time.time(), "token": self._token}
        with contextlib.suppress(OSError):
            os.ftruncate(self._lock, 0)
            os.pwrite(self._lock, json.dumps(signature).encode(), 0)
            os.fsync(self._lock)
            return True
        return False

    def check(self) -> None:
        """Check that no other process has taken the directory over.

        Raises:
            StorageError: If one has, or if the lock's file is missing.
        """
        place = self._file.parent
        try:
            same = os.path.samestat(os.stat(self._file), os.fstat(self._lock))
        except FileNotFoundError as error:
            lost = f"{self._file.name} was deleted, so another process may write here"
            raise StorageError(f"{place}: {lost}; this one stops") from error
        if not same or (self._signed and _holder(self._file).get("token") != self._token):
            raise StorageError(f"{place}: another process took this directory over; this one stops")

    def release(self) -> None:
        """Let other processes write."""
        with contextlib.suppress(OSError, StorageError):
            self.check()
            os.ftruncate(self._lock, 0)
        os.close(self._lock)


def _holder(file: Path) -> dict[str, Any]:
    """Host, number and token of the holder of a directory; empty where they are not known."""
    try:
        holder = json.loads(read_regular(file, _LONGEST))
    except (OSError, ValueError, RecursionError, InputError):
        return {}
    if not isinstance(holder, dict) or not isinstance(holder.get("host"), str):
        return {}
    process, since = holder.get("process"), holder.get("since", 0.0)
    is_process = type(process) is int and 0 < process < _MOST_PROCESSES
    return holder if is_process and type(since) in (int, float) and abs(since) < _END_OF_TIME else {}


def _is_dead(holder: dict[str, Any]) -> bool:
    """Whether a holder is known to have ended: a process of this host that no longer exists."""
    return bool(holder) and holder["host"] == socket.gethostname() and not _is_alive(holder)


def _is_alive(holder: dict[str, Any]) -> bool:
    """Whether a holder is known to be alive: a process of this host, and no later one with the same number."""
    if not holder or holder["host"] != socket.gethostname():
        return False
    import psutil  # only where a directory was not released

    try:
        process = psutil.Process(holder["process"])
        began, ended = process.create_time(), process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
    except psutil.Error:  # another user's
        return True
    return not ended and bool(began <= holder.get("since", began) + _CLOCK)


def _holder_text(file: Path) -> str:
    """The holder of a directory, and a remedy: the beginning of a sentence."""
    holder = _holder(file)
    who = f"process {holder['process']} on {holder['host']}" if holder else "another run"
    place = (
        ""
        if _is_alive(holder)
        else f", or take the directory over with {option('take_over', True)} if that process is dead,"
    )
    return f"{who} is writing here; wait for it{place}"
