"""Processes forked from a process with all imports done: workers of the service, and runs that outlive it."""

import atexit
import multiprocessing
import os
import resource
import runpy
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import forkserver, reduction
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from tripod_doe.files.regular_files import open_locked
from tripod_doe.study.execution.child_process import shorten_temporary_folder

_SAFE, _STARTING = "PYTHONSAFEPATH", threading.Lock()
_MOST_FILES = 4096  # file descriptors that a run closes

shorten_temporary_folder()
context = multiprocessing.get_context("forkserver")
context.set_forkserver_preload(
    [f"tripod_doe.{name}" for name in ("process.own_process", "cli.main", "service.workers.preload")]
)


def start_process(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    """Call a function in a new process, which ends with this one."""
    process = context.Process(target=target, args=arguments, daemon=True)
    _start_forked(process)
    return process


def _start_forked(process: BaseProcess) -> None:
    """Start a process, and the fork server if there is none, which imports nothing from the current folder.

    Only the environment can tell Python so: multiprocessing passes on the flags of this process.
    """
    with _STARTING:
        before = os.environ.get(_SAFE)
        os.environ[_SAFE] = "1"
        try:
            process.start()
        finally:
            if before is None:
                del os.environ[_SAFE]  # not for commands of the user
            else:
                os.environ[_SAFE] = before


def end_fork_server() -> None:
    """End the fork server now: by itself it would first finish its imports. Runs go on."""
    pid: int | None = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if pid is not None:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def start_program(
    module: str, words: Sequence[str], log: Path, lock: int, niceness: int, memory_bytes: int
) -> threading.Thread:
    """Run a module as a program in a process and a session of its own, which outlives this one.

    The fork server may have to start first, which takes seconds: a thread waits for it, and writes into the log if the
    program cannot be started.

    Args:
        module: Full name of the module.
        log: File for its output.
        lock: An open file, closed here, into which the process writes its number and a line end; the process holds the
            file until it ends, its child processes do not.
        niceness: Scheduling priority below other processes on a busy machine; see `os.nice`.
        memory_bytes: Address space of the process, and of each child process.

    Returns:
        Ends when the program has started.
    """
    thread = threading.Thread(target=_start, args=(module, list(words), log, lock, niceness, memory_bytes), daemon=True)
    thread.start()
    return thread


def _start(module: str, words: list[str], log: Path, lock: int, niceness: int, memory_bytes: int) -> None:
    try:
        arguments = module, words, str(log), reduction.DupFd(lock), niceness, memory_bytes
        process = context.Process(target=_detach, args=arguments)
        _start_forked(process)
        process.join()
        reason = f"exit code {process.exitcode}" if process.exitcode else ""
    except (OSError, EOFError) as error:
        reason = str(error)
    finally:
        os.close(lock)
    if reason:
        with suppress(OSError), log.open("a", encoding="utf-8") as stream:
            stream.write(f"tripod-doe: cannot start a process: {reason}\n")


def lead_group() -> None:
    """Make this process lead a new session; its new files are private to its owner."""
    os.setsid()
    os.umask(0o077)


def limit_memory(size: int) -> None:
    """Limit the address space of this process and its child processes, in bytes; a lower limit stays."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    size = size if most == resource.RLIM_INFINITY else min(size, most)
    resource.setrlimit(resource.RLIMIT_AS, (size, size))


def _detach(module: str, words: list[str], log: str, lock: Any, niceness: int, memory_bytes: int) -> None:
    """Fork once more: the process that multiprocessing waits for ends here."""
    held = lock.detach()
    if os.fork():
        return
    lead_group()
    stream = open_locked(Path(log), os.O_WRONLY | os.O_APPEND)
    for number, file in enumerate((os.open(os.devnull, os.O_RDONLY), stream, stream)):
        os.dup2(file, number)
    os.closerange(3, held)  # the fork server goes on as long as anybody keeps its files
    os.closerange(held + 1, _MOST_FILES)
    os.set_inheritable(held, False)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # the fork server ignores this signal
    os.nice(niceness)
    limit_memory(memory_bytes)
    os.write(held, f"{os.getpid()}\n".encode())  # from now on it can be asked to stop
    sys.stdin, sys.stdout, sys.stderr = (open(number, mode, closefd=False) for number, mode in enumerate("rww"))  # noqa: SIM115
    sys.argv = [module, *words]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    finally:
        atexit._run_exitfuncs()  # multiprocessing does not call them
