"""The journal: finished blocks in SQLite, committed one by one, so that a kill loses no finished point."""

from __future__ import annotations

import io
import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import CubeError, StorageError, option
from tripod_doe.simulator import WORK, BlockResult, Retries, Values

__all__ = ["FOLDER", "PILOT", "SHOWN", "FinishedBlock", "Journal"]

PILOT = "pilot"
"""Stands for the worker of points that were run by the pilot of their study."""

SHOWN, FOLDER = "shown", "folder"
"""Notes: the newest block that the cube shows, and the folder of the study file."""

_SCHEMA = """
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
        self.path = directory / "journal.sqlite"
        if read_only:
            self._connection = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro", uri=True)
            return
        self._connection = sqlite3.connect(self.path)
        try:
            self._connection.execute("PRAGMA journal_mode = WAL")
            self._connection.execute("PRAGMA synchronous = FULL")
            self._connection.executescript(_SCHEMA)
        except sqlite3.DatabaseError as error:
            self.close()
            raise CubeError(
                f"{self.path}: not a readable journal ({error}); move it elsewhere or choose another {option('out')}"
            ) from error

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
                "INSERT INTO block (keys, payload, cpu_seconds, wall_seconds, worker) VALUES (?, ?, ?, ?, ?)",
                (block.keys.tobytes(), _pack(block.result), block.cpu_seconds, block.wall_seconds, block.worker),
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

    def blocks(self) -> Iterator[FinishedBlock]:
        """All committed blocks, oldest first, one at a time."""
        rows = self._connection.execute(
            "SELECT keys, payload, cpu_seconds, wall_seconds, worker FROM block ORDER BY id"
        )
        for keys, payload, cpu, wall, worker in rows:
            yield FinishedBlock(np.frombuffer(keys, "V16"), _unpack(payload), cpu, wall, worker)


def _pack(result: BlockResult) -> bytes:
    header: dict[str, Any] = {
        "dims": {name: values.dims for name, values in result.outputs.items()}, "detail": result.detail,
    }  # fmt: skip
    arrays: dict[str, Any] = {f"output/{name}": values.data for name, values in result.outputs.items()}
    arrays |= {f"coordinate/{name}": labels for name, labels in result.coordinates.items()}
    arrays |= {name: getattr(result, name) for name in ("outcome", *WORK)}
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
            retries=retries,
            **{name: archive[name] for name in ("outcome", *WORK)},
        )
