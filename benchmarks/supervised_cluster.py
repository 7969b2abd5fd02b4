"""A Dask scheduler and workers on this machine that are started again when they end, as a cluster manager does."""

from __future__ import annotations

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from distributed import Client


class SupervisedCluster:
    """A scheduler and its workers, without nannies.

    Parameters
    ----------
    folder
        Where the file that names the scheduler is written.
    workers
        Workers at the start.
    away
        Seconds for which a scheduler that was killed stays away.
    threads
        Of each worker.

    Attributes
    ----------
    schedulers
        When each scheduler was started (seconds since 1970).
    """

    def __init__(self, folder: Path, workers: int, away: float = 0.0, threads: int = 1) -> None:
        self.file, self.away, self.threads = folder / "scheduler.json", away, threads
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.processes: dict[str, subprocess.Popen] = {}
        self.schedulers: list[float] = []
        self._ended = threading.Event()
        self._not_before: dict[str, float] = {}
        self._commands = {
            "scheduler": [
                "scheduler",
                "--host",
                "127.0.0.1",
                "--port",
                str(self.port),
                "--no-dashboard",
                "--scheduler-file",
                str(self.file),
            ]
        }
        self._places: dict[str, str] = {}
        for number in range(workers):
            self.add_worker(f"worker {number}")
        self._supervisor = threading.Thread(target=self._supervise)

    def add_worker(self, name: str, python_path: str = "") -> None:
        """Let one worker more join, with a folder before all others from which it imports."""
        self._places[name] = python_path
        self._commands[name] = [
            "worker",
            self.address,
            "--no-nanny",
            "--nthreads",
            str(self.threads),
            "--no-dashboard",
            "--host",
            "127.0.0.1",
            "--death-timeout",
            "60",
            "--name",
            name,
        ]

    def workers(self) -> list[str]:
        """Names of the workers that are alive."""
        return [name for name, process in self.processes.items() if name != "scheduler" and process.poll() is None]

    def wait(self) -> None:
        """Wait until all workers have joined."""
        with Client(self.address) as client:
            client.wait_for_workers(sum(name != "scheduler" for name in self._commands))

    def kill(self, name: str, for_good: bool = False) -> None:
        """SIGKILL; what is not gone for good comes back."""
        if for_good:
            self._commands.pop(name)
        self._not_before[name] = time.monotonic() + (self.away if name == "scheduler" else 0.0)
        self.processes[name].kill()
        self.processes[name].wait()

    def stop(self, name: str, seconds: float) -> None:
        """SIGSTOP for some seconds."""
        self.processes[name].send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self.processes[name].send_signal(signal.SIGCONT)

    def start(self, words: list[str], place: str) -> subprocess.Popen:
        """Start Python with a folder before all others from which it imports."""
        places = [place, os.environ.get("PYTHONPATH", "")]
        return subprocess.Popen(
            [sys.executable, *words],
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(place for place in places if place)},
        )

    def _supervise(self) -> None:
        while not self._ended.wait(0.1):
            for name, command in list(self._commands.items()):
                ended = name not in self.processes or self.processes[name].poll() is not None
                if ended and time.monotonic() >= self._not_before.get(name, 0.0):
                    if name == "scheduler":
                        self.schedulers.append(time.time())
                    self.processes[name] = self.start(["-m", "dask", *command], self._places.get(name, ""))

    def __enter__(self) -> SupervisedCluster:
        self._supervisor.start()
        while not self.file.exists():
            time.sleep(0.05)
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set()
        self._supervisor.join()
        for process in self.processes.values():
            process.kill()
            process.wait()


class Proxy:
    """A TCP proxy to a port of this machine, whose connections can be reset, or be kept open and carry nothing more.

    Parameters
    ----------
    port
        Where it leads.
    """

    def __init__(self, port: int) -> None:
        self._target = port
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._dead: set[socket.socket] = set()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._accepting = threading.Thread(target=self._accept, daemon=True)
        self._accepting.start()

    def reset(self) -> None:
        """Reset all connections."""
        for pair in self._pairs:
            for end in pair:
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RD)  # whoever waits for it holds it open
                end.close()
        self._pairs.clear()

    def swallow(self) -> None:
        """Let all connections that are open now carry nothing, for good; new ones work."""
        for pair in self._pairs:
            self._dead.update(pair)

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                try:
                    far = socket.create_connection(("127.0.0.1", self._target))
                except OSError:
                    near.close()
                    continue
                self._pairs.append((near, far))
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                if source not in self._dead:
                    sink.sendall(data)
            if source not in self._dead:
                sink.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """End it: whoever still connects meets a closed port, and no connection is left open."""
        self._server.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        self._server.close()
        self.reset()
