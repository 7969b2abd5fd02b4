"""A server with finished studies, found in its folder, and a browser that is signed in to it."""

from __future__ import annotations

import json
import shutil
import signal
import sys
import threading
import time
import tomllib
import urllib.request
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

import tripod_doe as td
from started import Process
from tripod_doe.page_parts.charts.chart import Chart
from tripod_doe.service.runs.run_table import Run, RunTable, State, stamp

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
[analysis.tolerance]
"""
SHARES = """
[study]
name = "Shares on coast"
[base]
torque_n_m = -70
[factors.joint_angle_deg]
values = [4, 13]
[design]
kind = "product"
of = ["operating", "mechanisms"]
[design.operating]
factors = ["joint_angle_deg"]
[design.mechanisms]
kind = "ablation"
combinations = "single"
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
[analysis.contribution]
"""
RUNGS = """
[study]
name = "Rungs"
[base]
speed_rpm = 150
[factors.joint_angle_deg]
values = [3, 8, 16]
[factors.torque_n_m]
values = [-40, 60]
[factors.model]
values = ["equilibrium", "kinetostatic"]
[keep]
outputs = ["thrust_amplitude"]
"""
SIZE = {"width": 1280, "height": 900}
LOADED = COAST.replace("Coast and drive", "Loaded").replace(
    "[keep]", "[base]\noutput_inertia_kg_m2 = 0.02\ngroove_sliding_friction = 0.09\n[keep]"
)
STUDIES = {"coast": COAST, "sampled": SAMPLED, "shares": SHARES, "rungs": RUNGS, "loaded": LOADED}


class Served:
    """A server in a process of its own."""

    def __init__(self, folder):
        words = ["serve", "--folder", str(folder), "--port", "0", "--workers", "0"]
        self._process = Process(["-m", "tripod_doe.cli", *words])
        self._complaints = threading.Thread(target=shutil.copyfileobj, args=(self._process.stderr, sys.stderr))
        self._complaints.start()  # nobody else would empty the pipe
        self.door = self._process.stdout.readline().strip()
        self.address, _, self.token = self.door.partition("/?token=")
        self.home = ""  # address of the pages, as soon as a browser has signed in

    def ask(self, method, path, body=None):
        headers = {"authorization": f"Bearer {self.token}", "content-type": "application/json"}
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, headers, method=method)
        with urllib.request.urlopen(request, timeout=60) as answer:
            text = answer.read()
        return json.loads(text) if text else None

    def id_of(self, study):
        """The run of a study of `STUDIES`, as soon as it has been found."""
        name = tomllib.loads(study)["study"]["name"]
        deadline = time.monotonic() + 60
        while not (found := [run["id"] for run in self.ask("GET", "/api/v1/runs") if run["name"] == name]):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        return found[0]

    def close(self):
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(30)
        self._complaints.join()
        self._process.stdout.close()
        self._process.stderr.close()


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Chart, "svg", lambda chart: f"<svg><title>{chart.title}</title></svg>")
        for name, text in STUDIES.items():  # in this process: a run of the service would import everything anew
            (folder / f"{name}.toml").write_text(text)
            td.run(folder / f"{name}.toml", out=folder / name, workers=0, progress=False)
    server = Served(folder)
    yield server
    server.close()


@pytest.fixture
def long_list(tmp_path):
    """A server with 200 runs of twenty customers, one each day until today."""
    table, today = RunTable(tmp_path), datetime.now(UTC)
    for age in range(200):
        run = Run(f"{age:016x}", "study", f"customer-{age % 20}/joint {age}", "Which angle is worst?", State.FINISHED)
        table.put(replace(run, created=stamp(today - timedelta(days=age))))
        (tmp_path / run.id).mkdir()
    table.close()
    server = Served(tmp_path)
    yield server
    server.close()


@pytest.fixture(scope="session")
def coast(served):
    return served.id_of(COAST)


@pytest.fixture(scope="session")
def sampled(served):
    return served.id_of(SAMPLED)


@pytest.fixture(scope="session")
def shares(served):
    return served.id_of(SHARES)


@pytest.fixture(scope="session")
def loaded(served):
    return served.id_of(LOADED)


@pytest.fixture(scope="session")
def rungs(served):
    return served.id_of(RUNGS)


@pytest.fixture(scope="session")
def window(chromium, served):
    """A browser's window, signed in: its pages share the cookie and what has been loaded."""
    window = chromium.new_context(viewport=SIZE, accept_downloads=True)
    window.set_default_timeout(30_000)
    window.add_init_script(
        "addEventListener('securitypolicyviolation', e => { if (!e.violatedDirective.startsWith('style-src'))"
        " console.error('policy: ' + e.violatedDirective + ' ' + e.blockedURI); })"
    )
    first = window.new_page()
    first.goto(served.door)
    served.home = first.url.rstrip("/")
    first.close()
    yield window
    window.close()


@pytest.fixture(scope="session")
def tab(window):
    """One page for all tests: each new one would compile the drawing library anew, four seconds of CPU time."""
    return window.new_page()


@pytest.fixture
def page(tab, served):
    """The page, empty and as wide as the window; what breaks the policy or ends in an error of a script is an error."""
    faults = []

    def script_ended(error):
        faults.append(str(error))

    def told(message):
        if message.text.startswith("policy"):
            faults.append(message.text)

    tab.on("pageerror", script_ended)
    tab.on("console", told)
    yield tab
    tab.goto(f"{served.address}/api/v1/health")  # of the same server: for another one the browser starts anew, too
    tab.remove_listener("pageerror", script_ended)
    tab.remove_listener("console", told)
    tab.set_viewport_size(SIZE)
    tab.emulate_media(color_scheme="null", media="null")
    assert not faults
