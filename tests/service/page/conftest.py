"""A server with two finished studies, and a browser that is signed in to it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest

COAST = """
[study]
name = "Coast and drive"
question = "Which needle bearings jam?"
[factors.joint_angle_deg]
values = [3, 9, 15]
[factors.torque_n_m]
low = -60
high = 90
count = 4
[factors.bearing_radial_clearance_mm]
values = [-0.03, 0.01]
[keep]
outputs = ["thrust", "thrust_amplitude", "friction_power_w"]
"""  # preload of 0.03 mm is more than the needles bear: half of the points are jammed
SAMPLED = """
[study]
name = "Sampled joint"
[base]
output_inertia_kg_m2 = 0.02
[factors.joint_angle_deg]
low = 2
high = 14
[factors.torque_n_m]
low = 20
high = 150
[factors.groove_sliding_friction]
low = 0.02
high = 0.1
[design]
kind = "latin-hypercube"
samples = 40
seed = 3
[keep]
outputs = ["thrust_amplitude"]
"""


class Served:
    """A server in a process of its own."""

    def __init__(self, folder):
        environment = {**os.environ, "PYTHONWARNINGS": "default"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tripod_doe.cli", "serve", "--folder", str(folder), "--port", "0", "--workers", "0"],
            stdout=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
        self.door = self._process.stdout.readline().strip()
        self.address, _, self.token = self.door.partition("/?token=")

    def ask(self, method, path, body=None):
        headers = {"authorization": f"Bearer {self.token}", "content-type": "application/json"}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, headers, method=method)
        with urllib.request.urlopen(request, timeout=60) as answer:
            text = answer.read()
        return json.loads(text) if text else None

    def run(self, study):
        """Submit a study and wait for its end."""
        run_id = self.ask("POST", "/api/v1/runs", {"study": study})["id"]
        deadline = time.monotonic() + 120
        while (run := self.ask("GET", f"/api/v1/runs/{run_id}"))["state"] not in ("finished", "failed"):
            assert time.monotonic() < deadline, run
            time.sleep(0.2)
        assert run["state"] == "finished", run
        return run_id

    def close(self):
        self._process.terminate()
        self._process.wait(30)
        self._process.stdout.close()


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    server = Served(tmp_path_factory.mktemp("served"))
    yield server
    server.close()


@pytest.fixture(scope="session")
def coast(served):
    return served.run(COAST)


@pytest.fixture(scope="session")
def sampled(served):
    return served.run(SAMPLED)


@pytest.fixture(scope="session")
def chromium():
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture
def page(chromium, served):
    """A window of its own; what breaks the policy or ends in an error of a script is an error of the test."""
    context = chromium.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    context.set_default_timeout(20_000)
    page = context.new_page()
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.add_init_script(
        "addEventListener('securitypolicyviolation', e => { if (!e.violatedDirective.startsWith('style-src'))"
        " console.error('policy: ' + e.violatedDirective + ' ' + e.blockedURI); })"
    )
    page.on("console", lambda message: faults.append(message.text) if message.text.startswith("policy") else None)
    page.goto(served.door)
    yield page
    context.close()
    assert not faults
