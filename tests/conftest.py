from __future__ import annotations

import os
import sys
import textwrap
from pathlib import Path

import pytest

# tests start a hundred processes: each would compile our modules to bytecode anew where the surroundings keep it from disk
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# before numpy is loaded, here and in what tests start: problems of linear algebra are small, and the threads of several
# processes on few cores wait for each other, at full load
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# plain modules beside the tests (equal_cubes.py, joint/reference.py) are imported by name
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent / "joint"))
sys.path.insert(0, str(Path(__file__).parent / "analysis"))
sys.path.insert(0, str(Path(__file__).parent / "workflow"))
sys.path.insert(0, str(Path(__file__).parent / "service"))


MODELS_OF_PROCESS = {
    "gw0": ("rollers", "equilibrium", "kinetostatic"),
    "gw1": ("equilibrium", "kinetostatic", "rollers"),
    "gw2": ("equilibrium", "kinetostatic", "rollers"),
}
MANY = 500


def pytest_collection_finish(session):
    """Two of the processes of a long session fill an empty compile cache side by side, each with other models first.

    Otherwise tests of both would compile the same kernels at the same time. From a full cache it takes two seconds. The
    third process, which works while tests wait for processes, polls and disks, waits for them: a kernel that a test
    compiled alone would be compiled once more with its model.
    """
    from tripod_doe.joint.simulator import simulator

    if len(session.items) > MANY:
        for model in MODELS_OF_PROCESS.get(os.environ.get("PYTEST_XDIST_WORKER", ""), ()):
            simulator.compile(model, next(iter(simulator.methods({"model": model}))))


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
    from tripod_doe.report.figures.chart import Chart

    monkeypatch.setattr(Chart, "svg", lambda chart: f"<svg><title>{chart.title}</title></svg>")
