"""How a run ended, from what it left in its directory: the next server sees the same, whoever started the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tripod_doe.service.processes import last_words
from tripod_doe.service.progress import PointCounts
from tripod_doe.service.runs import Run, State
from tripod_doe.study.results import is_shown
from tripod_doe.workflow.steps_file import STEPS

__all__ = ["ending_of"]

_SILENT = "its process ended without a word; resume goes on at the next missing point"


def ending_of(run: Run, counts: PointCounts, steps: Sequence[Mapping[str, Any]], directory: Path) -> tuple[State, str]:
    """State and message of a run whose process has ended.

    Parameters
    ----------
    run
        As it was known last.
    counts, steps
        What is there of it now.
    directory
        Its result directory.
    """
    if run.kind == "workflow":
        left = [step["name"] for step in steps if step["state"] in ("waiting", "failed", "blocked")]
        whole = not left and _has_report(directory)
        failed = [f"{step['name']}: {step['detail']}" for step in steps if step["state"] == "failed"]
    else:
        whole = not counts.missing and is_shown(directory) and _has_report(directory)
        failed = []
    if whole:
        return State.FINISHED, ""
    if run.state is State.STOPPING:
        return State.STOPPED, ""
    if run.place:
        return State.STOPPED, "points are missing: run the study again from the command line"
    return State.FAILED, "; ".join(failed) or last_words(directory) or _SILENT


def _has_report(directory: Path) -> bool:
    """Whether the page is there, which is written last: after the cube of a study, after the last step of a chain."""
    made = [directory / name for name in ("cube.nc", STEPS)]
    try:
        written = (directory / "report" / "index.html").stat().st_mtime_ns
        return all(written >= path.stat().st_mtime_ns for path in made if path.exists())
    except OSError:
        return False
