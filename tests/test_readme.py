"""The README works as pasted: its commands in their order, its Python block as a plain script."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from started import Process

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text()
FIRST, ACTIVATE, TESTS, *OTHERS = re.findall(r"```bash\n(.*?)```", TEXT, re.DOTALL)


TWO_STEPS = """
[workflow]
name = "Two steps"
[steps.map]
kind = "study"
study = "../studies/thrust_map.toml"
[steps.summary]
kind = "report"
inputs = ["map"]
[quick.map.factors]
joint_angle_deg = { values = [5, 10] }
"""
"""In place of a workflow that takes minutes; all kinds of steps run in tests/workflow."""


@pytest.fixture
def clone(tmp_path):
    """What a fresh clone holds after the installation; results and new files stay here."""
    folder = tmp_path / "clone"
    folder.mkdir()
    (folder / "studies").symlink_to(ROOT / "studies")
    shutil.copytree(ROOT / "measurements", folder / "measurements")
    table = folder / "measurements" / "rig" / "records.csv"  # tests/workflow/test_fit.py fits all of them
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:4]))
    (folder / "optimisations").mkdir()
    for path in (ROOT / "optimisations").glob("*.toml"):  # tests/workflow/test_optimise.py searches for long
        fewer = re.sub(r"evaluations = \d+", "evaluations = 40", path.read_text())
        (folder / "optimisations" / path.name).write_text(fewer.replace("confirmed = 4", "confirmed = 1"))
    (folder / "workflows").mkdir()
    (folder / "workflows" / "paper.toml").write_text(TWO_STEPS)
    (folder / ".venv").symlink_to(sys.prefix)
    return folder


def run(clone, script):
    """Run a script as somebody would who has pasted it, with nothing of this environment on the path."""
    path = os.pathsep.join(part for part in os.environ["PATH"].split(os.pathsep) if not part.startswith(sys.prefix))
    return subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=clone,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_commands_that_install_are_the_ones_that_ci_runs():
    installed = r"python3 -m venv --without-pip \.venv && python3 -m pip --python \.venv/bin/python install -q "
    assert re.fullmatch(installed + r"\. && \.venv/bin/tripod-doe run studies/\w+\.toml --out results/\w+\n", FIRST)
    assert re.fullmatch(
        installed
        + r"pip && \.venv/bin/python -m pip install -q --no-compile -e '\.\[test\]' && \.venv/bin/python -m pytest -n 3 --dist worksteal -m \"not slow\"\n",
        TESTS,
    )


@pytest.mark.slow
@pytest.mark.skipif(not (Path(sys.prefix) / "bin" / "activate").exists(), reason="not in a virtual environment")
def test_the_commands_work_as_pasted_in_their_order_and_then_the_python_block_as_a_plain_script(clone, monkeypatch):
    """`workflow/test_from_anywhere.py` runs scripts without results, and shows that workers need no guard of __main__."""
    monkeypatch.chdir(clone)
    done = run(clone, f"{FIRST.rpartition('&& ')[2]}{ACTIVATE}tripod-doe --version")
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.endswith(f"tripod-doe {version('tripod-doe')}\n")
    assert "tripod-doe workflow workflows/paper.toml" in "".join(OTHERS)
    for command in "".join(OTHERS).splitlines():  # what follows starts in the same way: it is forked
        name, *words = shlex.split(command)
        assert name == "tripod-doe"
        process = Process(["-m", "tripod_doe.cli", *words])
        _, complaints = process.communicate(600)
        assert process.returncode == 0, complaints[-2000:]
    (clone / "script.py").write_text(re.search(r"```python\n(.*?)```", TEXT, re.DOTALL)[1])
    done = subprocess.run([sys.executable, "script.py"], cwd=clone, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (clone / "results" / "thrust_map" / "cube.nc").exists()
