"""Notification that a run has ended: a command that is started, or a webhook that is called.

What is passed on is a few facts about the run: no token, no address of a page, no result. Names of runs come from
others, so they never become words of a command or a part of an address: they are in JSON on its standard input, or in
the body of the request. Nothing that goes wrong here changes how a run ends.
"""

import json
import logging
import shlex
import shutil
import subprocess
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

from tripod_doe.errors import InputError, option, printable
from tripod_doe.files.regular_files import private_text
from tripod_doe.http_opener import LOOPBACK, opener_for

_SECONDS = 30.0  # for a command, and for an answer of a webhook
_MOST_BYTES = 65_536  # of a file that holds a command or an address

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Notifier:
    """Where word goes: to a command, or to an address."""

    words: tuple[str, ...] = ()  # of a command, which no shell reads
    url: str = ""

    @classmethod
    def of(cls, text: str) -> Self:
        """The notifier that a user names: a command, an address, or @FILE with one of both.

        Raises:
            InputError: If there is no such program, the address is not encrypted, or others can read or change the
                file.
        """
        if text.startswith("@"):
            text = private_text(Path(text[1:]), _MOST_BYTES, option("notify", text)).partition("\n")[0].strip()
        if text.partition("://")[0].lower() in ("http", "https"):
            return cls(url=_checked_address(text))
        try:
            words = tuple(shlex.split(text))
        except ValueError as error:
            raise InputError(f"{option('notify')}: not a command: {error}") from error
        if not words or shutil.which(words[0]) is None:
            raise InputError(
                f"{option('notify')}: no program {words[0] if words else text!r}: give a command, an address "
                "https://..., or @FILE with one of both"
            )
        return cls(words)

    def tell(self, facts: Mapping[str, Any]) -> str:
        """Pass the facts on; gives what went wrong, empty where nothing did. It may take half a minute."""
        name, state = printable(str(facts.get("name", ""))), facts.get("state", "")
        message = printable(str(facts.get("message", "")))
        text = escape(f"{name}: {state}" + (f": {message}" if message else ""), quote=False)  # chats make links of <>
        data = json.dumps({"text": text, **facts}).encode()
        return self._call(data) if self.url else self._start(data)

    def tell_in_thread(self, facts: Mapping[str, Any]) -> None:
        """Pass the facts on in a thread of its own; what goes wrong is logged."""

        def tell() -> None:
            if trouble := self.tell(facts):
                log.warning("%s: %s", option("notify"), trouble)

        threading.Thread(target=tell, name="notify", daemon=True).start()

    def _start(self, data: bytes) -> str:
        try:
            done = subprocess.run(self.words, input=data, capture_output=True, timeout=_SECONDS, check=False)
        except subprocess.TimeoutExpired:
            return f"{self.words[0]} did not end within {_SECONDS:.0f} s"
        except OSError as error:
            return f"{self.words[0]}: {error.strerror}"
        last = (done.stderr or done.stdout).decode("utf-8", "replace").strip().splitlines()[-1:]
        return f"{self.words[0]} ended with {done.returncode}: {' '.join(last)[:200]}" if done.returncode else ""

    def _call(self, data: bytes) -> str:
        from urllib.error import HTTPError, URLError
        from urllib.request import Request

        host = urlsplit(self.url).hostname or ""
        request = Request(self.url, data, {"Content-Type": "application/json", "User-Agent": "tripod-doe"})
        try:
            opener_for(self.url).open(request, timeout=_SECONDS).close()
        except HTTPError as error:
            with error:
                return f"{host} answered {error.code}"
        except (URLError, OSError, ValueError) as error:
            return f"{host}: no answer ({getattr(error, 'reason', None) or type(error).__name__})"
        return ""


def _checked_address(text: str) -> str:
    try:
        parts = urlsplit(text)
        host = parts.hostname
    except ValueError:
        host = None
    if not host or not text.isprintable() or " " in text:
        raise InputError(f"{option('notify')}: not an address: write https://host/path")
    if parts.scheme != "https" and host not in LOOPBACK:
        raise InputError(f"{option('notify')}: {host}: an address of another machine begins with https://")
    return text
