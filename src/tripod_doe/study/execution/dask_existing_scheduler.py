"""An existing Dask scheduler: its address or file, its credentials, and the time to wait for it when it is lost."""

from __future__ import annotations

import json
import os
import socket
import ssl
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import SplitResult, urlsplit

from tripod_doe.errors import InputError, TripodDoeError, option
from tripod_doe.files.regular_files import read_regular, refuse_irregular
from tripod_doe.number_text import duration

if TYPE_CHECKING:  # Dask takes a second to import
    from distributed import Client
    from distributed.security import Security

USUAL_WAIT = 60.0
"""Seconds for which a study waits for a lost scheduler by default."""

_TCP, _TLS = "tcp://", "tls://"
_ATTEMPT = 5.0  # seconds for one
_PAUSES = (0.5, 10.0)  # seconds between two attempts: the first, doubled up to the last


@dataclass(frozen=True)
class TlsFiles:
    """Credentials in PEM files, as the options of ``dask worker`` name them."""

    ca_file: Path  # certificate of the authority that signed the scheduler's
    cert: Path  # certificate of this client
    key: Path | None = None  # its key; None where it is in the file of the certificate

    def security(self) -> Security:
        """The credentials for a client of Dask; InputError if a file cannot be used."""
        from distributed.security import Security

        files = {"tls_ca_file": self.ca_file, "tls_cert": self.cert, "tls_key": self.key}
        for name, file in files.items():
            if file is not None and not os.access(file, os.R_OK):
                raise InputError(f"{option(name, str(file))}: there is no such file, or it cannot be read")
            if file is not None:
                refuse_irregular(file)
        security = Security(
            require_encryption=True,
            tls_ca_file=str(self.ca_file),
            tls_client_cert=str(self.cert),
            tls_client_key=str(self.key) if self.key else None,
        )
        try:
            security.get_connection_args("client")
        except OSError as error:  # SSLError is one
            shown = ", ".join(option(name, str(file)) for name, file in files.items() if file is not None)
            raise InputError(f"{shown}: cannot be used for TLS: {error}") from error
        return security


def tls_files(ca_file: str | Path | None, cert: str | Path | None, key: str | Path | None) -> TlsFiles | None:
    """Credentials from the given files; None without any.

    Raises:
        InputError: If the authority's certificate or the client's is missing.
    """
    if not (ca_file or cert or key):
        return None
    if not (ca_file and cert):
        raise InputError(f"credentials: give {option('tls_ca_file')} and {option('tls_cert')}, both")
    return TlsFiles(Path(ca_file), Path(cert), Path(key) if key else None)


@dataclass(frozen=True)
class ExistingScheduler:
    """An existing scheduler."""

    address: str | None = None  # for instance ``tcp://10.0.0.1:8786``; None where a file names it
    # the file that ``dask scheduler --scheduler-file`` writes; read again whenever the scheduler was lost, since a new
    # one may have another address
    file: Path | None = None
    # seconds to wait for a scheduler, at the start as well; None: for one that is gone the usual time, at the start no
    # time, so that a wrong address is noticed
    wait: float | None = None
    tls: TlsFiles | None = None  # credentials for a scheduler that talks TLS; None takes Dask's configuration

    def __post_init__(self) -> None:
        if self.address and self.file:
            raise InputError(f"give {self} or {option('scheduler_file', str(self.file))}, not both")
        if self.tls and self.address and not self.address.startswith(_TLS):
            raise InputError(f"{self}: credentials are for an address that begins with {_TLS}")

    def __str__(self) -> str:
        return option("scheduler", self.address) if self.address else option("scheduler_file", str(self.file))

    def connect(self) -> Client:
        """A client of the scheduler; InputError if none answers, or the file cannot be read."""
        from distributed import Client

        address = self._read_address()
        security, tls = self._security(address), address.startswith(_TLS)
        try:
            # A client tries for much longer than its timeout, and loses the cause.
            _handshake(urlsplit(address), security.get_connection_args("client")["ssl_context"] if tls else None)
            return Client(address, timeout=_ATTEMPT, security=security)
        except (OSError, ValueError) as error:
            raise InputError(f"{self}: {_reason(error, address)}") from error

    def _read_address(self) -> str:
        if not self.file:
            address = str(self.address)
            return address if "://" in address else f"{_TCP}{address}"  # as Dask's own client reads it
        try:
            return str(json.loads(read_regular(self.file, links=True))["address"])
        except FileNotFoundError as error:
            raise InputError(f"{self}: there is no such file") from error
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self}: no Dask scheduler answers there: the file holds no address") from error

    def _security(self, address: str) -> Security:
        from distributed.security import Security

        if self.tls:
            return self.tls.security()
        configured = Security()
        if address.startswith(_TLS) and not (configured.tls_ca_file and configured.tls_client_cert):
            files = ", ".join(option(name) for name in ("tls_ca_file", "tls_cert", "tls_key"))
            raise InputError(
                f"{self}: {address} asks for credentials: give {files}, or set them in Dask's configuration"
            )
        return configured

    def connect_first(self) -> Client:
        """A client at the start.

        Raises:
            InputError: If none answers and no time to wait was given.
            TripodDoeError: If none has answered for the given time.
        """
        client = self.connect() if self.wait is None else self._connect_within(self.wait)
        if not client.scheduler.address.startswith(_TLS):
            files = f"{option('tls_ca_file')}, {option('tls_cert')} and {option('tls_key')}"
            print(
                f"{self}: a connection without TLS: a program that reaches this scheduler or its workers can run code "
                f"there, and here: close it with {files}; "
                "page 'On a cluster' of the documentation (tripod-doe docs) says how",
                file=sys.stderr,
            )
        return client

    def connect_again(self) -> Client:
        """A client of the scheduler, or of its replacement, as soon as one answers.

        Raises:
            TripodDoeError: If no scheduler answers within the waiting time.
        """
        wait = USUAL_WAIT if self.wait is None else self.wait
        print(f"{self}: the connection is lost; trying for {duration(wait)} to connect again", file=sys.stderr)
        client = self._connect_within(wait)
        print(f"{self}: connected again", file=sys.stderr)
        return client

    def _connect_within(self, seconds: float) -> Client:
        until, pause = time.monotonic() + seconds, _PAUSES[0]
        while True:
            try:
                return self.connect()
            except InputError as error:
                left = until - time.monotonic()
                if left <= 0:
                    raise TripodDoeError(
                        f"{self}: no Dask scheduler has answered for {duration(seconds)}: "
                        f"{str(error).removeprefix(f'{self}: ')}; finished points are kept, and the same command runs "
                        "the others"
                    ) from error
                time.sleep(min(pause, left))
                pause = min(2 * pause, _PAUSES[1])


def _handshake(place: SplitResult, tls: ssl.SSLContext | None) -> None:
    """Connect to a scheduler once; OSError without an answer, ssl.SSLError without TLS or trust."""
    with socket.create_connection((place.hostname, place.port), timeout=_ATTEMPT) as plain:
        if tls:
            tls.wrap_socket(plain).close()


def _reason(error: Exception, address: str) -> str:
    """Why no connection was made, in words: of a failed handshake the scheme or the certificate at fault."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate does not pass {option('tls_ca_file')}: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        return f"the TLS handshake failed ({error.reason}); without TLS its address begins with {_TCP}"
    if address.startswith(_TLS):
        return "no Dask scheduler answers there, or it refuses these credentials"
    return f"no Dask scheduler answers there without TLS; the address of one with TLS begins with {_TLS}"
