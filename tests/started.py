"""Python programs in processes of their own, for tests of signals, kills, exit codes and streams."""

from __future__ import annotations

import os
import signal
import subprocess
import sys


class Process(subprocess.Popen):
    """A process of Python that leads a session of its own.

    Parameters
    ----------
    words
        As after `python`: ``-m module`` or the path of a script, and its arguments.
    environment
        Its environment variables; those of this process if omitted.
    quiet
        Whether its output is dropped.
    ignores_interrupts
        Whether it starts with interrupts ignored, as a shell's background jobs do.
    """

    def __init__(self, words, environment=None, quiet=False, ignores_interrupts=False):
        stream = subprocess.DEVNULL if quiet else subprocess.PIPE
        super().__init__(
            [sys.executable, *words],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            text=True,
            start_new_session=True,
            preexec_fn=_ignore_interrupts if ignores_interrupts else None,
        )

    def wait(self, timeout=60):
        return super().wait(timeout)

    def communicate(self, timeout=60):
        """The rest of its output; a process that takes longer is killed with its group."""
        try:
            return super().communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            os.killpg(self.pid, signal.SIGKILL)
            raise


def _ignore_interrupts():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
