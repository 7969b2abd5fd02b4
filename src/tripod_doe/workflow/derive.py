"""Add responses to existing results: makes cube, analyses and report again, and runs no point."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tripod_doe.errors import InputError, option
from tripod_doe.study.result_directory.derived_responses import with_responses
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.study.result_directory.open_cube import points_of
from tripod_doe.workflow.run_study import RunSummary, summary_of


def derive(
    directory: str | Path, file: str | Path | None = None, drop: Collection[str] = (), take_over: bool = False
) -> RunSummary:
    """Add the responses of a file to the study of a result directory, and write its cube, analyses and report again.

    Args:
        directory: The result directory; a study that was interrupted keeps its missing points.
        file: TOML file with tables ``[responses.NAME]``; one with a known name takes the place of the older one.
        drop: Names of responses that are removed from the study.
        take_over: Take the lock of a process that is known to be dead.

    Raises:
        InputError: If the file holds anything else, a formula is wrong, the results do not hold an output that it
            uses, or there is nothing to add or drop; nothing is changed.
        StorageError: If writing fails; the older files stay.
    """
    path = Path(directory)
    if file is None and not drop:
        raise InputError(
            f"{option('drop')}: nothing to add or drop: name a file with tables [responses.NAME], or responses"
        )
    study, added = with_responses(path, None if file is None else Path(file), drop)
    with ResultDirectory(path, take_over) as held:
        asked = points_of(study, path)
        held.accept(asked)
        held.note_derived(added, drop)
        missing = held.resume.missing(asked).size
        written = held.write_cube(asked, f"tripod-doe derive: {', '.join(each.name for each in study.responses)}")
        done = int(asked.to_compute.sum()) - missing
        return summary_of(asked, held, written, computed=0, reused=done, seconds=0.0, complete=not missing)
