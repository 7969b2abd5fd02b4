"""The first compilation of kernels in a version: announced on the terminal, and done by one process at a time.

With numba alone, every worker of a study would compile the same kernels for half a minute, unannounced, and count this
as the cost of its first point. A file in the kernel cache records that kernels are compiled, with the number of
compilations of each. If it is missing, a process takes a lock, compiles and writes the file; others wait for the lock
and load the machine code. The system releases the lock of a process that ends in any way.
"""

from __future__ import annotations

import atexit
import fcntl
import gc
import json
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from tripod_doe.errors import StorageError
from tripod_doe.files.atomic_files import replace_text
from tripod_doe.mechanics.compilation.sources import cache_root, source_hashes
from tripod_doe.model_interface import not_counted

_one_thread = threading.RLock()
_compiling = False
"""Whether this process holds a lock: a compilation within a compilation does not ask for one, as it might wait for a
process that waits for this one."""


@contextmanager
def first_compilation(kernels: str, seconds: float, program: str = "") -> Iterator[None]:
    """Compile kernels in the block, or load their machine code, while no other process compiles them.

    Args:
        kernels: Their name in the message, as ``"model equilibrium with newton"``; the same words for the same kernels.
        seconds: At most, from an empty cache (Intel Xeon, one core), for the message.
        program: Python code that compiles other kernels, which are probably needed next: another process runs it
            meanwhile, and ends with this one. Whoever needs them before waits for its lock.

    If the folder cannot be written, each process compiles.
    """
    note = _note(kernels)
    if note.exists():
        with not_counted():
            yield
        return
    with not_counted(), _one_thread, _locked(note.with_suffix(".lock")):
        if note.exists():
            yield
            return
        _say(f"compiling kernels of {kernels}, once per version: at most about {seconds:.0f} s on an idle machine")
        if program and _compiling and (os.cpu_count() or 1) > 1:  # without a lock, its machine code is not loaded
            _run_elsewhere(program)
        started = time.perf_counter()
        with _counted(note), _no_collections():
            yield
        _say(f"compiled in {time.perf_counter() - started:.0f} s")


def _run_elsewhere(program: str) -> None:
    words = [sys.executable, "-P", "-c", program]
    other = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)
    atexit.register(other.kill)


def compilations(kernels: str) -> dict[str, int]:
    """Count the compilations of each kernel, except inlined and previously cached ones.

    More than one means that arguments differ in type.

    Raises:
        FileNotFoundError: If these kernels have not been compiled.
    """
    counts: dict[str, int] = json.loads(_note(kernels).read_text())
    return counts


@contextmanager
def _counted(note: Path) -> Iterator[None]:
    """Count the compilations of a block by kernel, and note them at its end."""
    from numba.core import event  # only processes that compile import it

    compiled = event.RecordingListener()
    with event.install_listener("numba:compile", compiled):
        yield
    ended = (each.data["dispatcher"] for _, each in compiled.buffer if each.is_end)
    names = (f"{one.py_func.__module__}.{one.py_func.__name__}" for one in ended if _is_kernel(one))
    with suppress(StorageError):
        replace_text(note, json.dumps(Counter(names), indent=1))


@contextmanager
def _no_collections() -> Iterator[None]:
    """Pause garbage collection: a compiler makes many objects and little garbage, and looking took 7 % of its time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def _is_kernel(compiled: Any) -> bool:
    """Whether it belongs to this package and is not inlined."""
    ours = compiled.py_func.__module__.startswith("tripod_doe.")
    return ours and "forceinline" not in compiled.targetoptions


def _note(kernels: str) -> Path:
    return cache_root() / f"kernels-{source_hashes().kernels}" / f"{kernels.replace(' ', '-')}.json"


@contextmanager
def _locked(place: Path) -> Iterator[None]:
    """Hold a lock; no effect if this process holds one already or the folder cannot be written."""
    global _compiling
    if _compiling or (lock := _open_lock(place)) is None:
        yield
        return
    with lock:  # closing it releases it
        _compiling = True
        try:
            yield
        finally:
            _compiling = False


def _open_lock(place: Path) -> IO[str] | None:
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        lock = place.open("a+")
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.seek(0)
        who = f"process {holder}" if (holder := lock.read(20)).isdigit() else "another process"
        _say(f"{who} is compiling kernels, once for all: waiting for it (seconds to a minute on an idle machine)")
        fcntl.flock(lock, fcntl.LOCK_EX)
    except OSError:  # a file system without locks
        lock.close()
        return None
    with suppress(OSError):  # a full disk
        lock.truncate(0)
        lock.write(str(os.getpid()))
        lock.flush()
    return lock


def _say(sentence: str) -> None:
    """Write a line to standard error in place of a progress bar, if there is one; workers of a cluster are silent."""
    if multiprocessing.parent_process() is None:
        print(f"\r\033[K{sentence}" if sys.stderr.isatty() else sentence, file=sys.stderr, flush=True)
