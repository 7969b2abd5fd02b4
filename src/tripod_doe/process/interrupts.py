"""Interrupts (Ctrl-C): the first stops a command where it is, or at its next look at the latest; the second ends it.

Python raises KeyboardInterrupt wherever the main thread happens to be. Where that is a callback of the garbage
collector, of a weak reference or a destructor, the exception is printed and dropped: about one in 700 interrupts at
random moments of a study met Dask's callback of the garbage collector, and the study ran on. So an interrupt is also
noted, and what takes long looks at the note.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

INTERRUPTED = 130
"""Exit code of an interrupted command, as shells know it: 128 and the number of the signal."""

_noted = threading.Event()


def check_interrupt() -> None:
    """Raise an interrupt that Python dropped; called between blocks of points and between steps.

    Raises:
        KeyboardInterrupt: If one came; never where `take_interrupts` was not called.
    """
    if _noted.is_set():
        raise KeyboardInterrupt


def take_interrupts() -> None:
    """From now on note interrupts of this process and raise them, also if it was started to ignore them."""
    signal.signal(signal.SIGINT, _interrupt)


def leave_interrupted() -> None:
    """End this process if it was interrupted, past all exit handlers; to be called when everything is closed.

    Dask's exit handlers complain of workers that were just starting, and while Python ends, a second interrupt would
    change the exit code. Worker processes end with the one that started them.
    """
    if _noted.is_set():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(INTERRUPTED)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _noted.is_set():  # the journal survives any end
        os.write(2, b"tripod-doe: interrupted again, ended at once; finished points are kept\n")
        os._exit(INTERRUPTED)
    _noted.set()
    raise KeyboardInterrupt
