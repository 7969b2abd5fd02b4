"""Settings of a server."""

import os
import re
import secrets
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tripod_doe.errors import InputError, option
from tripod_doe.files.regular_files import private_text
from tripod_doe.notification import Notifier
from tripod_doe.service.limits import Limits

FIRST_PART = "/s-"
"""How the first part of the addresses of pages begins; the rest is a key."""

_SHORTEST_TOKEN, _LONGEST_TOKEN = 16, 4096


@dataclass(frozen=True)
class Settings:
    """A server's settings."""

    folder: Path  # where the table of runs and the result directories are
    # host, port: where it listens
    host: str = "127.0.0.1"
    port: int = 8811
    workers: int | None = None  # worker processes of each run; None leaves it to the run
    read_only: bool = False  # whether to refuse all changes, and run nothing
    demo: bool = False  # whether a small finished study is put into the list
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)  # secret that a client must send
    read_token: str = field(default="", repr=False)  # token for clients who only read; empty without one
    notifier: Notifier | None = field(default=None, repr=False)  # notifies somebody when a run ends
    only_run: str = ""  # the one run that a link opens; empty for all others
    limits: Limits = field(default_factory=Limits)  # limits of requests and runs
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16), repr=False)  # of its addresses; see `sessions`
    cookie: str = field(default_factory=lambda: f"tripod_doe_{secrets.token_hex(4)}")  # its name: ports share cookies

    @property
    def root(self) -> str:
        """First part of the addresses of its pages."""
        return f"{FIRST_PART}{self.key}"


def read_token(path: Path) -> str:
    """The token in a file; makes a missing file, readable for its owner alone.

    Raises:
        InputError: If the file cannot be read or made, is open to other users, or holds no usable token.
    """
    named = option("token_file", str(path))
    try:
        if not path.exists():
            _make_token(path)
    except OSError as error:
        raise InputError(f"{named}: cannot make this file: {error.strerror}") from error
    token = private_text(path, _LONGEST_TOKEN, named).strip()
    if len(token) < _SHORTEST_TOKEN or not re.fullmatch(r"[\w-]+", token, re.ASCII):
        raise InputError(f"{named}: a token has at least {_SHORTEST_TOKEN} letters, digits, - and _")
    return token


def _make_token(path: Path) -> None:
    """Make a file with a new token; a file that another process makes meanwhile stays, and is then checked as usual."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError), open(path, "x", encoding="ascii", opener=partial(os.open, mode=0o600)) as stream:
        stream.write(secrets.token_urlsafe(32) + "\n")
