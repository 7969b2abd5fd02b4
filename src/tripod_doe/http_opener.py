"""How this package asks servers: no redirection is followed, since addresses and headers may hold a secret."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from urllib.request import OpenerDirector

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names of this machine for itself."""


def opener_for(url: str) -> OpenerDirector:
    """An opener for a server, which asks one on this machine without a proxy."""
    from urllib.request import HTTPRedirectHandler, ProxyHandler, build_opener  # later: it costs the start of commands

    class NoRedirection(HTTPRedirectHandler):
        """Another server must not get the secret: a redirection is an answer like any other."""

        def redirect_request(self, *words: Any, **named: Any) -> None:
            """Follow nothing."""

    return build_opener(NoRedirection(), *([ProxyHandler({})] if urlsplit(url).hostname in LOOPBACK else []))
