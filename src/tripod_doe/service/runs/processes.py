"""The processes of runs: start them so that they outlive the server, find them again, stop them.

A run holds an open file that is locked before it starts. The lock ends with the process, however the process ends, so
it shows this server and the next one reliably whether the run is alive. The file holds the number of the process.

Why not the lock of the result directory (`DirectoryLock`): a run takes that lock seconds after its start, and the
file that the run inherits would already hold that lock.
"""

import fcntl
import os
import re
import shlex
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import psutil

from tripod_doe.errors import InputError
from tripod_doe.files.regular_files import open_locked, opened_regular, read_regular
from tripod_doe.service.requests.uploads import UPLOAD, main_file
from tripod_doe.service.runs.run_table import Run
from tripod_doe.service.workers.forking import start_program

_COMMANDS = {"study": "run", "workflow": "workflow", "fit": "fit", "optimisation": "optimise"}

LOG = "run.log"
"""Log of the latest run, a file of the result directory."""

_ALIVE = ".alive"
_NICE = 5  # answers have priority over points: a page must not wait for a study
_TRIES, _PAUSE = 20, 0.05
_LAST_BYTES = 65_536
_LONGEST_NUMBER = 20  # bytes
_PROGRESS = re.compile(r"[\d,]+ of [\d,]+ points? \(|(fit|optimise): .* points$|[\w-]+: (running|finished)")


def start_run(directory: Path, words: Sequence[str], memory_bytes: int) -> None:
    """Start our own command line on a result directory, in a session of its own.

    Args:
        directory: The result directory; the lock and the log are made in it.
        words: Arguments of ``tripod-doe``; they name the directory after ``--out``.
        memory_bytes: Address space of each of its processes.

    Raises:
        InputError: If a run of this directory is alive, or it cannot be started.
    """
    try:
        lock = open_locked(directory / _ALIVE, os.O_CREAT | os.O_RDWR)
        os.fchmod(lock, 0o600)  # whoever can open the file can lock it
    except OSError as error:
        raise InputError(f"{directory}: cannot write here: {error.strerror}") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.ftruncate(lock, 0)  # the number of an earlier run
        os.close(open_locked(directory / LOG, os.O_CREAT | os.O_WRONLY | os.O_TRUNC))
    except BlockingIOError as error:
        os.close(lock)
        raise InputError(f"{directory}: a run is at work here") from error
    except OSError as error:
        os.close(lock)
        raise InputError(f"{directory}: cannot start a run here: {error.strerror}") from error
    start_program("tripod_doe.cli", words, directory / LOG, lock, _NICE, memory_bytes)


def is_alive(directory: Path) -> bool:
    """Whether a run that this service or an earlier one started is alive."""
    return _locked(directory / _ALIVE)


def was_begun(directory: Path) -> bool:
    """Whether the latest start in a directory got as far as a process."""
    try:
        return bool(read_regular(directory / _ALIVE, _LONGEST_NUMBER))
    except (OSError, InputError):
        return False


def is_held(directory: Path) -> bool:
    """Whether any process computes into a result directory, including a process started by hand."""
    return is_alive(directory) or has_begun(directory)


def has_begun(directory: Path) -> bool:
    """Whether a process holds a result directory: it computes, or makes cube, analyses and report."""
    return _locked(directory / ".lock")


def _locked(path: Path) -> bool:
    try:
        probe = open_locked(path)
    except OSError:
        return False
    try:
        fcntl.flock(probe, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(probe)
    return False


def stop_run(directory: Path) -> bool:
    """Ask the run of a directory to end after its current points, as Ctrl-C does; return whether it has a run."""
    return _signal(directory, signal.SIGINT)


def kill_run(directory: Path) -> bool:
    """Kill the run of a directory and all processes that it started; return whether it has a run."""
    return _signal(directory, signal.SIGKILL)


def _signal(directory: Path, number: signal.Signals) -> bool:
    for _ in range(_TRIES):
        if process := run_process(directory):
            with suppress(ProcessLookupError, PermissionError):
                if number is signal.SIGKILL:
                    os.killpg(process, number)  # it leads a group of its own
                else:
                    os.kill(process, number)
            return True
        if not is_alive(directory):
            return False
        time.sleep(_PAUSE)  # a new process has not written its number yet
    return False


def run_process(directory: Path) -> int | None:
    """Number of the process that runs our command line on a directory; None if unknown.

    The number is in the lock file. While the process keeps this file open, no other process has the number.
    """
    path = directory.absolute() / _ALIVE
    try:
        process = int(read_regular(path, _LONGEST_NUMBER) or 0)
        if process and str(path.resolve()) in {file.path for file in psutil.Process(process).open_files()}:
            return process
    except (OSError, ValueError, InputError, psutil.Error):
        pass
    return None


def run_log(directory: Path) -> str:
    """Log of the latest run of a directory, or only the end of a long log; leaves out the directory's path."""
    try:
        with opened_regular(directory / LOG, sys.maxsize) as log:
            log.seek(0, os.SEEK_END)
            log.seek(max(0, log.tell() - _LAST_BYTES))
            text = log.read().decode("utf-8", "replace")
    except (OSError, InputError):
        return ""
    for word, replacement in (
        (f"--out {shlex.quote(str(directory))}", "the folder of this run"),
        (" or choose another --out", ""),
        (" or choose another directory", ""),
    ):
        text = text.replace(word, replacement)
    return text.replace(f"{directory}{os.sep}", "").replace(str(directory), "")


def last_words(directory: Path) -> str:
    """The last complaint of the latest run of a directory, or else its last line that is no progress."""
    lines = [line.strip() for line in run_log(directory).splitlines() if line.strip() and not _PROGRESS.match(line)]
    own = [line.removeprefix("tripod-doe: ") for line in lines if line.startswith("tripod-doe: ")]
    return (own or lines or [""])[-1]


def run_words(run: Run, directory: Path, workers: int | None) -> list[str]:
    """The command line of a run."""
    words = [_COMMANDS[run.kind], str(directory / UPLOAD / main_file(run.kind)), "--out", str(directory), "--untrusted"]
    if workers is not None:
        words += ["--workers", str(workers)]
    return [*words, "--retry-failed"] if run.retry_failed else words
