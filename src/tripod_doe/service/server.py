"""The server's process: its folder, its socket, and a clean shutdown."""

import fcntl
import json
import os
import socket
import stat
import sys
import threading
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from types import FrameType

import uvicorn

from tripod_doe.errors import InputError, TripodDoeError, option
from tripod_doe.files.regular_files import open_locked
from tripod_doe.http_opener import LOOPBACK
from tripod_doe.service.app import create_app
from tripod_doe.service.log import start_log
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.runs.run_table import TABLE
from tripod_doe.service.security.connections import limited_protocol
from tripod_doe.service.security.delivered_files import is_open_to_change
from tripod_doe.service.service import Service
from tripod_doe.service.settings import Settings
from tripod_doe.service.workers.forking import end_fork_server
from tripod_doe.service.workers.worker_pool import WorkerFailedError

_GRACE = 3  # seconds for open answers at the end
_QUESTION_GRACE = 1.5  # seconds for questions; then there is time left to tell their clients that the server ends
_LOCK = ".service.lock"
_ACCEPTED_AT_ONCE = 16  # if the table of files is full, each fails and is logged


def serve(settings: Settings) -> None:
    """Serve until a signal ends it; prints the address with its token on standard output.

    Raises:
        InputError: If the folder or the port cannot be used.
    """
    with _private_files(), _locked_folder(settings), _listening(settings) as listener:
        host, port = listener.getsockname()[:2]
        settings = replace(settings, folder=settings.folder.resolve(), port=port)
        start_log()
        app = create_app(settings)
        service: Service = app.state.service
        config = uvicorn.Config(
            app,
            http=limited_protocol(settings.limits.connections),
            log_config=None,
            log_level="warning",
            access_log=False,
            backlog=_ACCEPTED_AT_ONCE,
            server_header=False,
            timeout_graceful_shutdown=_GRACE,
            proxy_headers=False,
            ws="none",
        )
        if settings.demo and not settings.read_only:
            service.start()
            add_demo(service)
        if settings.host not in LOOPBACK:
            print(
                f"tripod-doe: {settings.host} is seen from other machines, and what they send is not encrypted; "
                "who knows the token can run studies here",
                file=sys.stderr,
            )
        shown = f"[{host}]" if ":" in host else host
        print(f"http://{shown}:{port}/?token={settings.token}", flush=True)
        try:
            _Server(config, service).run(sockets=[listener])
        finally:
            end_fork_server()


class _Server(uvicorn.Server):
    """A server that closes its event streams when it shuts down: else they would delay it."""

    def __init__(self, config: uvicorn.Config, service: Service) -> None:
        super().__init__(config)
        self._service = service

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start; let the system queue more connections than asyncio accepts at once."""
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(socket.SOMAXCONN)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End on the first signal, at once on the second; a signal is the normal end, so the exit code is 0."""
        self._service.runs.events.close()
        ending = threading.Timer(_QUESTION_GRACE, self._service.end_questions)
        ending.daemon = True
        ending.start()
        self.force_exit = self.should_exit
        self.should_exit = True


@contextmanager
def _private_files() -> Iterator[None]:
    """Make results, logs and the table of runs private to this user; clients get them with the token."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)


@contextmanager
def _locked_folder(settings: Settings) -> Iterator[None]:
    """Make the folder if needed, and lock it for this server; a read-only server locks nothing."""
    folder = settings.folder
    if settings.read_only:
        if not folder.is_dir():
            raise InputError(f"{option('folder', str(folder))}: there is no such directory")
        _refuse_exchangeable(folder)
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _refuse_exchangeable(folder)
        lock = open_locked(folder / _LOCK, os.O_CREAT | os.O_RDWR)
        for name in (_LOCK, *(f"{TABLE}{end}" for end in ("", "-wal", "-shm", "-journal"))):  # none of them a pipe
            with suppress(FileNotFoundError):
                _make_private(folder / name)
    except OSError as error:
        raise InputError(f"{option('folder', str(folder))}: cannot write here: {error.strerror}") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as error:
        raise InputError(
            f"{option('folder', str(folder))}: another server uses this folder; open that one, or choose another folder"
        ) from error
    finally:
        os.close(lock)


def _refuse_exchangeable(folder: Path) -> None:
    """Refuse a folder if other users could replace the results in it, or the folder itself."""
    named = option("folder", str(folder))
    for place in (folder.resolve(), *folder.resolve().parents):
        state = place.stat()
        is_open = is_open_to_change(state) if place == folder.resolve() else state.st_mode & stat.S_IWOTH
        if is_open and not state.st_mode & stat.S_ISVTX:  # in /tmp, others cannot remove it
            raise InputError(f"{named}: other users can write here; run: chmod go-w {place}")


def _make_private(path: Path) -> None:
    file = open_locked(path)
    try:
        os.fchmod(file, 0o600)
    finally:
        os.close(file)


@contextmanager
def _listening(settings: Settings) -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP) as listener:  # asyncio then sends without delay
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((settings.host, settings.port))
            listener.listen(socket.SOMAXCONN)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(
                f"{option('host', settings.host)} {option('port', settings.port)}: cannot listen here: {reason}"
            ) from error
        yield listener


_LOOK = 0.1  # seconds between two looks


def add_demo(service: Service) -> None:
    """Run the demonstration study, unless the folder has it; ends when it is finished.

    Args:
        service: Started, and not read-only.
    """
    from tripod_doe.workflow.progress import Progress

    text = (files("tripod_doe.service") / "demo.toml").read_text(encoding="utf-8")
    name = tomllib.loads(text)["study"]["name"]
    if any(run.name == name for run in service.runs.all()):
        return
    print(f"tripod-doe: running the study {name!r} for the first look", file=sys.stderr)
    try:
        run = service.submit(json.dumps({"study": text}).encode())
    except (TripodDoeError, WorkerFailedError, RefusedError) as error:
        print(f"tripod-doe: it cannot run now: {error}", file=sys.stderr)
        return
    with Progress(run.counts.total, shown=True) as progress:
        while not run.state.at_rest:
            time.sleep(_LOOK)
            before, run = run.counts.missing, service.runs.find(run.id)
            progress.add(before - run.counts.missing)
