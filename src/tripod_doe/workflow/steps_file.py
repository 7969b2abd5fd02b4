"""The states of a workflow's steps in its directory, for programs that watch it run."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tripod_doe.atomic_files import replace_text

STEPS = "steps.json"
"""File of a workflow's directory: a list with name, state, seconds and detail of each step that ended or runs."""


def write_steps(directory: Path, steps: Iterable[dict[str, Any]]) -> None:
    """Replace the states of the steps.

    Raises:
        StorageError: If they cannot be written.
    """
    replace_text(directory / STEPS, json.dumps(list(steps)))
