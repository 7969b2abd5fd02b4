"""Modules of this package run as programs of their own, which answer a running study over standard output.

Python's multiprocessing imports the parent's main module in each child. A script without a guard would run again in
every child; standard input or a notebook cannot be imported. Children that start here have a main module of this
package, whose import has no effect.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from typing import IO

_NO_LEAKS = "ignore::UserWarning:multiprocessing.resource_tracker"  # the system frees what a child that is killed had
_LONGEST_FOLDER = 70  # bytes: names of sockets have 107, of which multiprocessing adds 32


def start_child(module: str, *words: str) -> subprocess.Popen[str]:
    """Start a module as a program with piped standard input and output."""
    return subprocess.Popen(
        command(module, *words), stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment(), text=True
    )


def command(module: str, *words: str) -> list[str]:
    """The command that runs a module of this package as a program."""
    return [sys.executable, "-P", "-W", _NO_LEAKS, "-m", module, *words]


def environment() -> dict[str, str]:
    """The environment of this process, with its import path, so that a program finds the same functions."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(place or os.getcwd() for place in sys.path)}


def answers() -> IO[str]:
    """In a child: the stream to the process that started it; output of functions goes to standard error from now on.

    Ctrl-C reaches all processes of a terminal: the parent decides when its children end.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stream = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return stream


def shorten_temporary_folder() -> None:
    """Use /tmp for temporary files if the usual folder's path is too long for sockets in it.

    Schedulers of jobs make such long folders; multiprocessing's fork server then fails with "AF_UNIX path too long".
    """
    if len(os.fsencode(tempfile.gettempdir())) > _LONGEST_FOLDER:
        tempfile.tempdir = "/tmp"
