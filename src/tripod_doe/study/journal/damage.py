"""Damage of a journal: detected by checksums, repaired by a new journal with all intact blocks."""

import hashlib
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from functools import cache, partial
from pathlib import Path
from typing import Any

from tripod_doe.errors import CubeError, option
from tripod_doe.files.checksum_list import number_in
from tripod_doe.files.regular_files import refuse_irregular
from tripod_doe.number_text import count_of
from tripod_doe.study.journal.rows import (
    BLOCK_COLUMNS,
    NOTE_COLUMNS,
    PAGE_BYTES,
    SCHEMA,
    BlockRow,
    DamagedRowError,
    NoteRow,
    write_journal,
)
from tripod_doe.study.journal.sqlite_pages import logged_rows, stored_rows

SHOWN, KERNELS, COMPUTING = "shown", "kernel_source_hash", "computing"
"""Notes: the state of the journal that the cube shows, the kernels of new blocks, and whether points are computed."""

OUTDATED = "outdated"
"""Note: whether the study was replaced since the cube was written, and with it perhaps which points it has."""

POINTS = "points"
"""Note: how many points the study computes, which is known only after the pilot of a multifidelity design."""

STUDY, STUDY_HASH = "study_digest", "study_hash"
"""Notes on the study: the digest of its text, and its hash, which its cube names, too."""

REPAIRS = "repairs"
"""Note: how often the journal was repaired."""

_WITHOUT_ACCESS = {
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_NOMEM,
    sqlite3.SQLITE_PROTOCOL,
}
_MAGIC = b"SQLite format 3\0"
_HEADER = _MAGIC + PAGE_BYTES.to_bytes(2, "big")
_VERSIONS, _FRACTIONS = (1, 2), bytes((0, 64, 32, 32))  # the next fields of the header
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
_MOST_DIGITS = 18  # of a number in a note
_COMMIT = 0.5  # seconds that a commit may take between its log and its end
_BLOCKS = f"SELECT {', '.join(BLOCK_COLUMNS)} FROM block ORDER BY id"
_NOTES = f"SELECT {', '.join(NOTE_COLUMNS)} FROM note"
_STRUCTURE = "SELECT type, name, tbl_name, sql FROM sqlite_schema ORDER BY name"


def text_digest(text: bytes) -> str:
    """Digest of the text of a study, as a note."""
    return hashlib.sha256(text).hexdigest()


def is_damage(error: sqlite3.Error) -> bool:
    """Whether an error is about the file's content, not about locks, permissions or the disk."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF not in _WITHOUT_ACCESS


def _refuse_pipes(path: Path) -> None:
    """Refuse an SQLite file if something other than a file is in its place or a companion's (CubeError)."""
    for name in ("", "-wal", "-shm", "-journal"):
        refuse_irregular(path.with_name(f"{path.name}{name}"), CubeError)


def refuse_strange_files(path: Path) -> None:
    """Refuse an SQLite file with companions that no program of ours leaves.

    A rollback journal of a transaction over several files ends with the name of another file, which SQLite deletes
    during rollback, in any folder. See "The Super-Journal" in SQLite's description of its file format.

    Raises:
        CubeError: If it is not a file, or a link to a file that is no database: SQLite would delete the files that have
            the names of its companions.
        DamagedRowError: If the rollback journal names another file.
    """
    _refuse_pipes(path)
    if path.is_symlink() and path.exists():
        with path.open("rb") as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise CubeError(f"{path}: a link to a file that is no journal: delete the link")
    journal = path.with_name(f"{path.name}-journal")
    try:
        with journal.open("rb") as stream:
            stream.seek(-len(_JOURNAL_MAGIC), os.SEEK_END)
            ending = stream.read()
    except OSError:  # none is there, or it is too short for a name
        return
    if ending == _JOURNAL_MAGIC:
        raise DamagedRowError(f"{journal.name} names another file, which SQLite would delete: remove {journal.name}")


def connected(path: Path, mode: str) -> sqlite3.Connection:
    """Open an existing journal, to read ("ro") or to write ("rw"); each statement is a transaction of its own.

    After a kill during a write, SQLite first restores the page, which needs write access.

    Raises:
        DamagedRowError: If it has other tables, or views or triggers, which would run whenever it is read or written,
            or see `refuse_strange_files`.
        sqlite3.Error: If it cannot be opened.
    """
    refuse_strange_files(path)
    uri = f"{path.absolute().as_uri()}?mode={mode}"
    connection = sqlite3.connect(uri, timeout=60.0, isolation_level=None, check_same_thread=False, uri=True)
    try:
        if connection.execute(_STRUCTURE).fetchall() != _structure_of_a_journal():
            raise DamagedRowError("its tables are not the tables of a journal")
    except (DamagedRowError, sqlite3.Error) as error:
        connection.close()
        code = getattr(error, "sqlite_errorcode", 0)
        if mode == "ro" and code & 0xFF == sqlite3.SQLITE_READONLY:
            return connected(path, "rw")
        raise
    return connection


@cache
def _structure_of_a_journal() -> list[tuple[str, ...]]:
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(SCHEMA)
        return connection.execute(_STRUCTURE).fetchall()


