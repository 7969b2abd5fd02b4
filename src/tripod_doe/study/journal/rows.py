"""Rows of the two tables of a journal, with checksums that detect damage."""

from __future__ import annotations

import json
import math
import secrets
import sqlite3
import struct
import zlib
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np

from tripod_doe.files.atomic_files import replace_file
from tripod_doe.files.checksum_list import MOST_RESULTS
from tripod_doe.model_interface import Outcome
from tripod_doe.study.journal.finished_block import FinishedBlock, decode, encode

PAGE_BYTES = 16384
"""Size of a journal's pages: blocks of 100 kB are written and read twice as fast as with SQLite's 4096."""

SCHEMA = """
CREATE TABLE IF NOT EXISTS block (
    id INTEGER PRIMARY KEY,
    digest INTEGER NOT NULL,          -- CRC-32 of all other columns but the payload
    keys BLOB NOT NULL,               -- fingerprints of its points, 16 bytes each
    outcomes BLOB NOT NULL,           -- how its points ended, a byte each
    cpu_seconds REAL NOT NULL,
    wall_seconds REAL NOT NULL,
    worker TEXT NOT NULL,
    kernels TEXT NOT NULL,            -- hash of the sources of the kernels that computed it
    payload_digest INTEGER NOT NULL,  -- CRC-32 of the payload
    payload BLOB NOT NULL             -- all other results of its points
);
CREATE TABLE IF NOT EXISTS note (
    id INTEGER PRIMARY KEY,
    digest INTEGER NOT NULL,          -- CRC-32 of key and value
    key TEXT NOT NULL UNIQUE,
    value TEXT NOT NULL
);
"""

_OUTCOMES = {int(outcome) for outcome in Outcome}
_NO_RESULTS = (
    ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, MemoryError, RecursionError,
    struct.error,
)  # fmt: skip
"""Errors of reading results that another program wrote."""


class DamagedRowError(ValueError):
    """A row does not match its checksum."""


@dataclass(frozen=True)
class BlockRow:
    """A stored finished block."""

    id: int
    digest: int
    keys: bytes
    outcomes: bytes
    cpu_seconds: float
    wall_seconds: float
    worker: str
    kernels: str
    payload_digest: int
    payload: bytes

    @classmethod
    def of(cls, number: int, block: FinishedBlock, kernels: str) -> BlockRow:
        """The row of a block, with the number that it gets."""
        payload = encode(block.result)
        seconds = float(block.cpu_seconds), float(block.wall_seconds)
        ends = block.keys.tobytes(), block.result.outcome.tobytes(), *seconds, block.worker, kernels
        return cls(0, 0, *ends, zlib.crc32(payload), payload).numbered(number)

    def check_ends(self) -> None:
        """Raise DamagedRowError if anything but the payload is damaged."""
        try:
            whole = self._ends_digest() == self.digest and len(self.keys) == 16 * len(self.outcomes)
        except (TypeError, ValueError) as error:  # a value of another type
            raise DamagedRowError(str(error)) from error
        if not whole:
            raise DamagedRowError("its checksum does not fit")
        if not set(self.outcomes) <= _OUTCOMES:
            raise DamagedRowError("it holds an outcome that does not exist")
        if not (0 <= self.cpu_seconds < math.inf and 0 <= self.wall_seconds < math.inf):
            raise DamagedRowError("its times are no durations")

    def check(self) -> None:
        """Raise DamagedRowError if any part is damaged."""
        self.check_ends()
        if not isinstance(self.payload, bytes) or zlib.crc32(self.payload) != self.payload_digest:
            raise DamagedRowError("the checksum of its results does not fit")

    def block(self) -> FinishedBlock:
        """Read the block, or raise DamagedRowError if it is damaged."""
        self.check()
        try:
            result = decode(self.payload, np.frombuffer(self.outcomes, np.int8))
        except _NO_RESULTS as error:
            raise DamagedRowError(f"its results cannot be read: {error}") from error
        keys = np.frombuffer(self.keys, "V16")
        return FinishedBlock(keys, result, self.cpu_seconds, self.wall_seconds, self.worker)

    def numbered(self, number: int) -> BlockRow:
        """The same block with another number."""
        row = replace(self, id=number)
        return replace(row, digest=row._ends_digest())

    def _ends_digest(self) -> int:
        texts = self.worker, self.kernels
        # SQLite stores 1.0 as 1
        numbers = self.id, float(self.cpu_seconds), float(self.wall_seconds), self.payload_digest
        return zlib.crc32(self.outcomes, zlib.crc32(self.keys, zlib.crc32(json.dumps([texts, numbers]).encode())))


