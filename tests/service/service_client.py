from __future__ import annotations

import asyncio
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from starlette.testclient import TestClient

ADDRESS = "http://127.0.0.1:8811"
API = "/api/v1"
TOKEN = "a-token-of-these-tests"
READ_TOKEN = "a-token-that-only-reads"

COAST = """
    [study]
    name = "coast"

    [base]
    model = "equilibrium"
    torque_n_m = -35
    initial_skew_1_deg = 0.3

    [factors.joint_angle_deg]
    values = [2.5, 17]

    [factors.speed_rpm]
    values = [150, 4000]

    [factors.bearing_radial_clearance_mm]
    values = [0.02, -0.05]

    [keep]
    outputs = ["thrust_amplitude", "thrust_rms", "groove_thrust_amplitude"]
    """
"""Four points that finish, and four whose bearings are jammed."""


def in_own_loop(main):
    """What a coroutine returns; in a thread of its own, for a browser's tests leave a running loop in this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, main).result()


@dataclass
class Asked:
    """The interface as a program asks it."""

    client: TestClient

    def get(self, path, **options):
        return self.client.get(API + path, **options)

    def post(self, path, json=None, **options):
        return self.client.post(API + path, json=json, **options)

    def patch(self, path, json=None, **options):
        return self.client.patch(API + path, json=json, **options)

    def delete(self, path, **options):
        return self.client.delete(API + path, **options)

    def submit(self, study=COAST, **options):
        answer = self.post("/runs", {"study": textwrap.dedent(study)}, **options)
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def wait(self, run_id, *states, seconds=120):
        """The run as soon as it is in one of these states."""
        until = time.monotonic() + seconds
        while (run := self.get(f"/runs/{run_id}").json())["state"] not in states:
            assert time.monotonic() < until, run
            time.sleep(0.05)
        return run
