"""Who asks, and what is open to them: the owner, readers with a token of their own, and links to one run.

Each client's addresses begin with a secret part: whoever knew it could make the client's browser send its cookie to
another server (`sessions`). Keys to pages of reports also depend on this part, and expire with it.
"""

import base64
import hashlib
import hmac
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.security.share_links import Shares
from tripod_doe.service.settings import FIRST_PART, Settings

_READER = "reader"

_SAFE = ("GET", "HEAD", "OPTIONS")
_ONE_RUN = r"(/api/v1/runs|(/api/v1|/parts)?/runs/{}(/.*)?)"
"""Addresses that a link opens, besides scripts and styles; the list of runs then shows this run alone."""


@dataclass(frozen=True)
class Access:
    """What one kind of client may do."""

    name: str  # owner, reader, or the id of a share
    settings: Settings  # of the server as this client sees it
    owns: bool = False  # whether it is the owner's
    is_open: Callable[[], bool] = lambda: True  # False once the access has ended

    def check(self, method: str, place: str) -> None:
        """Refuse (403) an address that this client may not use.

        Args:
            place: The address without the first part.
        """
        if self.settings.read_only and method not in _SAFE:
            raise RefusedError(403, "this server or this token is read-only: it changes nothing and computes nothing")
        if self.settings.only_run and not re.fullmatch(_ONE_RUN.format(re.escape(self.settings.only_run)), place):
            raise RefusedError(403, "this link opens one run and nothing else")


class Accesses:
    """All accesses: the owner, readers and links.

    Args:
        settings: Of the server.
        shares: Its links to single runs.
    """

    def __init__(self, settings: Settings, shares: Shares) -> None:
        self._settings, self._shares = settings, shares
        self._of_shares: dict[tuple[str, str], Access] = {}  # cached: each request is compared with all of them
        self.owner = Access("owner", settings, owns=True)
        self._reader = Access(_READER, self._seen(_READER)) if settings.read_token else None

    def by_token(self, given: str) -> Access | None:
        """The access of a token or of a link's secret; None if it is wrong."""
        if _equal(given, self._settings.token):
            return self.owner
        if self._reader and _equal(given, self._settings.read_token):
            return self._reader
        share = self._shares.by_secret(given)
        return self._of_share(share.id, share.run_id) if share else None

    def by_first_part(self, part: str) -> Access | None:
        """The access with this first part of addresses."""
        if not part.startswith(FIRST_PART):
            return None
        return next((access for access in self._all() if _equal(part, access.settings.root)), None)

    def by_report(self, place: str) -> Access | None:
        """The access whose key is in the address of a report's page."""
        return next((access for access in self._all() if is_report_address(place, access.settings)), None)

    def _all(self) -> Iterator[Access]:
        yield self.owner
        if self._reader:
            yield self._reader
        for share in self._shares.open():
            yield self._of_share(share.id, share.run_id)

    def _of_share(self, share_id: str, run_id: str) -> Access:
        if (share_id, run_id) not in self._of_shares:
            seen = self._seen(share_id, run_id)
            access = Access(share_id, seen, is_open=lambda: self._shares.is_open(share_id))
            self._of_shares[share_id, run_id] = access
        return self._of_shares[share_id, run_id]

    def _seen(self, name: str, only_run: str = "") -> Settings:
        digest = hmac.new(self._settings.key.encode(), name.encode(), hashlib.sha256).digest()
        key = base64.urlsafe_b64encode(digest[:16]).decode().rstrip("=")  # as long as the server's
        return replace(self._settings, key=key, read_only=True, only_run=only_run)


def _equal(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), secret.encode())


_ADDRESS = re.compile(r"/api/v1/runs/([^/]+)/pages/([0-9a-f]{32})/.+")


def report_key(settings: Settings, run_id: str) -> str:
    """The key to the pages of one run, valid until the server ends."""
    return hmac.new(settings.token.encode(), f"{settings.key} {run_id}".encode(), hashlib.sha256).hexdigest()[:32]


def is_report_address(path: str, settings: Settings) -> bool:
    """Whether an address leads to a page with the right key."""
    match = _ADDRESS.fullmatch(path)
    return match is not None and hmac.compare_digest(match[2], report_key(settings, match[1]))