BLOCK_COLUMNS = tuple(BlockRow.__dataclass_fields__)
"""Names of the columns of a block."""

ENDS_COLUMNS = BLOCK_COLUMNS[:-1]
"""The same without the payload."""


@dataclass(frozen=True)
class NoteRow:
    """A stored note."""

    id: int
    digest: int
    key: str
    value: str

    @classmethod
    def of(cls, key: str, value: str) -> NoteRow:
        """The row of a note; the table gives it its number."""
        return cls(0, zlib.crc32(f"{key}={value}".encode()), key, value)

    def check(self) -> None:
        """Raise DamagedRowError if the note is damaged."""
        try:
            whole = isinstance(self.value, str) and self.of(self.key, self.value).digest == self.digest
        except UnicodeEncodeError as error:
            raise DamagedRowError(str(error)) from error
        if not whole:
            raise DamagedRowError("its checksum does not fit")


NOTE_COLUMNS = tuple(NoteRow.__dataclass_fields__)
"""Names of the columns of a note."""


def make_tables(connection: sqlite3.Connection) -> None:
    """Make the tables of a journal in a new file."""
    connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
    connection.executescript(SCHEMA)


def insert_block(connection: sqlite3.Connection, row: BlockRow) -> None:
    """Add a block; the statement is a transaction of its own unless one was begun."""
    places = ", ".join("?" * len(BLOCK_COLUMNS))
    connection.execute(f"INSERT INTO block ({', '.join(BLOCK_COLUMNS)}) VALUES ({places})", astuple(row))


def put_notes(connection: sqlite3.Connection, notes: Mapping[str, str]) -> None:
    """Set notes; the statement is a transaction of its own unless one was begun."""
    rows = [NoteRow.of(key, value) for key, value in notes.items()]
    places = ", ".join(["(?, ?, ?)"] * len(rows))
    values = [value for row in rows for value in (row.digest, row.key, row.value)]
    connection.execute(f"INSERT OR REPLACE INTO note (digest, key, value) VALUES {places}", values)


def write_journal(path: Path, blocks: Iterable[BlockRow], notes: Mapping[str, str], number: int = 0) -> None:
    """Replace a journal as a whole, or make a new one; a kill leaves the old or the new.

    Args:
        path, blocks, notes: The journal, and what it holds.
        number: Of the results; 0 for new ones, which get a random one.

    Raises:
        StorageError: If it cannot be written; the old one stays.
    """
    with replace_file(path) as fresh:
        fresh.unlink(missing_ok=True)
        try:
            with closing(sqlite3.connect(fresh, isolation_level=None)) as connection:
                connection.execute("PRAGMA journal_mode = OFF")  # nothing else sees this file before it is whole
                connection.execute("PRAGMA synchronous = OFF")
                make_tables(connection)
                connection.execute(f"PRAGMA user_version = {number or 1 + secrets.randbelow(MOST_RESULTS)}")
                connection.execute("BEGIN")
                for row in blocks:
                    insert_block(connection, row)
                if notes:
                    put_notes(connection, notes)
                connection.execute("COMMIT")
            for log in ("-wal", "-shm", "-journal"):  # logs of the old file would damage the new one
                path.with_name(path.name + log).unlink(missing_ok=True)
        except sqlite3.Error as error:
            raise OSError(str(error)) from error
