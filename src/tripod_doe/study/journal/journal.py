"""The journal of a result directory: its finished blocks in an SQLite file; a kill never loses one.

During a run it has a write-ahead log, so that others can always read; after the run it is one file, readable without
write access.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import CubeError, StorageError
from tripod_doe.files.checksum_list import JOURNAL
from tripod_doe.study.journal.damage import (
    KERNELS,
    OUTDATED,
    POINTS,
    REPAIRS,
    SHOWN,
    connected,
    counted,
    damage,
    is_damage,
    rescue,
)
from tripod_doe.study.journal.finished_block import FinishedBlock
from tripod_doe.study.journal.rows import (
    BLOCK_COLUMNS,
    ENDS_COLUMNS,
    NOTE_COLUMNS,
    BlockRow,
    DamagedRowError,
    NoteRow,
    insert_block,
    put_notes,
    write_journal,
)

PILOT = "pilot"
"""Name of the worker of points that the pilot of their study ran."""

_SYNCED = 0.1  # blocks of at least this time are synced to disk at once, which costs 2 to 4 ms
_UNSYNCED = 1.0  # other blocks are synced after this time
_ALL, _ENDS = ", ".join(BLOCK_COLUMNS), ", ".join([*ENDS_COLUMNS, "x''"])


@dataclass(frozen=True)
class Mark:
    """Position of a reader."""

    number: int = 0  # of the newest block that was read
    repairs: str = ""  # number of repairs of the journal before


@dataclass(frozen=True)
class FinishedEnds:
    """Outcomes of the points of a block."""

    # keys, outcomes: fingerprints and outcomes of its points, shape (point,)
    keys: NDArray[np.void]
    outcomes: NDArray[np.int8]
    cpu_seconds: float  # of the whole block


class Journal:
    """Finished blocks of one result directory, and notes about them.

    A writer checks the whole journal, and keeps the intact blocks of a damaged one.

    Args:
        directory: The result directory; it must exist. A writer must hold it, see `ResultDirectory`.
        read_only: Open an existing journal without holding its directory, also while another process writes.

    Raises:
        CubeError: Here and in all methods that read, if the journal of a reader is damaged.
        StorageError: Here and in all methods that write, if the disk is full or fails; what was committed stays.
    """

    repaired: str = ""
    """A sentence about the losses of a damaged journal when it was opened; empty for an intact one."""

    def __init__(self, directory: Path, read_only: bool = False) -> None:
        self.path, self._writes = journal_path(directory), not read_only
        if read_only:
            with self._reading("its first bytes"):
                self._connection = connected(self.path, "ro")
            return
        with self._storing():
            if not self.path.exists():
                write_journal(self.path, [], {})
            elif reason := damage(self.path):
                self.repaired = rescue(self.path, reason)
            self._connection = connected(self.path, "rw")
            self._connection.execute("PRAGMA journal_mode = WAL")
        self._synced_at = -np.inf

    def close(self) -> None:
        """Close the file; a writer leaves a single file, unless others are reading it."""
        if self._writes:
            with suppress(sqlite3.Error):
                self._connection.execute("PRAGMA busy_timeout = 1000")
                self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def remember(self, notes: dict[str, str]) -> None:
        """Store notes that outlive the process."""
        if any(self.recall(key) != value for key, value in notes.items()):
            with self._storing():
                put_notes(self._connection, notes)

    def recall(self, key: str) -> str | None:
        """Read a note, None where there is none."""
        question = f"SELECT {', '.join(NOTE_COLUMNS)} FROM note WHERE key = ?"
        for values in self._rows(question, key):
            note = NoteRow(*values)
            with self._reading(f"note {key!r}"):
                note.check()
            return note.value
        return None

    def commit(self, block: FinishedBlock) -> None:
        """Store a block; when this returns, no kill can lose it, and a power cut loses at most a second of work."""
        row = BlockRow.of(self._newest() + 1, block, self.recall(KERNELS) or "")
        now = time.monotonic()
        is_synced = block.wall_seconds > _SYNCED or now > self._synced_at + _UNSYNCED
        with self._storing():
            self._connection.execute(f"PRAGMA synchronous = {'FULL' if is_synced else 'NORMAL'}")
            insert_block(self._connection, row)
        self._synced_at = now if is_synced else self._synced_at

    def note_shown(self) -> None:
        """Note that the cube shows all blocks."""
        self.remember({SHOWN: self.state(), OUTDATED: "no"})

    def state(self) -> str:
        """Identify the content of the journal by a word that differs after every commit; "0" if it is empty."""
        newest = self._newest()
        with self._reading("its notes"):
            shown = counted(SHOWN, self.recall(SHOWN))
        if newest < shown:
            raise self._damaged(f"block {shown} is not there")
        return str(newest)

    def points(self) -> int:
        """Read how many points the study computes; 0 before that is known."""
        with self._reading("its notes"):
            return counted(POINTS, self.recall(POINTS))

    def keys(self) -> NDArray[np.void]:
        """Read the fingerprints of all committed points, oldest first; a repeated run of a point counts again."""
        return np.concatenate([np.array([], "V16"), *self.key_blocks()])

    def key_blocks(self) -> Iterator[NDArray[np.void]]:
        """Read the same, block by block."""
        for _, ends in self._ends(0):
            yield ends.keys

    def blocks(self) -> Iterator[FinishedBlock]:
        """Read all committed blocks, oldest first, one at a time."""
        for values in self._rows(f"SELECT {_ALL} FROM block ORDER BY id"):
            yield self._block(values)

    def places(self) -> Iterator[Callable[[], FinishedBlock]]:
        """Give all committed blocks, oldest first, each as a function that reads it, as often as it is called."""
        for (number,) in self._rows("SELECT id FROM block ORDER BY id"):
            yield partial(self._read, number)

    def news(self, mark: Mark) -> tuple[bool, list[FinishedEnds], Mark]:
        """Read the outcomes of the blocks after a mark, oldest first.

        Returns:
            again: Whether these are all blocks, as the journal was repaired since the mark was set.
            ends: Of the blocks; their other results are not read.
            mark: For the next call.
        """
        repairs = self.recall(REPAIRS) or ""
        again = repairs != mark.repairs
        numbered = list(self._ends(0 if again else mark.number))
        newest = numbered[-1][0] if numbered else 0 if again else mark.number
        return again, [ends for _, ends in numbered], Mark(newest, repairs)

    def check(self) -> None:
        """Read the whole journal; CubeError if any of it is damaged."""
        with self._reading("its structure"):
            if reason := damage(self.path):
                raise self._damaged(reason)

    def _newest(self) -> int:
        return int(next(self._rows("SELECT coalesce(max(id), 0) FROM block"))[0])

    def _ends(self, after: int) -> Iterator[tuple[int, FinishedEnds]]:
        for values in self._rows(f"SELECT {_ENDS} FROM block WHERE id > ? ORDER BY id", after):
            row = BlockRow(*values)
            with self._reading(f"block {row.id}"):
                row.check_ends()
            keys, outcomes = np.frombuffer(row.keys, "V16"), np.frombuffer(row.outcomes, np.int8)
            yield row.id, FinishedEnds(keys, outcomes, row.cpu_seconds)

    def _read(self, number: int) -> FinishedBlock:
        return self._block(next(self._rows(f"SELECT {_ALL} FROM block WHERE id = ?", number)))

    def _block(self, values: tuple[Any, ...]) -> FinishedBlock:
        row = BlockRow(*values)
        with self._reading(f"block {row.id}"):
            return row.block()

    def _rows(self, question: str, *values: Any) -> Iterator[tuple[Any, ...]]:
        with self._reading("its structure"):
            yield from map(tuple, self._connection.execute(question, values))  # it must not close the cursor at its end

    @contextmanager
    def _reading(self, part: str) -> Iterator[None]:
        try:
            yield
        except (DamagedRowError, OverflowError) as error:
            raise self._damaged(f"{part}: {error}") from error
        except sqlite3.Error as error:
            if is_damage(error):
                raise self._damaged(f"{part}: {error}") from error
            raise CubeError(f"{self.path}: cannot read the journal: {error}") from error

    def _damaged(self, reason: str) -> CubeError:
        remedy = "run the study again with the same --out: what is whole is kept, and the rest computed again"
        return CubeError(f"{self.path}: the journal is damaged ({reason}); {remedy}")

    @contextmanager
    def _storing(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, OSError) as error:
            held = getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY  # extended codes are above
            remedy = "end the program that holds it" if held else "free space"
            raise StorageError(
                f"{self.path}: cannot write ({error}); finished points are kept: {remedy}, then run again"
            ) from error


def journal_path(directory: Path) -> Path:
    """Path of the journal of a result directory; it identifies result directories."""
    return directory / JOURNAL
