"""The journal: finished blocks in SQLite, committed one by one, so that a kill loses no finished point."""

from __future__ import annotations

import io
import json
import sqlite3
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import CubeError, StorageError, option
from tripod_doe.simulator import WORK, BlockResult, Retries, Values

__all__ = [
    "BLOCK_COLUMNS",
    "FOLDER",
    "PILOT",
    "SCHEMA",
    "SHOWN",
    "FinishedBlock",
    "FinishedEnds",
    "Journal",
    "is_whole",
    "journal_path",
    "unreadable",
]

PILOT = "pilot"
"""Stands for the worker of points that were run by the pilot of their study."""

SHOWN, FOLDER = "shown", "folder"
"""Notes: the newest block that the cube shows, and the folder of the study file."""

SCHEMA = """
CREATE TABLE IF NOT EXISTS block (
    id INTEGER PRIMARY KEY,
    keys BLOB NOT NULL,          -- fingerprints of its points, 16 bytes each
    payload BLOB NOT NULL,       -- the results, a npz archive
    cpu_seconds REAL NOT NULL,
    wall_seconds REAL NOT NULL,
    worker TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
"""
"""Tables of a journal."""

BLOCK_COLUMNS = ("keys", "payload", "cpu_seconds", "wall_seconds", "worker")
"""What is stored of a block."""

_SELECT = f"SELECT {', '.join(BLOCK_COLUMNS)} FROM block"


@dataclass(frozen=True)
class FinishedBlock:
    """A block of points as it came back from a worker.

    Attributes
    ----------
    keys
        Fingerprints of its points, shape (point,).
    result
        What was simulated.
    cpu_seconds, wall_seconds
        Of the whole block.
    worker
        Name of the process in which it ran; `PILOT` for what the study's pilot ran.
    """

    keys: NDArray[np.void]
    result: BlockResult
    cpu_seconds: float
    wall_seconds: float
    worker: str


@dataclass(frozen=True)
class FinishedEnds:
    """How the points of a block ended.

    Attributes
    ----------
    keys, outcomes
        Fingerprints and outcomes of its points, shape (point,).
    cpu_seconds
        Of the whole block.
    """

    keys: NDArray[np.void]
    outcomes: NDArray[np.int8]
    cpu_seconds: float


class Journal:
    """Finished blocks of one result directory, and notes about them.

    Parameters
    ----------
    directory
        The result directory; it must exist. Whoever writes must hold it, see `ResultDirectory`.
    read_only
        Open an existing journal without holding its directory, also while another process writes.

    Raises
    ------
    CubeError
        If the file is not a journal.
    """

    def __init__(self, directory: Path, read_only: bool = False) -> None:
        self.path = journal_path(directory)
        if read_only:
            self._connection = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro", uri=True)
            return
        self._connection = sqlite3.connect(self.path)
        try:
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute("PRAGMA synchronous = FULL")
            self._connection.executescript(SCHEMA)
        except sqlite3.DatabaseError as error:
            self.close()
            raise unreadable(self.path) from error

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def remember(self, key: str, value: str) -> None:
        """Store a note that outlives the process."""
        with self._writing():
            self._connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))

    def recall(self, key: str) -> str | None:
        """Read a note, None where there is none."""
        row = self._connection.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
        return row[0] if row else None

    def commit(self, block: FinishedBlock) -> None:
        """Store a block durably; when this returns, no kill can lose it.

        Raises
        ------
        StorageError
            If the disk is full or fails.
        """
        with self._writing():
            self._connection.execute(
                f"INSERT INTO block ({', '.join(BLOCK_COLUMNS)}) VALUES (?, ?, ?, ?, ?)",
                (block.keys.tobytes(), _pack(block), block.cpu_seconds, block.wall_seconds, block.worker),
            )

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with self._connection:
                yield
        except sqlite3.Error as error:
            raise StorageError(
                f"{self.path}: cannot write ({error}); finished points are kept: free space, then run again"
            ) from error

    def last_block(self) -> int:
        """Number of the newest block; 0 where there is none."""
        return int(self._connection.execute("SELECT coalesce(max(id), 0) FROM block").fetchone()[0])

    def keys(self) -> NDArray[np.void]:
        """Fingerprints of all committed points, in order of their commits; one that was run again stands twice."""
        rows = self._connection.execute("SELECT keys FROM block ORDER BY id")
        return np.frombuffer(b"".join(row[0] for row in rows), dtype="V16")

    def ends(self, after: int = 0) -> Iterator[tuple[int, FinishedEnds]]:
        """How the points of the blocks after a given one ended, oldest first; their outputs are not read."""
        rows = self._connection.execute(
            "SELECT id, keys, payload, cpu_seconds FROM block WHERE id > ? ORDER BY id", (after,)
        )
        for number, keys, payload, cpu in rows:
            with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
                yield number, FinishedEnds(np.frombuffer(keys, "V16"), archive["outcome"], cpu)

    def blocks(self) -> Iterator[FinishedBlock]:
        """All committed blocks, oldest first, one at a time."""
        rows = self._connection.execute(f"{_SELECT} ORDER BY id")
        for keys, payload, cpu, wall, worker in rows:
            yield FinishedBlock(np.frombuffer(keys, "V16"), _unpack(payload), cpu, wall, worker)


