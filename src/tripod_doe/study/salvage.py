"""What can still be read of a damaged archive, in a new one, so that only what is lost is computed again."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from tripod_doe.study.archive import BLOCK_COLUMNS, is_whole, write_archive
from tripod_doe.study.journal import journal_path, unreadable

_ROW_BYTES = 500  # no block is stored in less
_ALL = ", ".join(BLOCK_COLUMNS)


def salvage(directory: Path) -> str:
    """Replace a damaged archive by one with all blocks that can be read; the damaged file stays beside it.

    Parameters
    ----------
    directory
        The result directory, held by this process.

    Returns
    -------
    str
        What was lost, for people; empty where the journal is whole or absent.

    Raises
    ------
    CubeError
        If nothing of it can be read.
    """
    path = journal_path(directory)
    if not path.exists():
        return ""
    with closing(sqlite3.connect(path)) as journal:
        if _is_whole(journal):
            return ""
        rows = _readable(journal, path.stat().st_size)
        notes = _attempt(journal, "SELECT key, value FROM meta")
    whole = [row for row in rows if row is not None and is_whole(*row)]
    if not whole:
        raise unreadable(path)
    kept = _free_name(path)
    os.link(path, kept)
    for ending in ("-wal", "-shm"):  # what they held is in the rows; beside another journal they would damage it
        path.with_name(path.name + ending).unlink(missing_ok=True)
    write_archive(path, whole, dict(notes))
    lost = len(rows) - len(whole)
    told = f"{len(whole):,} blocks can be read, {f'at least {lost:,} cannot' if lost else 'others may be lost'}"
    return (
        f"{path}: the journal is damaged: {told}; what is lost is computed again; the old file is kept as {kept.name}"
    )


def _is_whole(journal: sqlite3.Connection) -> bool:
    """Whether structure and contents of a journal are as they were written."""
    try:
        if journal.execute("PRAGMA integrity_check(1)").fetchone() != ("ok",):
            return False
        return all(is_whole(*row) for row in journal.execute(f"SELECT {_ALL} FROM block"))
    except sqlite3.DatabaseError:
        return False


def _readable(journal: sqlite3.Connection, size: int) -> list[tuple[Any, ...] | None]:
    """Every block by its number, None for one that cannot be read; a journal numbers them without gaps."""
    counted = next(iter(_attempt(journal, "SELECT max(id) FROM block")), (None,))[0]
    rows: list[tuple[Any, ...] | None] = []
    for number in range(1, (counted or size // _ROW_BYTES) + 1):
        try:
            rows.append(journal.execute(f"SELECT {_ALL} FROM block WHERE id = ?", (number,)).fetchone())
        except (sqlite3.DatabaseError, OverflowError):
            rows.append(None)
    while rows and rows[-1] is None and not counted:  # their number was a guess
        rows.pop()
    return rows


def _attempt(journal: sqlite3.Connection, question: str) -> list[tuple[Any, ...]]:
    """All rows of an answer, none where it cannot be read."""
    try:
        return journal.execute(question).fetchall()
    except sqlite3.DatabaseError:
        return []


def _free_name(path: Path) -> Path:
    """A name for the damaged file that is not taken."""
    names = (path.with_name(f"{path.stem}.damaged{number or ''}{path.suffix}") for number in range(1_000_000))
    return next(name for name in names if not name.exists())
