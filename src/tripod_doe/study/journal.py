"""The journal of a result directory: finished blocks, stored so that a kill at any moment loses none of them.

A run appends its blocks to a segment of its own in the folder ``journal``. When it ends, segments of moderate size are
gathered in the archive ``journal.sqlite``, and the folder goes. Notes stand beside the segments until then.
"""

from __future__ import annotations

import json
import secrets
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tripod_doe.atomic_files import replace_text
from tripod_doe.errors import CubeError, StorageError, option
from tripod_doe.quantities import count_of
from tripod_doe.study.archive import Archive, row_of, without_log, write_archive
from tripod_doe.study.block_record import (
    FinishedBlock,
    FinishedEnds,
    decode,
    decode_ends,
    decode_keys,
    encode,
)
from tripod_doe.study.segments import Segment, StoredSegment, segments_in

PILOT = "pilot"
"""Stands for the worker of points that were run by the pilot of their study."""

SHOWN, FOLDER = "shown", "folder"
"""Notes: the state of the journal that the cube shows, and the folder of the study file."""

_ENDED = "ended"  # note: segments whose processes are gone, with the length that counts and the records lost
_IN_ARCHIVE = "gathered"  # note: names of the segments that were gathered last
_NOTES = "notes.json"
_GATHERED = 32_000_000  # bytes up to which blocks are gathered in the archive
_BATCH_BYTES, _BATCH_SECONDS = 32_000_000, 1.0  # of blocks that are made to outlive a power cut together


@dataclass(frozen=True)
class Mark:
    """How far a reader has come."""

    archived: int = 0  # blocks in the archive
    lengths: dict[str, int] = field(default_factory=dict)  # bytes that were read of each segment, by its name


