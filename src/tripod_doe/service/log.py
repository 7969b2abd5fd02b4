"""The log of the server on standard error: bounded in number and in length, without control characters.

Clients decide how often an error occurs and what its message holds; neither may fill a disk or control a terminal.
"""

import logging
import sys
import time
from collections.abc import Callable

from tripod_doe.errors import printable

MOST_ALIKE, MOST = 10, 200
"""Most messages in a minute: from one line of code, and in total."""

_MINUTE = 60.0
_LONGEST = 10_000  # characters of a message, with its traceback


class Bounded(logging.Filter):
    """Passes a limited number of messages per minute."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock, self._until = clock, -1.0
        self._counts: dict[tuple[str, int], int] = {}
        self._passed = self._held = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to pass a message; the first message of a minute also reports how many were held back before."""
        held = 0
        if self._clock() >= self._until:
            held, self._until = self._held, self._clock() + _MINUTE
            self._counts, self._passed, self._held = {}, 0, 0
        place = record.pathname, record.lineno
        self._counts[place] = self._counts.get(place, 0) + 1
        if self._passed >= MOST or self._counts[place] > MOST_ALIKE:
            self._held += 1
            return False
        self._passed += 1
        if held:
            record.msg, record.args = f"({held:,} more messages like those before)\n{record.getMessage()}", ()
        return True


class Plain(logging.Formatter):
    """Text of limited length in which control characters are written as escapes."""

    def format(self, record: logging.LogRecord) -> str:
        """The text of a message."""
        text = super().format(record)
        if len(text) > _LONGEST:
            text = f"{text[: _LONGEST // 2]}\n...\n{text[-_LONGEST // 2 :]}"
        return printable(text)


def start_log() -> None:
    """Send all warnings and errors of this process to standard error, bounded."""
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(Bounded())
    handler.setFormatter(Plain())
    logging.basicConfig(handlers=[handler], level=logging.WARNING, force=True)
