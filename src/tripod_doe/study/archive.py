"""The archive of a journal: blocks of runs that have ended, in one SQLite file that is only ever replaced as a whole.

Journals of earlier versions are such a file alone; their blocks are npz archives, and are read as they are.
"""

from __future__ import annotations

import io
import json
import sqlite3
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.atomic_files import replace_file
from tripod_doe.simulator import WORK, BlockResult, Retries, Values
from tripod_doe.study.block_record import FinishedBlock, FinishedEnds, decode, decode_ends, decode_keys, record_number

SCHEMA = """
CREATE TABLE IF NOT EXISTS block (
    id INTEGER PRIMARY KEY,
    keys BLOB NOT NULL,          -- fingerprints of its points, 16 bytes each
    payload BLOB NOT NULL,       -- the block's record; of earlier versions a npz archive
    cpu_seconds REAL NOT NULL,
    wall_seconds REAL NOT NULL,
    worker TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
"""
BLOCK_COLUMNS = ("keys", "payload", "cpu_seconds", "wall_seconds", "worker")
"""What is stored of a block."""

_HEADER, _WRITE_VERSION, _WITH_LOG = 19, 18, b"\x02"  # of SQLite's file format
_ALL = ", ".join(BLOCK_COLUMNS)

Row = tuple[bytes, bytes, float, float, str]
"""A block as it is stored."""


class Archive:
    """An existing archive, for reading, also while another process replaces it.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    sqlite3.Error
        Here and in all methods, if it is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def count(self) -> int:
        """Number of the newest block; 0 where there is none."""
        return int(self._connection.execute("SELECT coalesce(max(id), 0) FROM block").fetchone()[0])

    def size(self) -> int:
        """Bytes of all blocks."""
        return int(self._connection.execute("SELECT coalesce(sum(length(payload)), 0) FROM block").fetchone()[0])

    def notes(self) -> dict[str, str]:
        """All notes."""
        return dict(self._connection.execute("SELECT key, value FROM meta").fetchall())

    def keys(self) -> Iterator[NDArray[np.void]]:
        """Fingerprints of the points of each block, oldest first."""
        for (keys,) in self._connection.execute("SELECT keys FROM block ORDER BY id"):
            yield np.frombuffer(keys, "V16")

    def rows(self) -> Iterator[Row]:
        """All blocks as they are stored, oldest first."""
        yield from self._connection.execute(f"SELECT {_ALL} FROM block ORDER BY id")

    def blocks(self) -> Iterator[FinishedBlock]:
        """All blocks, oldest first, one at a time."""
        yield from map(_block, self.rows())

    def numbers(self) -> list[int]:
        """Numbers of all blocks, the oldest first."""
        return [number for (number,) in self._connection.execute("SELECT id FROM block ORDER BY id")]

    def block(self, number: int) -> FinishedBlock:
        """The block of a number."""
        return _block(self._connection.execute(f"SELECT {_ALL} FROM block WHERE id = ?", (number,)).fetchone())

    def ends(self) -> Iterator[FinishedEnds]:
        """How the points of all blocks ended, oldest first; their outputs are not read."""
        for keys, payload, cpu, *_ in self.rows():
            if _is_npz(payload):
                with np.load(io.BytesIO(payload), allow_pickle=False) as stored:
                    yield FinishedEnds(np.frombuffer(keys, "V16"), stored["outcome"], cpu)
            else:
                yield decode_ends(memoryview(payload))


def _block(row: Row) -> FinishedBlock:
    keys, payload, cpu, wall, worker = row
    if _is_npz(payload):
        return FinishedBlock(np.frombuffer(keys, "V16"), _from_npz(payload), cpu, wall, worker)
    return decode(memoryview(payload))


def row_of(record: memoryview) -> Row:
    """A block as an archive stores it."""
    block = decode(record)
    return block.keys.tobytes(), bytes(record), block.cpu_seconds, block.wall_seconds, block.worker


def write_archive(path: Path, rows: Iterable[Row], notes: Mapping[str, str]) -> None:
    """Replace an archive, or make the first one; a kill leaves the old or the new.

    Raises
    ------
    StorageError
        If it cannot be written; the old one stays.
    """
    with replace_file(path) as fresh:
        fresh.unlink(missing_ok=True)
        try:
            with closing(sqlite3.connect(fresh)) as connection, connection:
                connection.execute("PRAGMA journal_mode = OFF")  # nobody else sees this file before it is whole
                connection.execute("PRAGMA synchronous = OFF")
                connection.executescript(SCHEMA)
                connection.executemany(f"INSERT INTO block ({_ALL}) VALUES (?, ?, ?, ?, ?)", rows)
                connection.executemany("INSERT INTO meta VALUES (?, ?)", notes.items())
        except sqlite3.Error as error:
            raise OSError(str(error)) from error


def without_log(path: Path) -> None:
    """Take over what an earlier version left in a log beside its journal, so that it is one file.

    Raises
    ------
    sqlite3.Error
        If it is damaged.
    """
    with path.open("rb") as stream:
        has_log = stream.read(_HEADER)[_WRITE_VERSION:] == _WITH_LOG
    if has_log:
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("PRAGMA journal_mode = DELETE")


def is_whole(keys: Any, payload: Any, cpu_seconds: Any, wall_seconds: Any, worker: Any) -> bool:
    """Whether the stored columns of a block are as they were written, by the checksums in them."""
    try:
        whole = _is_whole_npz(keys, payload) if _is_npz(payload) else _is_whole_record(keys, payload)
    except (zipfile.BadZipFile, ValueError, KeyError, TypeError, EOFError, OSError, NotImplementedError):
        return False
    return whole and isinstance(cpu_seconds, float) and isinstance(wall_seconds, float) and isinstance(worker, str)


def _is_npz(payload: bytes) -> bool:
    return payload[:2] == b"PK"


def _is_whole_record(keys: bytes, payload: bytes) -> bool:
    return record_number(payload) is not None and decode_keys(memoryview(payload)).tobytes() == keys


def _is_whole_npz(keys: bytes, payload: bytes) -> bool:
    with zipfile.ZipFile(io.BytesIO(payload)) as stored:
        if stored.testzip() is not None:
            return False
        header = json.loads(np.lib.format.read_array(stored.open("header.npy"), allow_pickle=False).tobytes())
    _from_npz(payload)  # names of its arrays are no part of a checksum
    return bool(header.get("keys_crc32", zlib.crc32(keys)) == zlib.crc32(keys))


def _from_npz(payload: bytes) -> BlockResult:
    with np.load(io.BytesIO(payload), allow_pickle=False) as stored:
        header = json.loads(stored["header"].tobytes())
        outputs = {name: Values(tuple(dims), stored[f"output/{name}"]) for name, dims in header["dims"].items()}

        def named(prefix: str) -> dict[str, NDArray[Any]]:
            return {name.removeprefix(prefix): stored[name] for name in stored.files if name.startswith(prefix)}

        retries = None
        if "attempt" in stored:
            first = stored["first_outcome"], header["first_detail"]
            retries = Retries(stored["attempt"], *first, named("used/"))
        return BlockResult(
            outputs=outputs,
            coordinates=named("coordinate/"),
            detail=header["detail"],
            settled=named("settled/"),
            retries=retries,
            **{name: stored[name] for name in ("outcome", *WORK)},
        )