class Journal:
    """Finished blocks of one result directory, and notes about them.

    Parameters
    ----------
    directory
        The result directory; it must exist. Whoever writes must hold it, see `ResultDirectory`.
    read_only
        Open an existing journal without holding its directory, also while another process writes.

    Attributes
    ----------
    lost
        What is missing in segments of processes that are gone and was not told before, a sentence each.

    Raises
    ------
    CubeError
        If the archive is damaged.
    """

    def __init__(self, directory: Path, read_only: bool = False) -> None:
        self.path, self._folder = journal_path(directory), directory / "journal"
        self._read_only, self._own, self._later = read_only, None, None
        self._lock, self._synced_at, self._unsynced = threading.Lock(), -np.inf, 0
        self._late_failure: OSError | None = None
        self.lost: list[str] = []
        try:
            if not read_only:
                if not self.path.exists():
                    write_archive(self.path, [], {})
                without_log(self.path)
            self._open()
        except sqlite3.DatabaseError as error:
            if read_only:
                raise
            raise unreadable(self.path) from error
        if not read_only:
            self._end_segments_of_others()

    _own: Segment | None
    _later: threading.Timer | None

    def _open(self) -> None:
        """Look at what is there; segments before the archive, so that none is missed while they are gathered."""
        while True:
            try:
                paths = segments_in(self._folder)
                found = [StoredSegment(path, path.stat().st_size) for path in paths]
            except FileNotFoundError:  # they have just been gathered
                continue
            break
        self._archive = Archive(self.path)
        archived = self._archive.notes()
        self._notes = archived | self._notes_of_folder(archived.get(_IN_ARCHIVE))
        in_archive, ended = set(json.loads(archived.get(_IN_ARCHIVE, "[]"))), self._ended()
        self._segments = [segment for segment in found if segment.path.name not in in_archive]
        for segment in self._segments:
            segment.length = min(segment.length, ended.get(segment.path.name, (segment.length, 0))[0])
        if not self._read_only:
            for path in paths:  # left by a kill between the archive and the end of its segments
                if path.name in in_archive:
                    path.unlink()

    def _notes_of_folder(self, in_archive: str | None) -> dict[str, str]:
        """Notes beside the segments; none where they are those of segments that were gathered."""
        try:
            notes: dict[str, str] = json.loads((self._folder / _NOTES).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return notes if notes.get(_IN_ARCHIVE) == in_archive else {}

    def _ended(self) -> dict[str, tuple[int, int]]:
        return {name: (end, lost) for name, (end, lost) in json.loads(self._notes.get(_ENDED, "{}")).items()}

    def _end_segments_of_others(self) -> None:
        """Note where the segments of processes that are gone end: what one of them still appends does not count."""
        before, ended = self._ended(), {}
        for segment in self._segments:
            for _ in segment.records():
                pass
            name = segment.path.name
            ended[name] = segment.end, segment.lost
            if segment.lost > before.get(name, (0, 0))[1]:
                told = f"{count_of(segment.lost, 'block')} of this part of the journal cannot be read"
                self.lost.append(f"{segment.path}: {told}; what is lost is computed again")
            if segment.torn:
                told = "its end cannot be read, a block that was not written whole, or damage"
                self.lost.append(f"{segment.path}: {told}; what is lost is computed again")
            segment.length = segment.end
        if ended != before:
            self.remember({_ENDED: json.dumps(ended)})

    def close(self) -> None:
        """Close all files."""
        try:
            self.sync()
        finally:
            self._archive.close()
            if self._own:
                self._own.close()
                self._own = None

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def remember(self, notes: dict[str, str]) -> None:
        """Store notes that outlive the process."""
        if notes.items() <= self._notes.items():
            return
        self._notes |= notes
        replace_text(self._folder / _NOTES, json.dumps(self._notes))

    def recall(self, key: str) -> str | None:
        """Read a note, None where there is none."""
        return self._notes.get(key)

    def commit(self, block: FinishedBlock) -> None:
        """Store a block; when this returns, no kill can lose it, and within a second no power cut.

        Raises
        ------
        StorageError
            If the disk is full or fails, also for an earlier block.
        """
        try:
            if self._own is None:
                self._folder.mkdir(exist_ok=True)
                self._own = Segment(self._folder, secrets.token_hex(4))
            record = encode(block, self._own.count)
            self._own.append(record)
            self._unsynced += len(record)
            if self._unsynced > _BATCH_BYTES or time.monotonic() > self._synced_at + _BATCH_SECONDS:
                self._sync()
            elif self._later is None:
                self._later = threading.Timer(_BATCH_SECONDS, self._sync_late)
                self._later.daemon = True
                self._later.start()
            if self._late_failure:
                raise self._late_failure
        except OSError as error:
            raise self._cannot_write(error) from error

    def sync(self) -> None:
        """Make what was committed outlive a power cut.

        Raises
        ------
        StorageError
            If the disk fails.
        """
        try:
            self._sync()
        except OSError as error:
            raise self._cannot_write(error) from error

    def _sync(self) -> None:
        with self._lock:
            if self._later:
                self._later.cancel()
                self._later = None
            if self._own and self._unsynced:
                self._unsynced = 0
                self._own.sync()
                self._synced_at = time.monotonic()

    def _sync_late(self) -> None:
        try:
            self._sync()
        except OSError as error:
            self._late_failure = error

    def _cannot_write(self, error: OSError) -> StorageError:
        reason = error.strerror or error
        return StorageError(
            f"{self._folder}: cannot write ({reason}); finished points are kept: free space, then run again"
        )

    def note_shown(self) -> None:
        """Note that the cube shows all blocks, and gather them if they are of moderate size.

        Raises
        ------
        StorageError
            If the disk is full or fails; all blocks stay.
        """
        written = self._own.length if self._own else 0
        if not (written or self._segments or self._folder.exists()):
            if self._notes.get(SHOWN) != self.state():
                self.remember({SHOWN: self.state()})
            return
        self.sync()
        if written + sum(segment.length for segment in self._segments) + self._archive.size() > _GATHERED:
            self.remember({SHOWN: self.state()})
            return
        self._gather()

    def _gather(self) -> None:
        """Put all blocks and notes into a new archive; then the folder can go."""
        segments = self._all_segments()
        rows = [*self._archive.rows(), *(row_of(record) for segment in segments for record in segment.records())]
        names = [segment.path.name for segment in segments]
        notes = {key: value for key, value in self._notes.items() if key != _ENDED}
        notes |= {SHOWN: str(len(rows)), _IN_ARCHIVE: json.dumps(names)}
        write_archive(self.path, rows, notes)
        self._archive.close()
        if self._own:
            self._own.close()
            self._own = None
        with suppress(OSError):  # what stays there is known to be gathered
            shutil.rmtree(self._folder)
        self._open()

    def _all_segments(self) -> list[StoredSegment]:
        """The segments that count, with that of this process as far as it was written."""
        own = [StoredSegment(self._own.path, self._own.length)] if self._own and self._own.length else []
        return [*self._segments, *own]

    def state(self) -> str:
        """What the journal holds, as a word that differs after every commit; "0" where it holds nothing."""
        lengths = [f"{segment.path.name}:{segment.length}" for segment in self._all_segments() if segment.length]
        return " ".join([str(self._archive.count()), *lengths])

    def keys(self) -> NDArray[np.void]:
        """Fingerprints of all committed points, in order of their commits; one that was run again stands twice."""
        return np.concatenate([np.array([], "V16"), *self.key_blocks()])

    def key_blocks(self) -> Iterator[NDArray[np.void]]:
        """The same, block by block."""
        yield from self._archive.keys()
        yield from map(decode_keys, self._records())

    def blocks(self) -> Iterator[FinishedBlock]:
        """All committed blocks, oldest first, one at a time."""
        yield from self._archive.blocks()
        yield from map(decode, self._records())

    def places(self) -> Iterator[Callable[[], FinishedBlock]]:
        """All committed blocks, oldest first, each as a function that reads it, as often as it is called."""
        for number in self._archive.numbers():
            yield partial(self._archive.block, number)
        for segment in self._all_segments():
            for start, stop in segment.places():
                yield partial(_read, segment, start, stop)

    def news(self, mark: Mark) -> tuple[bool, list[FinishedEnds], Mark]:
        """How the points of the blocks behind a mark ended, oldest first.

        Returns
        -------
        again : bool
            Whether these are all blocks, as they were gathered since the mark was set.
        ends : list of FinishedEnds
            Of the blocks; their outputs are not read.
        mark : Mark
            For the next call.
        """
        archived = self._archive.count()
        again = archived != mark.archived
        ends = [*self._archive.ends()] if again else []
        lengths = {}
        for segment in self._all_segments():
            name = segment.path.name
            ends += map(decode_ends, segment.records(0 if again else mark.lengths.get(name, 0)))
            lengths[name] = segment.end
        return again, ends, Mark(archived, lengths)

    def _records(self) -> Iterator[memoryview]:
        for segment in self._all_segments():
            yield from segment.records()


def _read(segment: StoredSegment, start: int, stop: int) -> FinishedBlock:
    return decode(segment.record(start, stop))


def journal_path(directory: Path) -> Path:
    """The archive of the journal in a result directory, by which the directory is known as one."""
    return directory / "journal.sqlite"


def unreadable(path: Path) -> CubeError:
    """The error of a journal of which nothing can be read."""
    return CubeError(f"{path}: not a readable journal; move it elsewhere or choose another {option('out')}")
