"""What a server is started with."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from pathlib import Path

from tripod_doe.atomic_files import replace_file
from tripod_doe.errors import InputError, option
from tripod_doe.service.limits import Limits

_SHORTEST_TOKEN = 16


@dataclass(frozen=True)
class Settings:
    """A server's settings."""

    folder: Path  # where the table of runs and the result directories are
    # host, port: where it listens
    host: str = "127.0.0.1"
    port: int = 8811
    workers: int | None = None  # worker processes of each run; None leaves it to the run
    read_only: bool = False  # whether all changes are refused, and nothing is run
    demo: bool = False  # whether a small finished study is put into the list
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32), repr=False)  # what a client must know
    limits: Limits = field(default_factory=Limits)  # what it takes
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16), repr=False)  # of its addresses; see `sessions`
    cookie: str = field(default_factory=lambda: f"tripod_doe_{secrets.token_hex(4)}")  # its name: ports share cookies

    @property
    def root(self) -> str:
        """First part of the addresses of its pages."""
        return f"/s-{self.key}"


def read_token(path: Path) -> str:
    """The token in a file; a file that is not there is made, readable for its owner alone.

    Raises
    ------
    InputError
        If the file cannot be read or made, or holds no usable token.
    """
    try:
        if not path.exists():
            with replace_file(path) as fresh:
                fresh.touch(mode=0o600)
                fresh.write_text(secrets.token_urlsafe(32) + "\n", encoding="ascii")
        token = path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not ASCII text"
        raise InputError(f"{option('token_file', str(path))}: cannot use this file: {reason}") from error
    if len(token) < _SHORTEST_TOKEN or not all(letter.isalnum() or letter in "-_" for letter in token):
        raise InputError(
            f"{option('token_file', str(path))}: a token has at least {_SHORTEST_TOKEN} letters, digits, - and _"
        )
    return token
