"""The states of a workflow's steps, or of the stages of a search, in its directory, for programs that watch it run."""

import json
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from tripod_doe.atomic_files import replace_text
from tripod_doe.errors import StorageError, printable
from tripod_doe.study.result_directory.look_for import FOUND, found_in

STEPS = "steps.json"
"""File of a directory: a list with name, state, seconds and detail of each step or stage that ended or runs.

What a step or stage was to look for stands in it under `FOUND`, in a sentence.
"""

_EVERY = 0.5  # seconds between two states of a stage
_LONGEST = 4_000  # characters of all sentences


def write_steps(directory: Path, steps: Iterable[dict[str, Any]]) -> None:
    """Replace the states of the steps; StorageError if they cannot be written."""
    replace_text(directory / STEPS, json.dumps(list(steps)))


class Stages:
    """The stages of a search one after the other; a disk that is full does not end it here, but at its results.

    Args:
        directory: Of the search.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._stages: list[dict[str, Any]] = []
        self._began = self._written = 0.0

    def begin(self, name: str, detail: str = "") -> None:
        """End the stage at work, and begin another one."""
        self._close("finished")
        self._stages.append({"name": name, "state": "running", "seconds": None, "detail": detail})
        self._began = time.monotonic()
        self._write()

    def update(self, detail: str, **values: Any) -> None:
        """Say how far the stage at work is, and more of it by name; written twice a second at most."""
        self._stages[-1] |= {"detail": detail, **values}
        if time.monotonic() > self._written + _EVERY:
            self._write()

    def end(self, found: str = "") -> None:
        """End the stage at work, which is the last one, with the sentence on what the search was to look for."""
        self._close("finished")
        self._stages[-1] |= {FOUND: found} if found else {}
        self._write()

    def _close(self, state: str) -> None:
        if self._stages:
            self._stages[-1] |= {"state": state, "seconds": round(time.monotonic() - self._began, 3)}

    def _write(self) -> None:
        self._written = time.monotonic()
        with suppress(StorageError):
            write_steps(self._directory, self._stages)


def found_sentences(directory: Path) -> str:
    """What the latest run of a directory was to look for, in a sentence; a sentence for each study of a workflow.

    Empty where nothing was to be looked for.
    """
    if sentence := found_in(directory):
        return sentence
    try:
        steps = json.loads((directory / STEPS).read_text(encoding="utf-8"))
        return printable(" ".join(step[FOUND] for step in steps if step.get(FOUND)))[:_LONGEST]
    except (OSError, ValueError, TypeError, AttributeError):  # missing, or not as we write it
        return ""
