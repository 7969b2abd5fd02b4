"""The states of a workflow's steps, or of the stages of a search, in its directory, for programs that watch it run."""

import json
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from tripod_doe.errors import StorageError, printable
from tripod_doe.files.checksum_list import listed_json, remove_listed, remove_pages, write_listed
from tripod_doe.study.result_directory.latest_run import FOUND, failed_analyses, found_in

STEPS = "steps.json"
"""File of a directory: a list with name, state, seconds and detail of each step or stage that ended or runs.

The key `FOUND` holds the sentence on what a step or stage looked for.
"""

_EVERY = 0.5  # seconds between two states of a stage
_MOST_BYTES = 4_000_000  # some ten thousand steps
_LONGEST = 4_000  # characters of all sentences together


def write_steps(directory: Path, steps: Iterable[dict[str, Any]]) -> None:
    """Replace the states of the steps; StorageError if they cannot be written."""
    write_listed(directory / STEPS, json.dumps(list(steps)))


def read_steps(directory: Path) -> list[dict[str, Any]]:
    """Read the states of the steps; empty where they are missing, damaged or too large to be ours."""
    steps = listed_json(directory / STEPS, _MOST_BYTES)
    return steps if isinstance(steps, list) else []


def begin_search(directory: Path, file: str, text: str) -> None:
    """Prepare a directory for a new search: remove what an earlier one left there, all but its points.

    A search that is killed then leaves no results of another one as its own.

    Args:
        file: Name of the copy of its file.
        text: The file.

    Raises:
        StorageError: If a file cannot be written.
    """
    remove_pages(directory)
    remove_listed(directory, {STEPS, file})  # the copy may be the file that runs: it is replaced
    write_listed(directory / file, text)


class Stages:
    """The stages of a search, one after the other; a full disk does not end the search here, but at its results.

    Args:
        directory: Directory of the search.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._stages: list[dict[str, Any]] = []
        self._began = self._written = 0.0

    def begin(self, name: str, detail: str = "") -> None:
        """End the current stage, and begin another one."""
        self._close("finished")
        self._stages.append({"name": name, "state": "running", "seconds": None, "detail": detail})
        self._began = time.monotonic()
        self._write()

    def update(self, detail: str, **values: Any) -> None:
        """Report the progress of the current stage, with more values by name; writes at most twice a second."""
        self._stages[-1] |= {"detail": detail, **values}
        if time.monotonic() > self._written + _EVERY:
            self._write()

    def end(self, found: str = "") -> None:
        """End the current, last stage, with the sentence on what the search looked for."""
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
    """The sentences on what the latest run of a directory looked for, and on its analyses that failed.

    A sentence for each study of a workflow; empty if the run looked for nothing, and no analysis failed.
    """
    failed = [f"Analysis {name} was not made: {reason}." for name, reason in failed_analyses(directory).items()]
    if sentences := list(filter(None, [found_in(directory), *failed])):
        return " ".join(sentences)[:_LONGEST]
    try:
        steps = read_steps(directory)
        return printable(" ".join(step[FOUND] for step in steps if step.get(FOUND)))[:_LONGEST]
    except (TypeError, AttributeError):  # not as we write it
        return ""