def journal_path(directory: Path) -> Path:
    """The journal's file in a result directory."""
    return directory / "journal.sqlite"


def unreadable(path: Path) -> CubeError:
    """The error of a journal of which nothing can be read."""
    return CubeError(f"{path}: not a readable journal; move it elsewhere or choose another {option('out')}")


def is_whole(keys: Any, payload: Any, cpu_seconds: Any, wall_seconds: Any, worker: Any) -> bool:
    """Whether the stored columns of a block are as they were written, by the checksums in them."""
    try:
        with zipfile.ZipFile(io.BytesIO(payload)) as archive:
            if archive.testzip() is not None:
                return False
            header = json.loads(np.lib.format.read_array(archive.open("header.npy"), allow_pickle=False).tobytes())
        known = header.get("keys_crc32", zlib.crc32(keys)) == zlib.crc32(keys)
    except (zipfile.BadZipFile, ValueError, KeyError, TypeError, EOFError, OSError, NotImplementedError):
        return False
    return known and isinstance(cpu_seconds, float) and isinstance(wall_seconds, float) and isinstance(worker, str)


def _pack(block: FinishedBlock) -> bytes:
    result = block.result
    header: dict[str, Any] = {
        "dims": {name: values.dims for name, values in result.outputs.items()}, "detail": result.detail,
        "keys_crc32": zlib.crc32(block.keys.tobytes()),
    }  # fmt: skip
    arrays: dict[str, Any] = {f"output/{name}": values.data for name, values in result.outputs.items()}
    arrays |= {f"coordinate/{name}": labels for name, labels in result.coordinates.items()}
    arrays |= {name: getattr(result, name) for name in ("outcome", *WORK)}
    arrays |= {f"settled/{name}": column for name, column in result.settled.items()}
    if retries := result.retries:
        header["first_detail"] = retries.first_detail
        arrays |= {"attempt": retries.attempt, "first_outcome": retries.first_outcome}
        arrays |= {f"used/{name}": column for name, column in retries.used.items()}
    buffer = io.BytesIO()
    np.savez(buffer, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return buffer.getvalue()


def _unpack(payload: bytes) -> BlockResult:
    with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
        header = json.loads(archive["header"].tobytes())
        outputs = {name: Values(tuple(dims), archive[f"output/{name}"]) for name, dims in header["dims"].items()}

        def named(prefix: str) -> dict[str, NDArray[Any]]:
            return {name.removeprefix(prefix): archive[name] for name in archive.files if name.startswith(prefix)}

        retries = None
        if "attempt" in archive:
            first = archive["first_outcome"], header["first_detail"]
            retries = Retries(archive["attempt"], *first, named("used/"))
        return BlockResult(
            outputs=outputs,
            coordinates=named("coordinate/"),
            detail=header["detail"],
            settled=named("settled/"),
            retries=retries,
            **{name: archive[name] for name in ("outcome", *WORK)},
        )
