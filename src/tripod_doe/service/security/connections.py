"""Limits of connections that uvicorn lacks: times for headers, bodies and answers, sizes of headers, and their number.

uvicorn ends a connection that idles after an answer, and refuses requests beyond `limit_concurrency` once their headers
are complete. A client that never completes them, sends a byte from time to time, or does not read what it is sent keeps
its connection for ever, and with it one of the files that the process may have open. A proxy in front of the server
would do the same; a server for one machine should not need one.
"""

from __future__ import annotations

import asyncio
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from itertools import chain
from typing import Any

from starlette.types import Scope
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

HEADER_SECONDS = 10.0
"""From the first byte of a connection, or of its next request, to the end of the headers."""

BODY_SECONDS, BODY_RATE = 10.0, 16_384
"""A body arrives within these seconds and one more for as many bytes as the rate says."""

_CONNECTION = "connection"  # name in the state of a request
_READ_SECONDS = 60.0  # without anything read of an answer
_HEADER_BYTES = 65_536
_LEAST_FILES = 64  # kept for everything but connections


def left_of(scope: Scope) -> threading.Event | None:
    """The event that is set when the client of a request leaves; None without a connection of this server."""
    connection = _connection_of(scope)
    return connection.left if connection is not None else None


@contextmanager
def giving_way(scope: Scope) -> Iterator[None]:
    """Within this block, the connection of a request makes room for a new one where there are too many."""
    connection = _connection_of(scope)
    if connection is None:
        yield
        return
    connection.missed_by_nobody[connection] = None
    try:
        yield
    finally:
        connection.missed_by_nobody.pop(connection, None)


def _connection_of(scope: Scope) -> LimitedProtocol | None:
    state: dict[str, Any] = scope.get("state", {})
    return state.get(_CONNECTION)


class LimitedProtocol(HttpToolsProtocol):
    """One connection of a client."""

    most = 1_000
    """Connections at the same time."""

    waiting: dict[LimitedProtocol, None]
    """Those whose headers are still to come, the oldest first: it makes room for a new connection."""

    unread: dict[LimitedProtocol, None]
    """Those whose clients do not read their answers, the oldest first: these make room before all others."""

    missed_by_nobody: dict[LimitedProtocol, None]
    """Those that idle after an answer, or wait for one without access, the oldest first: these make room next."""

    def __init__(self, *words: Any, **options: Any) -> None:
        super().__init__(*words, **options)
        self._headers_due: asyncio.TimerHandle | None = None
        self._answer_due: asyncio.TimerHandle | None = None
        self._header_bytes = 0
        self.left = threading.Event()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, or refuse it where there are too many."""
        super().connection_made(transport)
        full = len(self.connections) > self.most
        oldest = next(iter(self.waiting), self) if full else None
        self._await_headers()
        if full and (given_up := next(chain(self.unread, self.missed_by_nobody), None)):
            given_up.transport.abort()
        elif oldest is not None:
            oldest._refuse(
                HTTPStatus.SERVICE_UNAVAILABLE, f"{self.most:,} connections are open, which is the limit here"
            )

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self.left.set()
        self._stop_clocks()
        self.missed_by_nobody.pop(self, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read some bytes."""
        if self.transport.is_closing():
            return
        if self._is_between_requests():
            self.missed_by_nobody.pop(self, None)
            if self._headers_due is None:
                self._await_headers()
        if self._headers_due is not None:
            self._header_bytes += len(data)
        super().data_received(data)
        if self._headers_due is not None and self._header_bytes > _HEADER_BYTES:
            self._refuse_headers()

    def on_headers_complete(self) -> None:
        """Begin to answer a request whose headers are there."""
        self._stop_headers_clock()
        if len(self.url) + sum(len(name) + len(value) + 4 for name, value in self.headers) > _HEADER_BYTES:
            self._refuse_headers()
            raise ValueError("the headers are too large")  # ends the parser
        self.scope["state"][_CONNECTION] = self
        super().on_headers_complete()

    def on_response_complete(self) -> None:
        """End the connection where the rest of a body is still to come."""
        if self.cycle is not None and self.cycle.more_body and not self.pipeline:
            self.transport.close()
        super().on_response_complete()
        if self._is_between_requests() and not self.transport.is_closing():
            self.missed_by_nobody[self] = None

    def send_400_response(self, msg: str) -> None:
        """Refuse an invalid request, once."""
        self._stop_clocks()
        if not self.transport.is_closing():
            super().send_400_response(msg)

    def pause_writing(self) -> None:
        """Wait for the client to read, for a limited time."""
        super().pause_writing()
        self.unread[self] = None
        self._answer_due = self.loop.call_later(_READ_SECONDS, self.transport.abort)

    def resume_writing(self) -> None:
        """Continue."""
        self._stop_answer_clock()
        super().resume_writing()

    def _is_between_requests(self) -> bool:
        return self.cycle is None or (self.cycle.response_complete and not self.cycle.more_body)

    def _await_headers(self) -> None:
        self._header_bytes = 0
        self.waiting[self] = None
        self._headers_due = self.loop.call_later(HEADER_SECONDS, self._refuse_slow)

    def _refuse_slow(self) -> None:
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, f"the headers did not arrive within {HEADER_SECONDS:.0f} s")

    def _refuse_headers(self) -> None:
        what = HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
        self._refuse(what, f"address and headers are larger than {_HEADER_BYTES:,} bytes, which is the limit here")

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Answer with the reason, and end the connection."""
        self._stop_clocks()
        if self.transport.is_closing():
            return
        body = f'{{"errors": [{{"message": "{text}"}}]}}'.encode()
        head = (
            f"HTTP/1.1 {status.value} {status.phrase}\r\ncontent-type: application/json\r\n"
            f"content-length: {len(body)}\r\nconnection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()

    def _stop_headers_clock(self) -> None:
        self.waiting.pop(self, None)
        if self._headers_due is not None:
            self._headers_due.cancel()
            self._headers_due = None

    def _stop_answer_clock(self) -> None:
        self.unread.pop(self, None)
        if self._answer_due is not None:
            self._answer_due.cancel()
            self._answer_due = None

    def _stop_clocks(self) -> None:
        self._stop_headers_clock()
        self._stop_answer_clock()


def limited_protocol(wanted: int) -> type[LimitedProtocol]:
    """The protocol of a server with a largest number of connections, fewer where the system allows fewer open files."""
    files, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    need = wanted + max(_LEAST_FILES, wanted // 4)
    if files != resource.RLIM_INFINITY and files < need:
        files = need if most == resource.RLIM_INFINITY else min(need, most)
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, most))
        wanted = min(wanted, max(1, files - max(_LEAST_FILES, files // 4)))
    return type("Protocol", (LimitedProtocol,), {"most": wanted, "waiting": {}, "unread": {}, "missed_by_nobody": {}})
