"""Starts the processes of the service by forking one that has imported what they need.

    python -m tripod_doe.service.fork_server SOCKET

A run or a process that answers spends its first seconds on imports, if it starts anew. Forked from a process that has
done them, it starts in milliseconds, and shares their memory. The fork server starts when it is first needed and ends
with the process that started it; what it has forked goes on.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module

import psutil

from tripod_doe.study.execution.child_process import command, environment

_IMPORTED = (
    "dask.array",  # which xarray imports with the first cube
    "matplotlib.backends.backend_svg",
    "netCDF4",
    "tripod_doe.cli.main",
    "tripod_doe.joint.balance.equilibrium",
    "tripod_doe.joint.simulator",
    "tripod_doe.service.answering",
    "tripod_doe.service.plans",
    "tripod_doe.workflow.chain",
    "tripod_doe.workflow.run",
)
"""What nearly all runs and answers import."""

_LONGEST = 1 << 20  # bytes of a request


def start_module(
    module: str,
    words: Sequence[str],
    streams: tuple[int, int, int],
    mark: int,
    niceness: int = 0,
    must_start: bool = True,
) -> None:
    """Run a module as a program in a process and a session of its own; does not wait for it.

    Parameters
    ----------
    module
        Full name of the module.
    words
        Arguments of the program.
    streams
        Its standard input, output and error; they stay open here.
    mark
        An open file into which the process writes its number and a line end; it holds it until it ends, and what it
        starts itself does not.
    niceness
        How much later than others it gets its turn on a busy machine; see `os.nice`.
    must_start
        Whether it is to start even if this process ends before.

    Raises
    ------
    OSError
        If it cannot be started.
    """
    if sys.platform == "linux":
        _fork_server.ask(json.dumps([niceness, module, *words]).encode(), [*streams, mark], must_start)
        return
    process = subprocess.Popen(  # libraries of other systems do not survive a fork
        command(module, *words),
        stdin=streams[0],
        stdout=streams[1],
        stderr=streams[2],
        start_new_session=True,
        pass_fds=(mark,),
        env=environment(),
    )
    os.setpriority(os.PRIO_PROCESS, process.pid, os.nice(0) + niceness)
    os.write(mark, f"{process.pid}\n".encode())
    threading.Thread(target=process.wait, daemon=True).start()


class Answering:
    """A module that runs as a program in a process of its own and answers what it is asked.

    Parameters
    ----------
    module
        Full name of the module.
    *words
        Arguments of the program.

    Attributes
    ----------
    questions, answers
        Its standard input and output; it ends where no more questions can come.
    pid
        Its number; None until it has started.
    has_ended
        Whether it was found to have ended.
    """

    def __init__(self, module: str, *words: str) -> None:
        (asked, questions), (answers, answered), (told, mark) = (os.pipe() for _ in range(3))
        os.set_blocking(told, False)
        self.questions, self.answers = os.fdopen(questions, "wb"), os.fdopen(answers, "rb")
        self._told = os.fdopen(told, "rb", buffering=0)
        self.pid: int | None = None
        self.has_ended = False
        try:
            start_module(module, words, (asked, answered, 2), mark, must_start=False)
        except OSError:
            self.close()
            raise
        finally:
            for theirs in (asked, answered, mark):
                os.close(theirs)

    def look(self) -> None:
        """Look whether it has started, and whether it has ended."""
        with suppress(ValueError):  # another thread has closed it
            while not self.has_ended and (told := self._told.read(99)) is not None:
                if told:
                    self.pid = int(told)
                else:
                    self.has_ended = True

    def cpu_seconds(self) -> float:
        """CPU time of the process and of its children that have ended; none where it is gone itself."""
        self.look()
        try:
            return 0.0 if self.pid is None else float(sum(psutil.Process(self.pid).cpu_times()[:4]))
        except psutil.Error:
            return 0.0

    def kill(self) -> None:
        """End it and what it started; one that has not yet started ends when its streams are closed."""
        self.look()
        if self.pid is not None and not self.has_ended:
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)

    def close(self) -> None:
        """End it, wait until it has ended if it has started, and close its streams."""
        self.kill()
        if self.pid is not None:
            waiting = select.poll()
            waiting.register(self._told)
            while not self.has_ended:
                waiting.poll()
                self.look()
        for stream in (self.questions, self.answers, self._told):
            with suppress(OSError):  # what could not be sent is of no use now
                stream.close()


class _ForkServer:
    """The process that forks, as seen by the one that asks it; another takes its place if it has ended."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._asked: deque[bool] = deque()

    def ask(self, request: bytes, files: list[int], must_start: bool) -> None:
        """Send a request with open files; the fork server looks at it as soon as it can, even after the end of this."""
        with self._lock:
            self._forget_started()
            if self._socket is not None:
                with suppress(OSError):  # it has been killed
                    socket.send_fds(self._socket, [request], files)
                    self._asked.append(must_start)
                    return
            socket.send_fds(self._start(), [request], files)
            self._asked.append(must_start)

    def _start(self) -> socket.socket:
        if self._process is None:
            atexit.register(self.end)
        self.end()
        self._asked.clear()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                command(__name__, str(theirs.fileno())),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
                pass_fds=(theirs.fileno(),),
                env=environment(),
            )
        self._socket = ours
        return ours

    def _forget_started(self) -> None:
        """Read which of the requests it has fulfilled; it does so in their order."""
        with suppress(OSError):
            while self._socket is not None and self._asked and self._socket.recv(1, socket.MSG_DONTWAIT):
                self._asked.popleft()

    def end(self) -> None:
        """End the process that forks; where it has still to start what must start, it ends by itself after that."""
        self._forget_started()
        if self._socket is not None:
            self._socket.close()
        if self._process is not None:
            if any(self._asked) and self._process.poll() is None:
                self._process.returncode = 0
                return
            self._process.kill()
            self._process.wait()


_fork_server = _ForkServer()


def _forked(requests: socket.socket) -> list[str]:
    """Fork a process for every request; returns in the forked ones only, with the words of their programs."""
    signal.signal(signal.SIGCHLD, _reap)
    while True:
        request, files, _, _ = socket.recv_fds(requests, _LONGEST, 4)
        if not request:
            sys.exit()
        if not os.fork():
            break
        with suppress(OSError):  # who asked has ended
            requests.send(b"1")
        for file in files:
            os.close(file)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    requests.close()
    os.setsid()
    *streams, mark = files
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    os.set_inheritable(mark, False)
    os.write(mark, f"{os.getpid()}\n".encode())
    os.umask(0o077)  # what it writes is its owner's alone
    niceness, *words = json.loads(request)
    os.nice(niceness)
    return list(words)


def _reap(*_: object) -> None:
    """Forget those that have ended."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _prepare() -> None:
    """Do what nearly all runs and answers begin with; a process with threads must not fork, and this starts none."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded; see `cli.main`
    for name in _IMPORTED:
        import_module(name)
    cpu_target = import_module("numba.core.registry").cpu_target
    cpu_target.target_context.refresh()  # what numba does before it loads the first kernel
    gc.collect()
    gc.freeze()  # what is shared is neither looked through nor copied


def _serve(requests: socket.socket) -> None:
    """Fork a process for every request, in which its program runs."""
    sys.argv = _forked(requests)
    sys.modules.pop(sys.argv[0], None)  # what it has imported is kept
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


def _main() -> None:
    _prepare()
    _serve(socket.socket(fileno=int(sys.argv[1])))


if __name__ == "__main__":
    _main()
