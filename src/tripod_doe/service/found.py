"""Result directories in the folder that the command line filled: shown beside the runs, and left alone."""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from tripod_doe.errors import ForbiddenError
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import RefusedError
from tripod_doe.study.journal import journal_path


def found_directories(folder: Path, known: Collection[str]) -> list[Path]:
    """Result directories of studies in a folder, without those of known names."""
    return [
        path
        for path in sorted(folder.iterdir())
        if path.name not in known
        and not path.is_symlink()
        and (path / "study.toml").is_file()
        and journal_path(path).is_file()
    ]


def check_delivered(directory: Path, found: bool) -> None:
    """Refuse a result directory from which a client could get what its owner keeps elsewhere, or keeps private.

    The server runs as one user and answers others who have the token. Nothing is delivered through a symbolic link. In
    a directory that the command line filled, files belong to its owner; and where the directory itself is open to other
    users of the machine, a file that is closed to them was closed on purpose.

    Parameters
    ----------
    directory
        The result directory.
    found
        Whether the command line filled it.

    Raises
    ------
    RefusedError
        403 with the name of the file and what to do.
    """
    try:
        top = os.lstat(directory)
        for path, state in _entries(directory):
            name = path.relative_to(directory.parent)
            if stat.S_ISLNK(state.st_mode):
                raise RefusedError(403, f"{name}: a symbolic link, and none is followed: put the file itself there")
            if found and state.st_uid != top.st_uid:
                raise RefusedError(403, f"{name}: another user owns this file than the directory: nothing is shown")
            if found and _is_private(state) and not _is_private(top):
                raise RefusedError(
                    403,
                    f"{name}: private (mode {stat.S_IMODE(state.st_mode):04o}) in a directory that is not: "
                    "make both so, or neither",
                )
    except OSError:  # it is being deleted, or not yet there: what reads it says so
        return


def _is_private(state: os.stat_result) -> bool:
    """Whether other users can neither read a file nor look into a directory."""
    return not state.st_mode & (stat.S_IRGRP | stat.S_IROTH)


def _entries(directory: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """The directory and all in it that is not hidden, links not followed."""
    state = os.lstat(directory)
    yield directory, state
    if stat.S_ISDIR(state.st_mode):
        for entry in sorted(os.listdir(directory)):
            if not entry.startswith("."):
                yield from _entries(directory / entry)


def plan_found(path: Path, limits: Limits) -> dict[str, Any]:
    """Counts of the study of a result directory, as `plans.plan_upload` gives them.

    Raises
    ------
    InputError
        If its study can no longer be read, or names a function.
    """
    from tripod_doe.service.plans import plan_study
    from tripod_doe.study.result_folder import stored_study

    study = stored_study(path, limits.points)
    if study.file.study.function is not None:
        raise ForbiddenError(f"function = {study.file.study.function!r}: studies of functions are not shown")
    return plan_study(study, limits, False)
