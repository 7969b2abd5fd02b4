"""Result directories in the folder that the command line filled: shown beside the runs, and left alone."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from tripod_doe.service.limits import Limits
from tripod_doe.study.journal import FOLDER, Journal, journal_path


def found_directories(folder: Path, known: Collection[str]) -> list[Path]:
    """Result directories of studies in a folder, without those of known names."""
    return [
        path
        for path in sorted(folder.iterdir())
        if path.name not in known and (path / "study.toml").is_file() and journal_path(path).is_file()
    ]


def plan_found(path: Path, limits: Limits) -> dict[str, Any]:
    """Counts of the study of a result directory, as `plans.plan_upload` gives them.

    Raises
    ------
    InputError
        If its study can no longer be read, or names a function.
    """
    from tripod_doe.service.plans import plan_study
    from tripod_doe.study.definition import parse_study

    with Journal(path, read_only=True) as journal:
        folder = journal.recall(FOLDER)
    text = (path / "study.toml").read_text(encoding="utf-8")
    return plan_study(parse_study(text, path.name, Path(folder) if folder else path, functions=False), limits, False)
