from __future__ import annotations

import gc
import os
import shutil
import sys
import textwrap
from pathlib import Path

import hypothesis
import pytest

# tests start a hundred processes: each would compile our modules to bytecode anew where the surroundings keep it from disk
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# before numpy is loaded, here and in what tests start: problems of linear algebra are small, and the threads of several
# processes on few cores wait for each other, at full load
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

gc.disable()  # until all tests are collected: a million objects are made and hardly any is dropped

# plain modules beside the tests (equal_cubes.py, joint/reference.py) are imported by name
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent / "joint"))
sys.path.insert(0, str(Path(__file__).parent / "mechanics" / "scenes"))
sys.path.insert(0, str(Path(__file__).parent / "analyses"))
sys.path.insert(0, str(Path(__file__).parent / "workflow"))
sys.path.insert(0, str(Path(__file__).parent / "service"))
for folder in ("explanation", "reference"):
    sys.path.append(str(Path(__file__).parents[1] / "docs" / folder))  # what makes parts of the documentation
pytest_plugins = ["study_cubes"]


hypothesis.settings.register_profile("any machine", deadline=None, derandomize=True)  # neither load nor luck decides
hypothesis.settings.load_profile("any machine")

MODELS_OF_PROCESS = {
    "gw0": ("rollers", "equilibrium", "kinetostatic"),
    "gw1": ("equilibrium", "kinetostatic"),
    "gw2": ("equilibrium", "kinetostatic"),
    "gw3": ("equilibrium", "kinetostatic"),
}
MANY = 500
SHARED = ({"served", "chromium"}, {"client", "site"}, {"simulated"})
"""Fixtures of a whole session that cost as much as many tests: a browser and a server, a service, runs of the joint."""


DEAR_METHODS = {"implicit-euler", "generalized-alpha"}
"""Methods that are no default and compile for a quarter of a minute each: their cases of a test of many methods are slow."""


def pytest_itemcollected(item):
    """Mark the cases of `DEAR_METHODS`; the other methods of each kind stay among the fast tests."""
    values = item.callspec.params.values() if hasattr(item, "callspec") else ()
    if DEAR_METHODS & {name for each in values if isinstance(name := getattr(each, "method", each), str)}:
        item.add_marker(pytest.mark.slow)


@pytest.hookimpl(trylast=True)  # after tests have been left out
def pytest_collection_modifyitems(items):
    """One process of a session runs all tests that share such a fixture.

    They stand at the head of its share of the tests, as `--dist worksteal` deals them out: idle processes take from the
    end of what others have left.
    """
    processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if processes > 1:
        items[:] = [item for share in shares(items, processes) for item in share]


def shares(items, processes):
    """What each process gets: tests that share a fixture, and as many of the others as make all shares equal."""
    heads, others = [[] for _ in range(processes)], []
    for item in items:
        groups = [group for group, names in enumerate(SHARED) if names & set(item.fixturenames)]
        (heads[groups[0] % processes] if groups else others).append(item)
    for left, head in zip(range(processes, 0, -1), heads, strict=True):
        waiting = len(others) + sum(map(len, heads[processes - left :]))
        more = max(0, waiting // left - len(head))
        yield head + others[:more]
        del others[:more]


def pytest_collection_finish(session):
    """Two of the processes of a long session fill an empty compile cache side by side, each with other models first.

    Otherwise tests of both would compile the same kernels at the same time. From a full cache it takes two seconds. The
    other processes, which work while tests wait for processes, polls and disks, wait for the balances: a kernel that a
    test compiled alone would be compiled once more with its model. Nobody waits for the rollers, which take four times
    as long and which few tests ask for.
    """
    from tripod_doe.joint.simulator import simulator

    gc.freeze()  # what has been collected stays: to look through it again and again took 2 to 3 % of all tests
    gc.enable()
    gc.set_threshold(20_000, 20, 20)  # charts and cubes make many objects: by default 3 to 5 % of the time is looking
    if len(session.items) > MANY:
        for model in MODELS_OF_PROCESS.get(os.environ.get("PYTEST_XDIST_WORKER", ""), ()):
            simulator.compile(model, next(iter(simulator.methods({"model": model}))))


@pytest.fixture(scope="session")
def chromium():
    """A browser without a window."""
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        yield browser
        browser.close()


@pytest.fixture
def write_study(tmp_path):
    """Write a study file from its text and return its path."""

    def write(text: str, name: str = "study.toml") -> Path:
        path = tmp_path / name
        path.write_text(textwrap.dedent(text))
        return path

    return write


@pytest.fixture
def charts_not_drawn(monkeypatch):
    """Pages whose charts are empty: drawing takes most of the time of a small study; tests of pages draw them."""
    from tripod_doe.page_parts.charts.chart import Chart

    monkeypatch.setattr(Chart, "svg", lambda chart: f"<svg><title>{chart.title}</title></svg>")


@pytest.fixture
def pages_not_made(monkeypatch):
    """Studies without a page, for tests that look at nothing but cubes: it takes two thirds of the time of a small one."""
    monkeypatch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
