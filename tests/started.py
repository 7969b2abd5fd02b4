"""Python programs in processes of their own, forked from one that has imported what our commands need.

A command that starts anew spends two seconds of CPU time on imports, a server, Dask's scheduler or a worker one or two.
What a test says of a process (signals, kills, its group, its exit code, its streams) it says of a forked one as well.
Tests of imports, of command lines and of what another environment does start Python itself.
"""

from __future__ import annotations

import atexit
import fcntl
import functools
import gc
import json
import os
import runpy
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

IMPORTED = (
    "matplotlib.figure",
    "distributed.cli.dask_scheduler",
    "distributed.cli.dask_worker",
    "tripod_doe.service.server",
    "tripod_doe.study.dask_workers",
    "tripod_doe.study.on_worker",
)
"""Besides what the service prepares for its own processes."""


class Process:
    """A process of Python, with what is used of `subprocess.Popen`; it leads a session of its own.

    Parameters
    ----------
    words
        As after `python`: ``-m module`` or the path of a script, and its arguments.
    environment
        Its environment variables; those of this process if omitted.
    quiet
        Whether nobody reads its output.
    ignores_interrupts
        Whether it starts with interrupts ignored.

    Attributes
    ----------
    stdout, stderr
        Streams of text from which its output is read, unless it is quiet.
    """

    def __init__(self, words, environment=None, quiet=False, ignores_interrupts=False):
        self.returncode = None
        asked = {
            "words": words,
            "environment": dict(environment or os.environ),
            "folder": os.getcwd(),
            "ignores_interrupts": ignores_interrupts,
        }
        self._told, told = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        if quiet:
            theirs = [os.open(os.devnull, os.O_WRONLY), os.open(os.devnull, os.O_WRONLY), told.detach()]
        else:
            (out, out_end), (err, err_end) = os.pipe(), os.pipe()
            self.stdout, self.stderr, theirs = os.fdopen(out), os.fdopen(err), [out_end, err_end, told.detach()]
        socket.send_fds(_server(), [json.dumps(asked).encode()], theirs)
        for end in theirs:
            os.close(end)
        self.pid = int(self._told.recv(99))
        self._told.setblocking(False)

    def poll(self):
        """Exit code, once it has ended; until then it can be signalled, and its process group exists."""
        if self.returncode is None:
            with suppress(BlockingIOError):
                self.returncode = int(self._told.recv(99))
                self._told.close()
        return self.returncode

    def wait(self, timeout=60):
        until = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > until:
                raise TimeoutError(f"process {self.pid} has not ended within {timeout} s")
            time.sleep(0.01)
        return self.returncode

    def communicate(self, timeout=60):
        """What is left of its output, as soon as it has ended."""
        texts = {}
        streams = {"out": self.stdout, "err": self.stderr}
        readers = [
            threading.Thread(target=lambda name=name: texts.update({name: streams[name].read()})) for name in streams
        ]
        for reader in readers:
            reader.start()
        try:
            self.wait(timeout)
        finally:
            if self.returncode is None:
                os.killpg(self.pid, signal.SIGKILL)
            for reader, stream in zip(readers, streams.values(), strict=True):
                reader.join()
                stream.close()
        return texts["out"], texts["err"]

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


