"""Changes of runs for open streams: each change is written once and given to all open streams."""

import asyncio
import json
import secrets
import threading
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import dataclass
from itertools import takewhile

from tripod_doe.service.runs.run_table import Run

_KEPT = 512  # events kept for streams that reconnect, each with the whole note of its run


@dataclass(frozen=True)
class Event:
    """A change of one run."""

    number: int  # counted from the start of the server
    run_id: str  # the run
    text: str | None  # the run as JSON; None if it was deleted


class Events:
    """The latest changes of all runs, published from any thread and watched from the event loop."""

    def __init__(self) -> None:
        self._boot = secrets.token_hex(4)
        self._events: deque[Event] = deque(maxlen=_KEPT)
        self._latest: dict[str, Event] = {}
        self._count = 0
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: set[asyncio.Event] = set()
        self.closing = False
        self.streams = 0  # admitted and not ended; changed in the event loop only

    def latest(self, run_id: str) -> str:
        """A run as JSON, as last published."""
        event = self._latest.get(run_id)
        return event.text if event and event.text else ""

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Name the loop in which streams wait."""
        self._loop = loop

    def publish(self, run: Run) -> None:
        """Announce that a run changed."""
        self._append(run.id, json.dumps(run.record(), allow_nan=False))

    def forget(self, run_id: str) -> None:
        """Announce that a run was deleted."""
        self._append(run_id, None)

    def close(self) -> None:
        """End all streams."""
        self.closing = True
        self._wake()

    def _append(self, run_id: str, text: str | None) -> None:
        with self._lock:
            self._count += 1
            event = Event(self._count, run_id, text)
            self._events.append(event)
            if text is None:
                self._latest.pop(run_id, None)
            else:
                self._latest[run_id] = event
        self._wake()

    def _wake(self) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._set_all)

    def _set_all(self) -> None:
        for waiting in self._waiting:
            waiting.set()

    def newest(self) -> str:
        """The id of the newest event: a stream that starts after it gets only later events."""
        return f"{self._boot}-{self._count}"

    def name_of(self, event: Event) -> str:
        """The event's id, as Last-Event-ID gives it back."""
        return f"{self._boot}-{event.number}"

    async def watch(self, run_id: str | None, last_id: str | None, pause: float) -> AsyncIterator[Event | None]:
        """Events of a run, or of all runs: first all after `last_id`, or the latest of each run, then all new ones.

        Args:
            run_id: The run; None for all.
            last_id: The id of the last event that the client has seen, None for a new one.
            pause: Seconds of silence after which None is given, so that the client and proxies see a heartbeat.
        """
        woken = asyncio.Event()
        self._waiting.add(woken)
        seen = self._number_in(last_id)
        try:
            while not self.closing:
                woken.clear()
                fresh, seen = self._since(seen, run_id)
                for event in fresh:
                    yield event
                    if event.text is None and run_id is not None:
                        return
                if not fresh:
                    try:
                        await asyncio.wait_for(woken.wait(), pause)
                    except TimeoutError:
                        yield None
        finally:
            self._waiting.discard(woken)

    def _number_in(self, last_id: str | None) -> int | None:
        """Number of the last event that a client has seen; None if another server made the id, or it is invalid."""
        boot, _, number = (last_id or "").partition("-")
        return int(number) if boot == self._boot and number.isdecimal() and len(number) < 20 else None

    def _since(self, seen: int | None, run_id: str | None) -> tuple[list[Event], int]:
        """Events after event `seen`, and the newest number; the latest event of each run if some are no longer kept."""
        with self._lock:
            oldest = self._events[0].number if self._events else self._count + 1
            if seen is None or seen < oldest - 1:
                fresh = sorted(self._latest.values(), key=lambda event: event.number)
            else:
                newer = takewhile(lambda event: event.number > seen, reversed(self._events))
                fresh = list(newer)[::-1]
            return [event for event in fresh if run_id in (None, event.run_id)], self._count
