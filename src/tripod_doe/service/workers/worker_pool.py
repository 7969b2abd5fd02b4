"""Worker processes that answer questions: plans, simulated points, queries and comparisons.

A kernel, a large cube or a hostile text then neither stops the server nor fills its memory: if an answer takes too
long, its process is killed, and the next question gets a new process. `concurrent.futures.ProcessPoolExecutor` cannot
do that: when one of its processes is killed, the work of all others fails, too.
"""

from __future__ import annotations

import logging
import os
import queue
import signal
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from tripod_doe.errors import StorageError
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import SERVER_ENDS, RefusedError
from tripod_doe.service.workers.forking import context, start_process
from tripod_doe.service.workers.worker import serve

_MOMENT = 1.0  # seconds to wait for the exit code of a process that has closed its connection
_PATIENCE = 4  # most wall time of an answer, as a multiple of its CPU time limit
_LOOK = 0.25  # seconds between two checks whether the client is still there
_TURN = 5.0  # seconds of the clock for a reader's question while another reader waits
_GRACE = 2.0  # seconds for an answer whose client has left: a new process that opens its cubes again may cost more


log = logging.getLogger(__name__)


class AllBusyError(RefusedError):
    """All workers stayed busy, too many questions wait for them, or the system starts no process now (503)."""

    def __init__(self, reason: str = "all workers are busy") -> None:
        super().__init__(503, f"{reason}: try again in a moment", headers={"retry-after": "5"})


class LateError(RefusedError):
    """An answer that exceeded its time limit (413)."""


class ClientLeftError(RefusedError):
    """A question whose client no longer waits for the answer."""

    def __init__(self) -> None:
        super().__init__(400, "the client went away")


class WorkerFailedError(Exception):
    """A worker failed for a reason that is not the client's."""


class ServerEndsError(RefusedError):
    """The server ends before the answer is ready (503)."""

    def __init__(self) -> None:
        super().__init__(503, SERVER_ENDS)


class WorkerPool:
    """Workers, started when they are first needed.

    Args:
        count: Number of processes.
        patience: Seconds for which a question waits for a free worker.
        waiting: Most waiting questions; each holds a thread of the server, and other requests also need threads.
        of_one: Most questions of one reader. At least one worker of several is left to others, and where others hold
            them all, a question that has lasted longest is ended for a reader who waits.

    Attributes:
        threads: Threads of the server that its questions can hold.
    """

    def __init__(
        self, count: int, limits: Limits, patience: float = 30.0, waiting: int = 16, of_one: int | None = None
    ) -> None:
        self._patience = patience
        self.threads = count + waiting
        self._places = threading.Semaphore(self.threads)
        self._of_one = of_one or self.threads
        self._counting = threading.Lock()
        self._open: Counter[str] = Counter()  # questions of each reader
        self._turns = defaultdict[str, threading.Semaphore](lambda: threading.Semaphore(max(1, count - 1)))
        self._turns[""] = threading.Semaphore(count)
        self._waiting: list[object] = []  # those for whom a worker must be freed
        self._workers = [_Worker(limits.memory_bytes) for _ in range(count)]
        self._free: queue.LifoQueue[_Worker] = queue.LifoQueue()
        for worker in self._workers:
            self._free.put(worker)

    def ask(
        self,
        question: str,
        seconds: float,
        as_json: bool = False,
        left: threading.Event | None = None,
        reader: str = "",
        **arguments: Any,
    ) -> Any:
        """Ask a question, and wait for the answer.

        Args:
            question: Path of a function, such as ``workers.answers:plan``.
            seconds: CPU time for the answer.
            as_json: Whether the worker must return the answer as JSON bytes.
            left: Set when the client leaves: a waiting question is dropped, and long work on it is ended.
            reader: Who asks, if others ask here, too.

        Raises:
            RefusedError: If the function refuses.
            ClientLeftError: If the client has left.
            LateError: If the answer takes too long.
            StorageError: If the disk is full.
            AllBusyError: If no worker becomes free in time, too many questions wait already, or none can be started.
            WorkerFailedError: If the worker failed.
            ServerEndsError: If the pool was closed.
        """
        left = left or threading.Event()
        with self._turn(reader, left):
            worker = self._free_worker(left)
            try:
                return worker.ask(question, seconds, arguments, as_json, left, self._makes_room if reader else None)
            finally:
                self._free.put(worker)

    @contextmanager
    def _turn(self, reader: str, left: threading.Event) -> Iterator[None]:
        """Take a place for a question, and wait until not too many of the reader are at work."""
        with self._counting:
            turn, full = self._turns[reader], bool(reader) and self._open[reader] >= self._of_one
            if full or not self._places.acquire(blocking=False):
                raise AllBusyError
            self._open[reader] += 1
        try:
            if not any(turn.acquire(timeout=pause) for pause in _pauses(self._patience, left)):
                raise AllBusyError
            try:
                yield
            finally:
                turn.release()
        finally:
            with self._counting:
                self._open[reader] -= 1
            self._places.release()

    def _free_worker(self, left: threading.Event) -> _Worker:
        """Take a free worker, or wait for one within `patience`."""
        with suppress(queue.Empty):
            return self._free.get_nowait()
        self._waiting.append(here := object())
        try:
            for pause in _pauses(self._patience, left):
                with suppress(queue.Empty):
                    return self._free.get(timeout=pause)
        finally:
            with suppress(ValueError):  # somebody has made room
                self._waiting.remove(here)
        raise AllBusyError

    def _makes_room(self, spent: float) -> bool:
        """Whether a question at work must end for one that waits; asked once for each that waits."""
        if spent < _TURN:
            return False
        with suppress(IndexError):
            self._waiting.pop(0)
            return True
        return False

    def warm(self) -> None:
        """Start one worker, so that the first question need not wait for it; if that fails, it tries again."""
        with suppress(AllBusyError, ServerEndsError):
            self._workers[-1].start()

    def close(self) -> None:
        """End all workers."""
        for worker in self._workers:
            worker.close()


