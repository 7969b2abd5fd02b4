from __future__ import annotations

import sys
import textwrap
from pathlib import Path

import pytest

# plain modules beside the tests (equal_cubes.py, joint/reference.py) are imported by name
sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent / "joint"))
sys.path.insert(0, str(Path(__file__).parent / "analysis"))


@pytest.fixture
def write_study(tmp_path):
    """Write a study file from its text and return its path."""

    def write(text: str, name: str = "study.toml") -> Path:
        path = tmp_path / name
        path.write_text(textwrap.dedent(text))
        return path

    return write