@functools.cache
def _server():
    """Socket to the process that forks: one for all processes of a test session, as its imports take three seconds.

    It ends when the last of them has ended.
    """
    name = "\0tripod-doe-tests-" + os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid()))
    ours = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with open(Path(tempfile.gettempdir()) / f"tripod-doe-tests-{os.getuid()}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            ours.connect(name)
            server = None
        except ConnectionRefusedError:
            server = _start_server(name)
            ours.connect(name)

    def end():
        ours.close()
        if server:
            server.wait()

    atexit.register(end)
    return ours


def _start_server(name):
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(name)
        listener.listen()
        return subprocess.Popen(
            [sys.executable, __file__, str(listener.fileno())],
            pass_fds=[listener.fileno()],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
        )


def _serve(listener):
    """Fork a process for every request; gives what the forked one is to run."""
    with selectors.DefaultSelector() as waiting:
        waiting.register(listener, selectors.EVENT_READ)
        text, ends = _next_request(listener, waiting)
        while os.fork():
            for end in ends:
                os.close(end)
            text, ends = _next_request(listener, waiting)
        for place in list(waiting.get_map().values()):
            place.fileobj.close()
    out, err, told = ends
    leads, begun = os.pipe()
    if forked := os.fork():
        for end in (out, err, begun):
            os.close(end)
        os.read(leads, 1)
        _tell(socket.socket(fileno=told), forked)
    os.setsid()
    for end in (told, leads, begun):
        os.close(end)
    for end, number in ((os.open(os.devnull, os.O_RDONLY), 0), (out, 1), (err, 2)):
        os.dup2(end, number)
        os.close(end)
    return json.loads(text)


def _next_request(listener, waiting):
    """What one of those that are connected asks for; the end, as soon as none of them is left."""
    while True:
        for place, _ in waiting.select():
            if place.fileobj is listener:
                waiting.register(listener.accept()[0], selectors.EVENT_READ)
                continue
            with suppress(ChildProcessError):  # those in between that have ended, so that their time is counted
                while os.waitpid(-1, os.WNOHANG)[0]:
                    pass
            text, ends, _, _ = socket.recv_fds(place.fileobj, 1 << 20, 3)
            if text:
                return text, ends
            waiting.unregister(place.fileobj)
            place.fileobj.close()
            if len(waiting.get_map()) == 1:
                sys.exit()


def _tell(asker, forked):
    """Tell the number and the exit code of a forked process; it stays a zombie until the asker has read the latter."""
    asker.send(str(forked).encode())
    ended = os.waitid(os.P_PID, forked, os.WEXITED | os.WNOWAIT)
    with suppress(OSError):  # nobody asks any more
        asker.send(str(ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status).encode())
        asker.recv(1)
    os.waitpid(forked, 0)
    os._exit(0)


def _become(words, environment, folder, ignores_interrupts):
    """Run a program as Python would."""
    os.environ.clear()
    os.environ.update(environment)
    sys.modules["dask"].config.refresh()  # it was imported with other variables
    os.chdir(folder)
    if ignores_interrupts:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if "serve" in words:
        _fork_a_fork_server()
    module = words[0] == "-m"
    sys.argv = words[module:]
    sys.path[0] = folder if module else str(Path(words[0]).parent)
    if module:
        runpy.run_module(words[1], run_name="__main__", alter_sys=True)
    else:
        runpy.run_path(words[0], run_name="__main__")


class _ForkServer:
    """A forked fork server of the service, with what is used of `subprocess.Popen`."""

    def __init__(self, pid):
        self.pid, self.returncode = pid, None

    def poll(self):
        return None if os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is None else 0

    def kill(self):
        os.kill(self.pid, signal.SIGKILL)

    def wait(self):
        os.waitpid(self.pid, 0)


def _fork_a_fork_server():
    """Give a server the process from which it forks its own: a new one would import all this once more."""
    from tripod_doe.service import fork_server

    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    if forked := os.fork():
        theirs.close()
        of_server = fork_server._fork_server
        of_server._socket, of_server._process = ours, _ForkServer(forked)
        atexit.register(of_server.end)
        return
    ours.close()
    os.setsid()
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    fork_server._serve(theirs)
    sys.exit()


if __name__ == "__main__":
    for name in IMPORTED:
        __import__(name)
    sys.modules["tripod_doe.service.fork_server"]._prepare()
    assert len(os.listdir("/proc/self/task")) == 1, "a process with threads must not fork"
    gc.collect()
    gc.freeze()  # a forked process need not look through what all of them have imported
    _become(**_serve(socket.socket(fileno=int(sys.argv[1]))))
