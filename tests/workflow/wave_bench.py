"""A function of four candidates, which logs its calls, and a study of it with model = "auto"."""

from __future__ import annotations

import uuid
from pathlib import Path

import tripod_doe as td

WAVE = """
import os, time
from tripod_doe.model_interface import Candidate
def wave(x, z=0.0, model=3, slow=0.0):
    with open(os.path.join(os.path.dirname(__file__), "log"), "a") as log:
        log.write(f"{x} {z} {model}\\n")
    time.sleep(slow * float(os.environ.get("PACE", "0")))
    miss = {0: 0.002 + (0.2 if x > 0.5 else 0.0), 1: 0.01, 2: 0.0, 3: 0.0}[int(model)]
    return {"y": (10 + x) * (1 + miss), "y_error": (10 + x) * (0.02 if model == 2 else 0.001)}
wave.candidates = (
    Candidate({"model": 0}, 1e-6, 1), Candidate({"model": 1}, 1e-3, 1, substitute=True),
    Candidate({"model": 2}, 1.0, 1, full=True), Candidate({"model": 3}, 3.0, 1, full=True),
)
"""
STUDY = """
[study]
name = "wave"
function = "wave:wave"
[base]
model = "auto"
[factors]
x = {low = 0, high = 1, count = 11}
z = {values = [0, 1, 2]}
[accuracy]
y = 0.03
"""


class Bench:
    """A folder with a function of four candidates, which logs its calls, and studies of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.module = f"wave_{uuid.uuid4().hex}"  # all tests run in one process, which imports a name once
        (folder / f"{self.module}.py").write_text(WAVE)

    def write(self, text: str, name: str = "study.toml") -> Path:
        path = self.folder / name
        path.write_text(text.replace("wave:wave", f"{self.module}:wave"))
        return path

    def run(self, text: str, out: str = "out"):
        return td.run(self.write(text), self.folder / out, workers=0, progress=False)

    def calls(self) -> list[str]:
        log = self.folder / "log"
        return log.read_text().splitlines() if log.exists() else []
