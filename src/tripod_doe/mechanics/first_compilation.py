"""The first compilation of kernels in a version: announced on the terminal, and done by one process at a time.

What was compiled is noted by an empty file in the folder of the kernel cache. Where it is missing, a process locks the
folder, compiles and makes the file; others wait for the lock, find the file and load the machine code. The system
releases the lock of a process that ends in any way.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from tripod_doe.mechanics.sources import cache_root, source_hashes

__all__ = ["first_compilation"]

_one_thread = threading.RLock()
_locked_folders: set[Path] = set()
"""Locked by this process: a compilation within a compilation would wait for itself."""


@contextmanager
def first_compilation(kernels: str, seconds: float) -> Iterator[None]:
    """Let the block compile kernels, or load their machine code, when no other process is compiling them.

    Parameters
    ----------
    kernels
        What is compiled, for the message: ``"model equilibrium with newton"``; the same words for the same kernels.
    seconds
        How long it takes from an empty cache (Intel Xeon, one core), for the message; less where others share kernels
        with them and are compiled.

    Notes
    -----
    Without a lock where the folder cannot be written: then each process compiles.
    """
    folder = cache_root() / f"kernels-{source_hashes().kernels}"
    compiled = folder / f"{kernels.replace(' ', '-')}.compiled"
    if compiled.exists():
        yield
        return
    with _one_thread, _locked(folder):
        if compiled.exists():
            yield
            return
        _say(f"compiling kernels of {kernels}, once per version: about {seconds:.0f} s or less")
        started = time.perf_counter()
        yield
        _say(f"compiled in {time.perf_counter() - started:.0f} s")
        with suppress(OSError):
            compiled.touch()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; nothing where this process holds it already or the folder cannot be written."""
    if folder in _locked_folders or (lock := _open_lock(folder)) is None:
        yield
        return
    with lock:  # closing it releases it
        _locked_folders.add(folder)
        try:
            yield
        finally:
            _locked_folders.remove(folder)


def _open_lock(folder: Path) -> IO[str] | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / "lock").open("a")
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        _say("another process is compiling kernels: waiting for it")
        fcntl.flock(lock, fcntl.LOCK_EX)
    except OSError:  # a file system without locks
        lock.close()
        return None
    return lock


def _say(sentence: str) -> None:
    """Write a line to standard error in place of a progress bar, if there is one; workers of a cluster are silent."""
    if multiprocessing.parent_process() is None:
        print(f"\r\033[K{sentence}" if sys.stderr.isatty() else sentence, file=sys.stderr, flush=True)