def damage(path: Path) -> str:
    """Look for damage in the structure of a journal, in its log, and in each of its rows.

    Returns:
        The first damage, in words; empty for an intact journal.

    Raises:
        sqlite3.Error: If the file cannot be read for another reason.
        CubeError: If anything else than a file is there.
    """
    _refuse_pipes(path)
    with path.open("rb") as stream:
        header = stream.read(24)
    if header[:18] != _HEADER or not {*header[18:20]} <= {*_VERSIONS} or header[20:] != _FRACTIONS:
        return "its first bytes are not the header of a journal"
    logged = {row.id for row in _blocks(logged_rows(path))}
    try:
        with closing(connected(path, "ro")) as connection:
            return (
                _structure_damage(connection)
                or _block_damage(connection)
                or _note_damage(connection)
                or _log_damage(connection, logged)
            )
    except sqlite3.Error as error:
        if not is_damage(error):
            raise
        return str(error)
    except (DamagedRowError, OverflowError) as error:  # the latter of lengths of a row
        return str(error)


def _structure_damage(connection: sqlite3.Connection) -> str:
    (answer,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
    return "" if answer == "ok" else " ".join(str(answer).removeprefix("*** in database main ***").split())


def _block_damage(connection: sqlite3.Connection) -> str:
    for number, values in enumerate(connection.execute(_BLOCKS), 1):
        if values[0] != number:
            return f"block {number} is not there"
        if reason := _reason(BlockRow(*values).block):
            return f"block {number}: {reason}"
    return ""


def _note_damage(connection: sqlite3.Connection) -> str:
    notes = [NoteRow(*values) for values in connection.execute(_NOTES)]
    for note in notes:
        if reason := _reason(note.check):
            return f"note {note.key!r}: {reason}"
    for note in notes:
        if note.key in (SHOWN, REPAIRS, POINTS) and (reason := _reason(partial(counted, note.key, note.value))):
            return reason
    shown = next((counted(SHOWN, note.value) for note in notes if note.key == SHOWN), 0)
    ((newest,),) = connection.execute("SELECT coalesce(max(id), 0) FROM block")
    return f"block {shown} is not there" if shown > newest else ""


def _log_damage(connection: sqlite3.Connection, logged: set[int]) -> str:
    """Look for blocks in the log that SQLite ignores because of damage before them."""

    def hidden() -> int:
        return len(logged - {number for (number,) in connection.execute("SELECT id FROM block")})

    if hidden():
        time.sleep(_COMMIT)  # a block during its commit becomes valid soon
    return f"its log hides {count_of(hidden(), 'block')} behind damage" if hidden() else ""


def _reason(check: Callable[[], object]) -> str:
    try:
        check()
    except DamagedRowError as error:
        return str(error)
    return ""


def counted(key: str, note: str | None) -> int:
    """The number in a note, 0 where it is not there; DamagedRowError if it is none: a checksum shows accidents only."""
    if note is not None and not (note.isascii() and note.isdigit() and len(note) <= _MOST_DIGITS):
        raise DamagedRowError(f"note {key!r} is no number")
    return int(note or 0)


def rescue(path: Path, reason: str) -> str:
    """Replace a damaged journal by a new one with all intact blocks; keep the damaged file next to it.

    Args:
        path: The journal, whose directory this process holds.

    Returns:
        A sentence on kept and lost blocks.

    Raises:
        CubeError: If nothing of it can be read.
    """
    whole = {row.id: row.kernels for row in _blocks(stored_rows(path))}
    notes = {note.key: note.value for note in _notes(stored_rows(path))}
    for key in (SHOWN, REPAIRS, POINTS):
        if _reason(partial(counted, key, notes.get(key))):
            del notes[key]
    if not whole:
        remedy = f"move it elsewhere or choose another {option('out')}"
        raise CubeError(f"{path}: not a readable journal ({reason}); {remedy}")
    newest = max(*whole, int(notes.pop(SHOWN, 0)))
    if KERNELS not in notes and len(kernels := set(whole.values())) == 1:
        notes[KERNELS] = kernels.pop()
    notes[REPAIRS] = str(int(notes.get(REPAIRS, 0)) + 1)
    kept = _free_name(path)
    os.link(path, kept)
    write_journal(path, _renumbered(_blocks(stored_rows(path)), sorted(whole)), notes, number_in(path))
    return (
        f"{path}: the journal is damaged ({reason}): {count_of(len(whole), 'block')} can be read, "
        f"{f'at least {newest - len(whole):,} cannot' if newest > len(whole) else 'others may be lost'}; "
        f"what is lost is computed again; the old file is kept as {kept.name}"
    )


def _blocks(rows: Iterable[tuple[Any, ...]]) -> Iterator[BlockRow]:
    """The intact blocks among some rows."""
    for row in rows:
        if len(row) == len(BLOCK_COLUMNS) and not _reason((block := BlockRow(*row)).check):
            yield block


def _notes(rows: Iterable[tuple[Any, ...]]) -> Iterator[NoteRow]:
    """The intact notes among some rows."""
    for row in rows:
        if len(row) == len(NOTE_COLUMNS) and not _reason((note := NoteRow(*row)).check):
            yield note


def _renumbered(blocks: Iterable[BlockRow], numbers: Sequence[int]) -> Iterator[BlockRow]:
    """Blocks without repetition in the order of their numbers, renumbered without gaps."""
    places = {number: place for place, number in enumerate(numbers, 1)}
    for block in blocks:
        if (place := places.pop(block.id, None)) is not None:
            yield block.numbered(place)


def _free_name(path: Path) -> Path:
    """A name for the damaged file that is not taken."""
    names = (path.with_name(f"{path.stem}.damaged{number or ''}{path.suffix}") for number in range(1_000_000))
    return next(name for name in names if not name.exists())
