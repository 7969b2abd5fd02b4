"""Processes that answer: plans, simulated points, queries and comparisons never run in the server's own process.

A kernel, a large cube or an evil expression then neither stops the server nor takes its memory: an answer that takes
too long ends with its process, and the next question gets a fresh one.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from typing import Any

from tripod_doe.errors import ForbiddenError, InputError, TooLargeError
from tripod_doe.service.fork_server import Answering
from tripod_doe.service.limits import Limits

_PATIENCE = 10  # times its limit that a process may take by the clock
_WORKER = "tripod_doe.service.answering"
_ERRORS = {"input": InputError, "forbidden": ForbiddenError, "too large": TooLargeError}


class AllBusyError(Exception):
    """All processes that answer are at work, and stayed so."""


class AnswerFailedError(Exception):
    """A process that answers failed for a reason that is not the client's."""


class AnswerProcesses:
    """Processes that answer questions, started when they are first needed.

    Parameters
    ----------
    count
        Number of processes.
    limits
        What they take.
    patience
        Seconds for which a question waits for a process that is free.
    """

    def __init__(self, count: int, limits: Limits, patience: float = 30.0) -> None:
        self._limits, self._patience = limits, patience
        self._free: queue.LifoQueue[_AnswerProcess] = queue.LifoQueue()
        self._processes = [_AnswerProcess(limits) for _ in range(count)]
        for process in self._processes:
            self._free.put(process)

    def ask(self, question: str, seconds: float, **arguments: Any) -> tuple[Any, bytes]:
        """Ask one of the functions of `answering` by its name.

        Parameters
        ----------
        question
            The function's name.
        seconds
            Time for the answer.
        **arguments
            Its arguments, as JSON takes them.

        Returns
        -------
        tuple
            The answer, and the bytes that come with it.

        Raises
        ------
        InputError, ForbiddenError, TooLargeError
            What the function raised; TooLargeError also where the answer takes too long.
        AllBusyError
            If no process becomes free in time.
        AnswerFailedError
            If the process failed.
        """
        try:
            process = self._free.get(timeout=self._patience)
        except queue.Empty as error:
            raise AllBusyError from error
        try:
            return process.ask(question, seconds, arguments)
        finally:
            self._free.put(process)

    def warm(self) -> None:
        """Start one process, so that the first question need not wait for it."""
        self._processes[-1].start()

    def close(self) -> None:
        """End all processes."""
        for process in self._processes:
            process.end(for_good=True)


class _AnswerProcess:
    """One process that answers, one question at a time; a new one takes its place when it ends."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._process: Answering | None = None
        self._changing = threading.Lock()
        self._closed = False

    def start(self) -> Answering:
        """The process, started if there is none."""
        with self._changing:
            if self._closed:
                raise AnswerFailedError("the server is about to end")
            if self._process is not None:
                self._process.look()
                if self._process.has_ended:
                    self._process.close()
                    self._process = None
            if self._process is None:
                self._process = Answering(_WORKER, str(self._limits.memory_bytes))
            return self._process

    def end(self, for_good: bool = False) -> None:
        """End the process if there is one; `for_good`: no other takes its place."""
        with self._changing:
            process, self._process = self._process, None
            self._closed = self._closed or for_good
        if process is not None:
            process.close()

    def ask(self, question: str, seconds: float, arguments: dict[str, Any]) -> tuple[Any, bytes]:
        """Ask, and end the process if it does not answer in time; see `AnswerProcesses.ask`."""
        process = self.start()
        late, over = threading.Event(), threading.Event()
        threading.Thread(target=_end_late, args=(process, seconds, late, over), daemon=True).start()
        try:
            return _exchange(process, {"question": question, "arguments": arguments})
        except (OSError, EOFError, ValueError) as error:  # ValueError: closed meanwhile
            self.end()
            if late.is_set():
                told = f"{question}: no answer within {seconds:g} s of CPU time, which is the limit here"
                raise TooLargeError(told) from error
            raise AnswerFailedError(f"{question}: the process that answers has ended") from error
        finally:
            over.set()


def _end_late(process: Answering, seconds: float, late: threading.Event, over: threading.Event) -> None:
    """End a process that has had its time and does not answer; CPU time, as on a busy machine it waits for others.

    One that does not work at all, as its disk hangs, has a multiple of it by the clock.
    """
    started, before, rest = time.monotonic(), process.cpu_seconds(), seconds
    while not over.wait(rest):
        rest = seconds - (process.cpu_seconds() - before)
        if rest <= 0 or time.monotonic() - started > _PATIENCE * seconds:
            late.set()
            process.kill()
            return


def _exchange(process: Answering, asked: dict[str, Any]) -> tuple[Any, bytes]:
    process.questions.write(json.dumps(asked).encode() + b"\n")
    process.questions.flush()
    head = process.answers.readline()
    if not head.endswith(b"\n"):
        raise EOFError
    answer = json.loads(head)
    data = process.answers.read(answer["bytes"])
    if len(data) < answer["bytes"]:
        raise EOFError
    if error := answer.get("error"):
        raise _ERRORS.get(error, AnswerFailedError)(answer["text"])
    return answer["answer"], data
