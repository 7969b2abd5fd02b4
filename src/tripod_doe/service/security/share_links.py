"""Links that open one run for reading, until they expire or are revoked.

The file keeps only a hash of each link's secret, and is private: whoever reads it cannot open anything.
"""

import hashlib
import secrets
import stat
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from tripod_doe.errors import InputError
from tripod_doe.files.atomic_files import replace_text
from tripod_doe.files.regular_files import read_regular
from tripod_doe.service.problems import RefusedError

SHARES = "shares.json"
"""File of the folder with the shares."""

_MOST = 1_000
_DAY = 86_400.0
_LATEST = 7_000 * 366 * _DAY  # seconds after 1970; dates end with the year 9999
_UNREADABLE = (OSError, ValidationError, InputError)


@dataclass(frozen=True)
class Share:
    """A link to one run."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid")  # of rows of the file

    id: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]  # its public name, no secret
    run_id: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]  # hash of the secret in the link
    # created, expires: seconds since 1970
    created: Annotated[float, Field(ge=0, lt=_LATEST)]
    expires: Annotated[float, Field(ge=0, lt=_LATEST)]


_ROWS = TypeAdapter(list[Share])


class Shares:
    """The shares of a folder.

    Args:
        folder: Where their file is.
        clock: Seconds since 1970.

    Raises:
        InputError: If their file cannot be read.
    """

    def __init__(self, folder: Path, clock: Callable[[], float] = time.time) -> None:
        self._path, self._clock, self._lock = folder / SHARES, clock, threading.Lock()
        self._shares: dict[str, Share] = {}
        self._state = self._state_now()
        if self._state is not None:
            try:
                self._shares = self._read()
            except _UNREADABLE as error:
                reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else error
                raise InputError(
                    f"{self._path}: cannot read these links ({reason}); delete the file, which revokes all of them"
                ) from error

    def _read(self) -> dict[str, Share]:
        return {share.id: share for share in _ROWS.validate_json(read_regular(self._path), strict=True)}

    def _state_now(self) -> tuple[int, int] | None:
        """State that shows whether another server has written the file; None if there is no file."""
        try:
            state = self._path.stat()
        except OSError:
            return None
        return (state.st_ino, state.st_mtime_ns) if stat.S_ISREG(state.st_mode) else None

    def _known(self) -> dict[str, Share]:
        """All links that no server of the folder has revoked; empty if the file cannot be read."""
        state = self._state_now()
        if state != self._state:
            try:
                shares = self._read() if state else {}
            except _UNREADABLE:
                shares = {}
            self._shares, self._state = shares, state
        return self._shares

    def add(self, run_id: str, days: int) -> tuple[Share, str]:
        """Make a link to a run; gives its secret, which is not kept (RefusedError 413 if there are too many)."""
        secret, now = secrets.token_urlsafe(32), self._clock()
        share = Share(secrets.token_hex(8), run_id, _hash(secret), now, now + days * _DAY)
        with self._lock:
            left = {key: other for key, other in self._known().items() if other.expires > now}
            if len(left) >= _MOST:
                raise RefusedError(413, f"{_MOST:,} links are open, which is the limit: revoke some")
            self._store(left | {share.id: share})
        return share, secret

    def of(self, run_id: str) -> list[Share]:
        """The links to a run that are open."""
        return [share for share in self.open() if share.run_id == run_id]

    def revoke(self, run_id: str, share_id: str) -> None:
        """End a link at once; RefusedError 404 if this run has no such link."""
        with self._lock:
            known = self._known()
            share = known.get(share_id)
            if share is None or share.run_id != run_id:
                raise RefusedError(404, f"{share_id[:100]}: this run has no such link")
            self._store({key: other for key, other in known.items() if key != share_id})

    def by_secret(self, given: str) -> Share | None:
        """The open link with a secret; compares hashes, so that a better guess does not take longer."""
        digest = _hash(given)
        share = next((share for share in self._known().values() if share.digest == digest), None)
        return share if share and self.is_open(share.id) else None

    def is_open(self, share_id: str) -> bool:
        """Whether a link is neither revoked nor expired."""
        share = self._known().get(share_id)
        return share is not None and share.expires > self._clock()

    def open(self) -> list[Share]:
        """All links that are open."""
        now = self._clock()
        return [share for share in self._known().values() if share.expires > now]

    def _store(self, shares: dict[str, Share]) -> None:
        replace_text(self._path, _ROWS.dump_json(list(shares.values())).decode())
        self._shares, self._state = shares, self._state_now()


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()
