"""Processes forked from one that has imported what they need: workers of the service, and runs that outlive it."""

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

from tripod_doe.study.execution.child_process import shorten_temporary_folder

_MOST_FILES = 4096  # numbers of open files that a run closes

shorten_temporary_folder()
context = multiprocessing.get_context("forkserver")
context.set_forkserver_preload(["tripod_doe.cli.main", "tripod_doe.service.workers.preload"])


def start_process(target: Callable[..., None], *arguments: Any) -> BaseProcess:
    """Call a function in a new process, which ends with this one."""
    process = context.Process(target=target, args=arguments, daemon=True)
    process.start()
    return process


def end_fork_server() -> None:
    """End the process that forks now: by itself it would finish its imports first. Runs go on."""
    pid: int | None = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if pid is not None:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def start_program(
    module: str, words: Sequence[str], log: Path, lock: int, niceness: int, memory_bytes: int
) -> threading.Thread:
    """Run a module as a program in a process and a session of its own, which outlives this one.

    The process that forks may have to be started first, which takes seconds: a thread waits for that, and writes into
    the log if the program cannot be started.

    Args:
        module: Full name of the module.
        log: File for what it says.
        lock: An open file, closed here, into which the process writes its number and a line end; it holds it until it
            ends, and what it starts itself does not.
        niceness: How much later than others it gets its turn on a busy machine; see `os.nice`.
        memory_bytes: Address space of the process, and of each that it starts.

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
        process.start()
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
    """Make this process lead a session of its own, whose files are its owner's alone."""
    os.setsid()
    os.umask(0o077)


def limit_memory(size: int) -> None:
    """Limit the address space of this process and of those that it starts, in bytes; a lower limit stays."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    size = size if most == resource.RLIM_INFINITY else min(size, most)
    resource.setrlimit(resource.RLIMIT_AS, (size, size))


def _detach(module: str, words: list[str], log: str, lock: Any, niceness: int, memory_bytes: int) -> None:
    """Fork once more: the process that multiprocessing knows, and waits for, ends here."""
    held = lock.detach()
    if os.fork():
        return
    lead_group()
    stream = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW)
    for number, file in enumerate((os.open(os.devnull, os.O_RDONLY), stream, stream)):
        os.dup2(file, number)
    os.closerange(3, held)  # the fork server goes on as long as anybody keeps its files
    os.closerange(held + 1, _MOST_FILES)
    os.set_inheritable(held, False)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which the fork server ignores
    os.nice(niceness)
    limit_memory(memory_bytes)
    os.write(held, f"{os.getpid()}\n".encode())  # from now on it can be asked to stop
    sys.stdin, sys.stdout, sys.stderr = (open(number, mode, closefd=False) for number, mode in enumerate("rww"))  # noqa: SIM115
    sys.argv = [module, *words]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    finally:
        atexit._run_exitfuncs()  # which multiprocessing leaves out
