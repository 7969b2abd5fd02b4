"""Sessions of browsers: a cookie that is useless outside the addresses of this server.

Browsers send a cookie to every port of a host, so another server on this machine sees it as soon as somebody opens a
page of that server; and a program with the cookie can imitate any header of a browser. So a session needs two secrets:
the cookie, and the first part of every page's address (`Settings.root`), which is random and new at each start. The
cookie's path is that part: a browser does not send the cookie to an address without it, whatever the port.
Navigation, images, event streams and downloads send both secrets without a script.
"""

import hashlib
import secrets
import threading
import time
from collections.abc import Callable

LIFETIME = 12 * 3600
"""Seconds from signing in to the end of a session."""

_MOST = 200  # sessions per access at the same time: a new one ends the oldest


class Sessions:
    """Browsers that have shown a token."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # end and access by the cookie's hash: a better guess does not take longer to compare
        self._ends: dict[bytes, tuple[float, str]] = {}
        self._closed = False
        self._lock = threading.Lock()

    def open(self, access: str) -> str:
        """Start a session of the access with this name; return the value of its cookie."""
        value = secrets.token_urlsafe(32)
        with self._lock:
            now = self._clock()
            self._ends = {key: end for key, end in self._ends.items() if end[0] > now}
            own = [key for key, (_, of) in self._ends.items() if of == access]
            if len(own) >= _MOST:  # only its own: a link's user must not sign the owner out
                del self._ends[own[0]]
            if not self._closed:
                self._ends[_hash(value)] = now + LIFETIME, access
        return value

    def is_open(self, value: str, access: str) -> bool:
        """Whether a cookie's value belongs to an open session of an access."""
        ends, of = self._ends.get(_hash(value), (0.0, ""))
        return of == access and ends > self._clock()

    def close(self) -> None:
        """End all sessions, and start no more."""
        with self._lock:
            self._closed = True
            self._ends = {}


def _hash(value: str) -> bytes:
    return hashlib.sha256(value.encode("utf-8", "surrogateescape")).digest()