def _pauses(seconds: float, left: threading.Event, grace: float = 0.0) -> Iterator[float]:
    """Pauses that add up to `seconds`; ClientLeftError once the client has left and a grace period has passed."""
    start = time.monotonic()
    while (spent := time.monotonic() - start) < seconds:
        if spent >= grace and left.is_set():
            raise ClientLeftError
        yield min(_LOOK, seconds - spent)


class _Worker:
    """One process, which answers one question at a time; another takes its place when it has ended."""

    def __init__(self, memory_bytes: int) -> None:
        self._memory_bytes = memory_bytes
        self._changing = threading.Lock()
        self._process: Any = None
        self._connection: Any = None  # None exactly when the process is None
        self._closed = False

    def start(self) -> Any:
        """Start the process if there is none; gives the connection to it."""
        with self._changing:
            if self._closed:
                raise ServerEndsError
            if self._process is not None and not self._process.is_alive():
                self._forget()
            if self._process is None:
                try:
                    ours, theirs = context.Pipe()
                    with theirs:
                        self._process = start_process(serve, theirs, self._memory_bytes)
                except (OSError, EOFError) as error:  # no memory, no file, or the fork server has just ended
                    message = f"no process can be started for the answer ({str(error) or type(error).__name__})"
                    log.error("%s", message)
                    raise AllBusyError(message) from error
                self._connection = ours
            return self._connection

    def close(self) -> None:
        """End the process for good; a process that is still starting, which may take seconds, ends by itself."""
        self._closed = True
        if self._changing.acquire(timeout=_MOMENT / 10):
            try:
                self._end()
            finally:
                self._changing.release()

    def ask(
        self,
        question: str,
        seconds: float,
        arguments: dict[str, Any],
        as_json: bool,
        left: threading.Event,
        makes_room: Callable[[float], bool] | None = None,
    ) -> Any:
        """Ask a question; see `WorkerPool.ask`."""
        connection = self.start()
        kind: str
        answer: Any = None
        try:
            connection.send((question, seconds, arguments, as_json))
            kind, began = "late", time.monotonic()
            for pause in _pauses(_PATIENCE * seconds, left, _GRACE):
                if connection.poll(pause):
                    kind, answer = connection.recv()
                    break
                if makes_room and makes_room(time.monotonic() - began):
                    kind = "long"
                    break
        except ClientLeftError:
            kind = "left"
        except (OSError, EOFError, TypeError):  # the connection was closed meanwhile
            kind = "ended"
        if kind == "answer":
            return answer
        if kind == "refused":
            raise RefusedError(answer[0], *answer[1])
        if kind == "full":
            raise StorageError(answer)
        if kind == "failed":
            raise WorkerFailedError(answer)
        with self._changing:
            late = self._end(_MOMENT if kind == "ended" else 0.0) == -signal.SIGXCPU or kind == "late"
        if self._closed:
            raise ServerEndsError
        if kind == "left":
            raise ClientLeftError
        name = question.partition(":")[2].replace("_", " ")
        if kind == "long":
            raise AllBusyError(f"{name}: ended after {_TURN:g} s, since others wait")
        if late:
            raise LateError(413, f"{name}: no answer within {seconds:g} s of CPU time, which is the limit here")
        raise WorkerFailedError(f"{name}: the worker has ended")

    def _end(self, seconds: float = 0.0) -> int | None:
        """End the process and its child processes, if it does not end by itself; return the exit code."""
        process = self._process
        if process is None:
            return None
        process.join(seconds)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()  # it may not lead its process group yet
        process.join()
        code: int | None = process.exitcode
        self._forget()
        return code

    def _forget(self) -> None:
        self._connection.close()
        self._process.close()
        self._process = self._connection = None
