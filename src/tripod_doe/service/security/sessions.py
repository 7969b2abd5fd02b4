"""Sessions of browsers: a cookie that is worth nothing outside the addresses of this server.

Browsers send a cookie to every port of a host, so another server on this machine sees a cookie as soon as somebody
opens one of its pages; and whatever headers a browser adds, a program that has the cookie can add, too. Two secrets are
therefore needed together: the cookie, and the first part of the address of every page (`Settings.root`), which is
random and made at each start. The cookie is bound to that part by its path: a browser does not send it to an address
without it, whatever the port. Navigation, images, event streams and downloads present both without a script.
"""

import hashlib
import secrets
import threading
import time
from collections.abc import Callable

LIFETIME = 12 * 3600
"""Seconds from signing in to the end of a session."""

_MOST = 200  # sessions of one access at the same time: its oldest ends for a new one


class Sessions:
    """Browsers that have shown a token."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        # end and access by a hash: no comparison of secrets takes more time for a better guess
        self._ends: dict[bytes, tuple[float, str]] = {}
        self._closed = False
        self._lock = threading.Lock()

    def open(self, access: str) -> str:
        """Begin a session of an access, by its name; gives the value of its cookie."""
        value = secrets.token_urlsafe(32)
        with self._lock:
            now = self._clock()
            self._ends = {key: end for key, end in self._ends.items() if end[0] > now}
            own = [key for key, (_, of) in self._ends.items() if of == access]
            if len(own) >= _MOST:  # of others none ends: who has a link must not sign the owner out
                del self._ends[own[0]]
            if not self._closed:
                self._ends[_hash(value)] = now + LIFETIME, access
        return value

    def is_open(self, value: str, access: str) -> bool:
        """Whether a cookie's value belongs to an open session of an access."""
        ends, of = self._ends.get(_hash(value), (0.0, ""))
        return of == access and ends > self._clock()

    def close(self) -> None:
        """End all sessions, and begin no more."""
        with self._lock:
            self._closed = True
            self._ends = {}


def _hash(value: str) -> bytes:
    return hashlib.sha256(value.encode("utf-8", "surrogateescape")).digest()
