"""A server of our own command line in a process of its own, and what its runs leave in the folder."""

from __future__ import annotations

import json
import re
import signal
import textwrap
import time
import urllib.error
import urllib.request

import psutil

from started import Process
from tripod_doe.service.runs.processes import run_process
from tripod_doe.study.journal import Journal

LONG = """
    [study]
    name = "long"
    [base]
    model = "equilibrium"
    [factors.joint_angle_deg]
    low = 1
    high = 20
    count = 200
    [factors.torque_n_m]
    low = 10
    high = 400
    count = 200
    [keep]
    outputs = ["thrust_rms"]
    [run]
    block = 100
    """
"""Many minutes, in blocks of about a second."""


LIMITED = """import resource, runpy, sys
if __name__ == "__main__":  # workers read this file, too
    resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv.pop(1)),) * 2)
    runpy.run_module("tripod_doe.cli", run_name="__main__")
"""
"""A server that may have only so many files open."""


class Server:
    """A server of our own command line."""

    def __init__(self, folder, *flags, files=None):
        words = ["-m", "tripod_doe.cli", "serve", "--folder", str(folder), "--port", "0", *flags]
        if files is not None:
            script = folder.with_name("limited.py")
            script.write_text(LIMITED)
            words[:2] = [str(script), str(files)]
        self.process = Process(words)
        self.line = self.process.stdout.readline()
        self.address, self.token = re.fullmatch(r"(http://127\.0\.0\.1:\d+)/\?token=(\S+)\n", self.line).groups()

    def ask(self, path, body=None, method=None, seconds=60):
        data = None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        request = urllib.request.Request(f"{self.address}/api/v1{path}", data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=seconds) as answer:
                return answer.status, json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.loads(error.read())

    def post_text(self, path, body, seconds=60):
        """The status of a request of any address with a body as it is."""
        headers = {"Authorization": f"Bearer {self.token}", "Content-Type": "application/json"}
        request = urllib.request.Request(self.address + path, body.encode(), headers)
        try:
            with urllib.request.urlopen(request, timeout=seconds) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            with error:
                return error.code

    def submit(self, study):
        status, run = self.ask("/runs", {"study": textwrap.dedent(study)})
        assert status == 201, run
        return run["id"]

    def wait(self, run_id, test, seconds=120):
        until = time.monotonic() + seconds
        while not test(run := self.ask(f"/runs/{run_id}")[1]):
            assert time.monotonic() < until, run
            time.sleep(0.1)
        return run

    def end(self, number=signal.SIGTERM):
        self.process.send_signal(number)
        told, complaints = self.process.communicate(20)
        return self.process.returncode, told, complaints


def runs_in(folder):
    """Processes that run our command line on a folder or on folders in it."""
    numbers = [run_process(place.parent) for place in folder.rglob(".alive")]
    return [psutil.Process(number) for number in numbers if number]


def committed(directory):
    """Fingerprints in a journal, in the order of their commits."""
    with Journal(directory, read_only=True) as journal:
        keys = journal.keys()
    return [key.tobytes() for key in keys]
